"""The printed board, as a printer would see it: rasterised by PDFium, then read by the detector."""

import numpy as np
import pypdfium2
import pytest
from photo_helpers import a_camera, seen

from raytwin.boards.board import Board, Grid, read_board
from raytwin.boards.lengths import parse_paper
from raytwin.boards.sheet import BAR, Sheet, check_gap, lay_out, pdf_bytes, write_sheet
from raytwin.errors import InputError
from raytwin.photographer import poses
from raytwin.photos.calibration import calibrate_detections
from raytwin.photos.detection import detect

LETTER, A4 = parse_paper("letter", ""), parse_paper("a4", "")
DPI = 300

BOARDS = {
    "the task's, on letter": (Board("tag36h11", 0.030, Grid(5, 7, 0.038)), LETTER, True),
    "turned, up to the last id, the smallest gap": (Board("tag36h11", 0.030, Grid(8, 4, 0.03375, 555)), A4, False),
    "another family, narrow paper": (Board("tag16h5", 0.0254, Grid(2, 3, 0.03302, 7)), (0.09, 0.127), True),
    "small tags": (Board("tag25h9", 0.014, Grid(5, 7, 0.016)), (0.12, 0.2), False),
}


def page(data: bytes):
    return pypdfium2.PdfDocument(data)[0]


def raster(data: bytes, dpi: float = DPI) -> np.ndarray:
    return np.ascontiguousarray(page(data).render(scale=dpi / 72, grayscale=True).to_numpy().squeeze())


@pytest.fixture(scope="module", params=BOARDS)
def printed(request) -> tuple[Sheet, bytes]:
    board, paper, inches = BOARDS[request.param]
    sheet = lay_out(board, paper, 0.005, inches=inches)
    return sheet, pdf_bytes(sheet)


def millimetres(sheet: Sheet, pixels, image: np.ndarray) -> np.ndarray:
    """OpenCV's pixels as mm from the paper's lower left corner, Y up. PDFium fits the page into whole pixels."""
    x, y = ((np.asarray(pixels).reshape(-1, 2) + 0.5) / image.shape[::-1] * sheet.paper).T * 1000
    return np.stack([x, 1000 * sheet.paper[1] - y], axis=1)


def test_the_page_has_the_papers_exact_size(printed):
    sheet, data = printed
    assert [v / 72 * 25.4 for v in page(data).get_size()] == pytest.approx([1000 * v for v in sheet.paper], abs=1e-3)


def test_every_tag_is_read_upright_where_the_toml_says(printed):
    sheet, data = printed
    image = raster(data)
    tags = detect(image, sheet.board.family)
    assert [t.id for t in tags] == sorted(sheet.board.centers())
    found = millimetres(sheet, [t.center for t in tags], image)
    truth = 1000 * (sheet.board.points(t.id for t in tags)[:, :2] + sheet.origin)
    assert np.abs(found - truth).max() < 0.05
    # Lower left, lower right, upper right, upper left of the upright tag: neither turned nor mirrored.
    corners = millimetres(sheet, [t.corners for t in tags], image).reshape(-1, 4, 2)
    square = 500 * sheet.board.tag_edge * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    assert np.abs(corners - (truth[:, None] + square)).max() < 0.1


def test_the_mirrored_page_shows_no_tag(printed):
    sheet, data = printed
    if sheet.board.family == "tag36h11":  # the others have too few bits to rule out chance
        assert not detect(np.ascontiguousarray(raster(data)[:, ::-1]))


def test_nothing_is_printed_within_the_margin(printed):
    sheet, data = printed
    image = raster(data)
    place = millimetres(sheet, np.argwhere(image < 128)[:, ::-1], image)
    assert (place.min(axis=0) > 4.9).all()
    assert (place.max(axis=0) < 1000 * np.array(sheet.paper) - 4.9).all()


def test_the_ruler_measures_what_it_says(printed):
    sheet, data = printed
    text = page(data).get_textpage().get_text_bounded()
    assert f"print at 100 %; this bar must measure {1000 * sheet.bar:g} mm" in text
    image = raster(data, 1200)
    # The bar is the longest dark run below the lowest row of tags.
    height = round((sheet.paper[1] - sheet.origin[1] + sheet.board.tag_edge / 2) / 0.0254 * 1200) + 5
    runs = []
    for row in image[height:]:
        steps = np.flatnonzero(np.diff(np.r_[False, row < 128, False]))
        runs.append(max(np.diff(steps)[::2], default=0))
    assert max(runs) / 1200 * 25.4 == pytest.approx(1000 * sheet.bar, abs=0.05)


