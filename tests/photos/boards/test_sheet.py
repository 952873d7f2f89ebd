"""The printed board: the page and its text as PDFium gives them, its tags as the detector sees them."""

from typing import Any

import numpy as np
import pypdfium2
import pytest
from pypdfium2 import raw

from raytwin.errors import InputError
from raytwin.photos.boards.board import Board, BoardTag, Grid, read_board, tag_cells
from raytwin.photos.boards.lengths import parse_paper
from raytwin.photos.boards.sheet import Sheet, check_gap, lay_out, pdf_bytes, write_sheet
from raytwin.photos.camera.detection import detect

LETTER, A4 = parse_paper("letter", ""), parse_paper("a4", "")
MARGIN = 5.0
"""mm."""
ROUNDED = 1e-3
"""mm: PDFium's numbers are float32, of points up to 850; reportlab writes six digits."""

BOARDS = {
    "the task's, on letter": (Board("tag36h11", 0.030, Grid(5, 7, 0.038)), LETTER),
    "turned, up to the last id, the smallest gap": (Board("tag36h11", 0.030, Grid(8, 4, 0.03375, 555)), A4),
    "counted downwards": (Board("tag25h9", 0.02, Grid(2, 3, 0.025, 3, "down")), (0.1, 0.13)),
}
TASK = BOARDS["the task's, on letter"][0]
NARROW = Board("tag16h5", 0.0254, Grid(2, 3, 0.03302, 7))


class Page:
    """A PDF's one page, rendered: its size in mm, `grey` at 300 dots per inch, and its text."""

    def __init__(self, data: bytes) -> None:
        self.file = pypdfium2.PdfDocument(data)
        (page,) = self.file
        self.size = 25.4 / 72 * np.array(page.get_size())
        self.grey = np.ascontiguousarray(page.render(scale=300 / 72, grayscale=True).to_numpy().squeeze())
        self.text = page.get_textpage().get_text_range()
        self.dots = np.array(self.grey.shape[::-1]) / self.size  # PDFium fits the page into whole pixels

    def place(self, pixels: Any) -> np.ndarray:
        """OpenCV's pixels as mm from the paper's lower left corner, Y up."""
        x, y = ((np.asarray(pixels).reshape(-1, 2) + 0.5) / self.dots).T
        return np.stack([x, self.size[1] - y], axis=1)

    def at(self, xy: np.ndarray) -> np.ndarray:
        """The grey at places (n, 2) in mm."""
        columns, rows = (np.asarray(xy) * [1, -1] + [0, self.size[1]]).T * self.dots[:, None]
        return self.grey[rows.astype(int), columns.astype(int)]

    def box(self, bottom: float, top: float) -> np.ndarray:
        """Left, bottom, right, top of what is black between two heights, mm."""
        rows, columns = np.nonzero(self.grey < 128)
        x, y = self.place(np.stack([columns, rows], axis=1)).T
        inside = (y > bottom) & (y < top)
        return np.array([x[inside].min(), y[inside].min(), x[inside].max(), y[inside].max()])


@pytest.fixture(scope="module", params=BOARDS)
def printed(request) -> tuple[Sheet, Page]:
    board, paper = BOARDS[request.param]
    sheet = lay_out(board, paper, MARGIN / 1000)
    return sheet, Page(pdf_bytes(sheet))


def bit(board: Board) -> float:
    """mm: a family's name counts its bits without the border."""
    return 1000 * board.tag_edge / {"tag36h11": 8, "tag25h9": 7, "tag16h5": 6}[board.family]


def near(value: Any, within: float = ROUNDED) -> Any:
    return pytest.approx(value, abs=within)


def test_the_page_has_the_papers_exact_size_and_asks_to_be_printed_at_it(printed):
    sheet, page = printed
    assert page.size == near(1000 * np.array(sheet.paper))
    assert not raw.FPDF_VIEWERREF_GetPrintScaling(page.file)


