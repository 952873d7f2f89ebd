"""The printed board: the page and its text as PDFium gives them, its tags as the detector sees them."""

from typing import Any

import numpy as np
import pypdfium2
import pytest
from pypdfium2 import raw

from raytwin.errors import InputError
from raytwin.photos.boards.board import Board, BoardTag, Grid, read_board, tag_cells
from raytwin.photos.boards.lengths import parse_paper
from raytwin.photos.boards.sheet import Sheet, lay_out, pdf_bytes, write_sheet
from raytwin.photos.camera.detection import detect

LETTER, A4 = parse_paper("letter", ""), parse_paper("a4", "")
ROUNDED = 1e-3
"""mm: PDFium's numbers are float32, of points up to 850; reportlab writes six digits."""

BOARDS = {
    "the task's, on letter": (Board("tag36h11", 0.030, Grid(5, 7, 0.038)), LETTER),
    "turned, up to the last id, the smallest gap": (Board("tag36h11", 0.030, Grid(8, 4, 0.03375, 555)), A4),
    "counted downwards": (Board("tag25h9", 0.02, Grid(2, 3, 0.025, 3, "down")), (0.1, 0.13)),
}
TASK = BOARDS["the task's, on letter"][0]


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
        at = self.place(np.stack([columns, rows], axis=1))
        at = at[(at[:, 1] > bottom) & (at[:, 1] < top)]
        return np.array([*at.min(axis=0), *at.max(axis=0)])


@pytest.fixture(scope="module", params=BOARDS)
def printed(request) -> tuple[Sheet, Page]:
    sheet = lay_out(*BOARDS[request.param])
    return sheet, Page(pdf_bytes(sheet))


def bit(board: Board) -> float:
    """mm: a family's name counts its bits without the border."""
    return 1000 * board.tag_edge / {"tag36h11": 8, "tag25h9": 7, "tag16h5": 6}[board.family]


def near(value: Any, within: float = ROUNDED) -> Any:
    return pytest.approx(value, abs=within)


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
        up = 1000 * np.array(center) + corner + side * np.stack([column + 0.5, row + 1], axis=1)
        row, column = np.nonzero(black[:, 1:] & black[:, :-1])
        aside = 1000 * np.array(center) + corner + side * np.stack([column + 1, row + 0.5], axis=1)
        # A dot on both sides as well: rounding decides in which of them a seam would lie.
        for d in (-1, 0, 1):
            assert page.at(up + np.array([0, d / page.dots[1]])).max() < 10
            assert page.at(aside + np.array([d / page.dots[0], 0])).max() < 10


def test_the_page_has_the_papers_size_and_a_bar_that_measures_what_the_notes_say(printed):
    sheet, page = printed
    assert page.size == near(1000 * np.array(sheet.paper))
    assert not raw.FPDF_VIEWERREF_GetPrintScaling(page.file)
    line = 1000 * (sheet.bottom + 0.0070 - 0.0018)
    left, _, right, top = page.box(line, line + 2.2)
    assert right - left == near(1000 * sheet.bar, 0.2)
    assert left + right == near(page.size[0], 0.2)
    assert top - line == near(1.8, 0.2)
    ids, grid = sheet.board.centers(), sheet.grid
    how, about = page.text.splitlines()
    where = f"X right, Y up from the centre of tag {min(ids)}"
    assert how == f"print at 100 %; this bar must measure {1000 * sheet.bar:.0f} mm; {where}"
    lengths = f"tag {1000 * sheet.board.tag_edge:g} mm, pitch {1000 * grid.pitch:g} mm"
    assert about == f"{sheet.board.family}, ids {min(ids)} to {max(ids)}, {lengths}"
    assert page.file.get_metadata_dict()["Title"] == f"raytwin board: {about}"


def test_the_board_stands_in_the_middle_with_a_bit_of_white_all_round_and_nothing_in_the_margin(printed):
    """Across in the middle of the paper; in height what is left over is halved."""
    sheet, page = printed
    left, bottom, right, top = page.box(0, page.size[1])
    assert min(left, bottom) > 5 - 0.1
    assert (page.size - (right, top)).min() > 5 - 0.1
    xy, half = 1000 * (np.array([*sheet.board.centers().values()]) + sheet.origin), 500 * sheet.board.tag_edge
    low, high = xy.min(axis=0) - half, xy.max(axis=0) + half
    white, foot = bit(sheet.board), 1000 * sheet.bottom
    assert low[0] + high[0] == near(page.size[0])
    assert low[1] - (foot + 7) == near(white)
    assert foot - 5 == near(page.size[1] - high[1] - max(5, white))
    assert foot - 0.1 <= bottom < foot + 0.5