def test_ids_and_inches_stand_on_the_sheet():
    board, paper, _ = BOARDS["the task's, on letter"]
    for inches in (True, False):
        words = page(pdf_bytes(lay_out(board, paper, 0.005, inches=inches))).get_textpage().get_text_bounded().split()
        assert {str(i) for i in range(35)} <= set(words)
        assert ("in" in words) == inches


def test_no_seam_shows_between_neighbouring_cells():
    """At scales where the cells' edges fall between pixels, black stays black along the tag's solid left border."""
    sheet = lay_out(BOARDS["the task's, on letter"][0], LETTER, 0.005)
    data = pdf_bytes(sheet)
    for dpi in (97, 143, 211.7):
        image = raster(data, dpi)
        for x, y in sheet.board.centers().values():
            column = round((sheet.origin[0] + x - sheet.board.tag_edge * 7 / 16) / 0.0254 * dpi - 0.5)
            middle = (sheet.paper[1] - sheet.origin[1] - y) / 0.0254 * dpi
            reach = 0.47 * sheet.board.tag_edge / 0.0254 * dpi
            assert image[int(middle - reach) : int(middle + reach), column].max() == 0


def test_the_same_sheet_gives_the_same_bytes(printed):
    assert pdf_bytes(printed[0]) == printed[1]


def test_the_toml_beside_it_is_the_board_and_calibrates(tmp_path):
    board, paper, inches = BOARDS["the task's, on letter"]
    toml = write_sheet(tmp_path / "new" / "board.pdf", lay_out(board, paper, 0.005, inches=inches))
    assert toml == tmp_path / "new" / "board.toml"
    assert read_board(toml) == board
    assert sorted(p.name for p in toml.parent.iterdir()) == ["board.pdf", "board.toml"]
    # A scanner's view of the paper, tilted: the TOML's own board must come out unmirrored, with the known camera.
    camera = a_camera()
    tags = seen(camera, poses(board, camera, 12, np.random.default_rng(1)))
    found = calibrate_detections(tags, camera.image_size, read_board(toml))
    assert found.K[0][0] == pytest.approx(camera.K[0][0], rel=1e-3)
    assert not found.warnings


def test_of_pdf_and_toml_both_are_written_or_neither(tmp_path):
    (tmp_path / "board.toml").mkdir()
    with pytest.raises(InputError):
        write_sheet(tmp_path / "board.pdf", lay_out(BOARDS["the task's, on letter"][0], LETTER, 0.005))
    assert [p.name for p in tmp_path.iterdir()] == ["board.toml"]


def test_paper_is_turned_only_where_that_alone_fits():
    tall, wide = (Board("tag36h11", 0.03, Grid(*n, 0.038)) for n in ((4, 6), (6, 4)))
    small = Board("tag36h11", 0.03, Grid(3, 3, 0.038))
    assert lay_out(tall, A4, 0.005).paper == A4
    assert lay_out(wide, A4, 0.005).paper == A4[::-1]
    assert lay_out(small, A4, 0.005).paper == A4
    assert lay_out(small, A4, 0.005, landscape=True).paper == A4[::-1]
    with pytest.raises(InputError):
        lay_out(wide, A4, 0.005, landscape=False)


def test_the_size_that_is_asked_for_is_enough_and_less_is_not():
    board = Board("tag36h11", 0.03, Grid(5, 7, 0.038))
    with pytest.raises(InputError, match=r"at least 200 mm x 278\.75 mm .* got 210 mm x 270 mm") as error:
        lay_out(board, (0.21, 0.27), 0.005, landscape=False)
    assert error.value.where == "--paper"
    assert lay_out(board, (0.2, 0.27876), 0.005).bar == BAR
    for paper in ((0.1999, 0.3), (0.21, 0.2787)):
        with pytest.raises(InputError):
            lay_out(board, paper, 0.005)


@pytest.mark.parametrize(
    ("tag", "pitch", "field"), [(0.03, 0.03, "--pitch"), (0.03, 0.0337, "--pitch"), (0.001, 0.01, "--tag")]
)
def test_tags_too_close_or_too_small_are_refused(tag, pitch, field):
    with pytest.raises(InputError) as error:
        check_gap(Board("tag36h11", tag, Grid(3, 3, pitch)))
    assert error.value.where == field