def test_every_tag_is_read_upright_where_the_toml_says(printed):
    sheet, page = printed
    tags = detect(page.grey, sheet.board.family)
    assert [t.id for t in tags] == sorted(sheet.board.centers())
    truth = 1000 * (sheet.board.points(t.id for t in tags)[:, :2] + sheet.origin)
    assert np.abs(page.place([t.center for t in tags]) - truth).max() < 0.1
    # Lower left, lower right, upper right, upper left of the upright tag: neither turned nor mirrored.
    square = 500 * sheet.board.tag_edge * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    assert np.abs(page.place([t.corners for t in tags]).reshape(-1, 4, 2) - (truth[:, None] + square)).max() < 0.1


def test_no_seam_shows_between_neighbouring_black_cells(printed):
    sheet, page = printed
    side, corner = bit(sheet.board), 1000 * np.array(sheet.origin) - 500 * sheet.board.tag_edge
    for tag_id, center in sheet.board.centers().items():
        black = tag_cells(sheet.board.family, tag_id)[::-1] == 0
        row, column = np.nonzero(black[1:] & black[:-1])
        seams = 1000 * np.array(center) + corner + side * np.stack([column + 0.5, row + 1], axis=1)
        assert page.at(seams).max() < 10
        # A dot above and below as well: rounding decides in which of them a seam would lie.
        assert max(page.at(seams + np.array([0, d / page.dots[1]])).max() for d in (-1, 1)) < 10


def test_the_bar_measures_what_it_says_and_its_ends_stand_upright(printed):
    sheet, page = printed
    line = 1000 * (sheet.strip[1] + 0.0070 - 0.0018)
    left, _, right, top = page.box(line, line + 2.2)
    assert right - left == near(1000 * sheet.bar, 0.2)
    assert left + right == near(page.size[0], 0.2)
    assert top - line == near(1.8, 0.2)
    assert f"this bar must measure {1000 * sheet.bar:.0f} mm; X right, Y up" in page.text


def test_the_notes_tell_the_board_and_every_tag_has_its_id(printed):
    sheet, page = printed
    ids = sheet.board.centers()
    lengths = f"tag {1000 * sheet.board.tag_edge:g} mm, pitch {1000 * sheet.board.grid.pitch:g} mm"
    note = f"{sheet.board.family}, ids {min(ids)} to {max(ids)}, each at its tag's lower left; {lengths}"
    *words, _, last = page.text.splitlines()
    assert last == note
    assert " ".join(words).split() == list(map(str, ids))
    assert f"from the centre of tag {min(ids)}" in page.text
    assert page.file.get_metadata_dict()["Title"] == f"raytwin board: {note}"


def test_the_board_stands_in_the_middle_with_a_bit_of_white_all_round_and_nothing_in_the_margin(printed):
    """Across in the middle of the paper; in height what is left over is halved."""
    sheet, page = printed
    left, bottom, right, top = page.box(0, page.size[1])
    assert min(left, bottom) > MARGIN - 0.1
    assert (page.size - (right, top)).min() > MARGIN - 0.1
    xy, half = 1000 * (np.array(list(sheet.board.centers().values())) + sheet.origin), 500 * sheet.board.tag_edge
    low, high = xy.min(axis=0) - half, xy.max(axis=0) + half
    white, strip = bit(sheet.board), 1000 * sheet.strip[1]
    assert low[0] + high[0] == near(page.size[0])
    assert low[1] - (strip + 7) == near(white)
    assert strip - MARGIN == near(page.size[1] - high[1] - max(MARGIN, white))
    assert strip - 0.1 <= bottom < strip + 0.5


@pytest.mark.parametrize(
    ("board", "margin", "paper", "least"),
    [
        # 5 (4 gaps of 38 and a tag of 30 between 5 + 2 x 2 each side); 5 + 258 + a bit of 3.75 + 7 + 5.
        (TASK, 0.005, (0.21, 0.27), (200, 278.75)),
        # A bit of 25.4 / 6 each side and above; 91.44; the bit; 7 below it.
        (NARROW, 0.0, (0.09, 0.1), (66.8867, 106.907)),
        # A bar of 20 between 10 each side; 10 + 21 + 5 / 8 + 7 + 10.
        (Board("tag36h11", 0.005, Grid(1, 3, 0.008)), 0.010, (0.035, 0.045), (40, 48.625)),
    ],
    ids=["wide", "no margin", "narrow"],
)
def test_the_size_that_is_asked_for_is_enough_and_less_is_not(board, margin, paper, least):
    want = f"at least {least[0]:g} mm x {least[1]:g} mm for this board, its bar and a margin of {1000 * margin:g} mm"
    with pytest.raises(InputError) as error:
        lay_out(board, paper, margin)
    assert (error.value.where, error.value.expected) == ("--paper", want)
    assert error.value.got.startswith(f"{1000 * paper[0]:g} mm x {1000 * paper[1]:g} mm, which")
    w, h = (n / 1000 + 1e-6 for n in least)
    lay_out(board, (w, h), margin)
    for less in ((w - 1e-5, h + 0.01), (w + 0.001, h - 1e-5)):
        with pytest.raises(InputError):
            lay_out(board, less, margin)