def test_the_size_that_is_asked_for_is_enough_and_less_is_not(subtests):
    for board, paper, least in (
        # 5 (4 gaps of 38 and a tag of 30 between 5 each side); 5 + 258 + a bit of 3.75 + 7 + 5.
        (TASK, (0.19, 0.27), (192, 278.75)),
        # A bar of 20 between 5 each side; 5 + 21 + 5 / 8 + 7 + 5.
        (Board("tag36h11", 0.005, Grid(1, 3, 0.008)), (0.025, 0.038), (30, 38.625)),
    ):
        with subtests.test(str(least)):
            want = f"at least {least[0]:g} mm x {least[1]:g} mm for this board, its bar and a margin of 5 mm"
            with pytest.raises(InputError) as error:
                lay_out(board, paper)
            assert (error.value.where, error.value.expected) == ("--paper", want)
            got = f"{1000 * paper[0]:g} mm x {1000 * paper[1]:g} mm, which does not fit turned either"
            assert error.value.got == got
            w, h = (n / 1000 + 1e-6 for n in least)
            lay_out(board, (w, h))
            for less in ((w - 1e-5, h + 0.001), (w + 0.001, h - 1e-5)):
                with pytest.raises(InputError):
                    lay_out(board, less)


def test_paper_is_turned_only_where_that_alone_fits_and_the_bar_shrinks_by_centimetres():
    wide, small = (Board("tag36h11", 0.03, Grid(*n, 0.038)) for n in ((6, 4), (3, 3)))
    assert (lay_out(wide, A4).paper, lay_out(small, A4).paper) == (A4[::-1], A4)
    for width, bar in ((0.1821, 100), (0.110, 100), (0.1099, 90), (0.0300, 20)):
        assert 1000 * lay_out(Board("tag36h11", 0.01, Grid(1, 1, 0.02)), (width, 0.25)).bar == near(bar), width


def test_the_toml_beside_it_is_the_board(tmp_path):
    toml = write_sheet(tmp_path / "new" / "board.PDF", lay_out(TASK, LETTER))
    assert toml == tmp_path / "new" / "board.toml"
    assert read_board(toml) == TASK
    assert sorted(p.name for p in toml.parent.iterdir()) == ["board.PDF", "board.toml"]
    assert toml.read_text().startswith("# Printed from board.PDF, at 100 %.\n")


def test_of_pdf_and_toml_both_are_written_or_neither(tmp_path):
    (tmp_path / "board.toml").mkdir()
    with pytest.raises(InputError):
        write_sheet(tmp_path / "board.pdf", lay_out(TASK, LETTER))
    for name, got in (("board.txt", r"\.txt"), ("board", "no ending")):
        with pytest.raises(InputError, match=rf"{name}: expected a name that ends in \.pdf, got {got}"):
            write_sheet(tmp_path / name, lay_out(TASK, LETTER))
    assert [p.name for p in tmp_path.iterdir()] == ["board.toml"]


def test_boards_that_no_printer_and_no_detector_can_take_are_refused(subtests):
    for board, said in (
        (Board("tag36h11", 0.03, Grid(3, 3, 0.0337)), "--pitch: .* got 33.7 mm"),
        (Board("tag36h11", 0.00159, Grid(3, 3, 0.01)), "--tag: expected at least 1.6 mm, .* got 1.59 mm"),
        (Board("tag36h11", 0.03, tags=(BoardTag(0, (0.0, 0.0)),)), "board: expected a grid of tags, got a list"),
        (Board("tag36h11", 0.03, Grid(8, 8, 0.038)), "--paper: .* got 210 mm x 297 mm"),
    ):
        with subtests.test(said), pytest.raises(InputError, match=f"^{said}"):
            lay_out(board, A4)
    for tag, pitch in ((0.03, 0.03375), (0.0016, 0.0018)):
        lay_out(Board("tag36h11", tag, Grid(3, 3, pitch)), A4)