@pytest.mark.parametrize(("width", "bar"), [(0.1821, 100), (0.110, 100), (0.1099, 90), (0.0300, 20)])
def test_the_bar_shrinks_by_centimetres(width, bar):
    sheet = lay_out(Board("tag36h11", 0.01, Grid(1, 1, 0.02)), (width, 0.25), 0.005)
    assert 1000 * sheet.bar == near(bar)


# ------------------------------------------------------------------------------------------------ what is written


def test_the_toml_beside_it_is_the_board(tmp_path):
    toml = write_sheet(tmp_path / "new" / "board.pdf", lay_out(TASK, LETTER, 0.005))
    assert toml == tmp_path / "new" / "board.toml"
    assert read_board(toml) == TASK
    assert sorted(p.name for p in toml.parent.iterdir()) == ["board.pdf", "board.toml"]
    assert toml.read_text().startswith("# Printed from board.pdf, at 100 %.\n")
    assert Page((tmp_path / "new" / "board.pdf").read_bytes()).size == near([215.9, 279.4])


def test_of_pdf_and_toml_both_are_written_or_neither(tmp_path):
    (tmp_path / "board.toml").mkdir()
    with pytest.raises(InputError):
        write_sheet(tmp_path / "board.pdf", lay_out(TASK, LETTER, 0.005))
    assert [p.name for p in tmp_path.iterdir()] == ["board.toml"]


@pytest.mark.parametrize(("name", "got"), [("board.txt", ".txt"), ("board", "no ending")])
def test_another_ending_is_refused(tmp_path, name, got):
    with pytest.raises(InputError, match=rf"{name}: expected a name that ends in \.pdf, got {got}"):
        write_sheet(tmp_path / name, lay_out(TASK, LETTER, 0.005))
    assert write_sheet(tmp_path / "BOARD.PDF", lay_out(TASK, LETTER, 0.005)).name == "BOARD.toml"


def test_paper_is_turned_only_where_that_alone_fits():
    wide, small = (Board("tag36h11", 0.03, Grid(*n, 0.038)) for n in ((6, 4), (3, 3)))
    assert lay_out(wide, A4, 0.005).paper == A4[::-1]
    assert lay_out(small, A4, 0.005).paper == A4
    with pytest.raises(InputError, match=r"got 210 mm x 297 mm, which does not fit turned either$"):
        lay_out(Board("tag36h11", 0.03, Grid(8, 8, 0.038)), A4, 0.005)


@pytest.mark.parametrize(
    ("tag", "pitch", "said"),
    [
        (0.03, 0.0337, "--pitch: .* got 33.7 mm"),
        (0.00159, 0.01, "--tag: expected at least 1.6 mm, .* got 1.59 mm"),
        (0.03, 0.03375, None),
        (0.0016, 0.0018, None),
    ],
)
def test_tags_too_close_or_too_small_are_refused(tag, pitch, said):
    board = Board("tag36h11", tag, Grid(3, 3, pitch))
    if said is None:
        check_gap(board)
        return
    for refuse in (check_gap, lambda board: lay_out(board, A4, 0.005)):
        with pytest.raises(InputError, match=f"^{said}"):
            refuse(board)


def test_a_list_of_tags_cannot_be_laid_out():
    with pytest.raises(InputError, match="board: expected a grid of tags, got a list of them"):
        lay_out(Board("tag36h11", 0.03, tags=(BoardTag(0, (0.0, 0.0)),)), A4, 0.005)
