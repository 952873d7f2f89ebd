"""The printed board: the page and its text as PDFium gives them, its tags as the detector sees them."""

from typing import Any

import numpy as np
import pypdfium2
import pytest
from pypdfium2 import raw

from raytwin.errors import InputError
from raytwin.photos.boards.board import Board, Grid, read_board, tag_cells
from raytwin.photos.boards.sheet import pdf_bytes, write_sheet
from raytwin.photos.camera.detection import detect

BOARDS = {
    "the default one, on letter": (Board("tag36h11", 0.030, Grid(5, 7, 0.038)), "letter", (215.9, 279.4)),
    "turned, the last id, the smallest gap": (Board("tag36h11", 0.03, Grid(8, 4, 0.03375, 555)), "a4", (297, 210)),
}
DEFAULT = BOARDS["the default one, on letter"][0]


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

    def box(self, bottom: float, top: float) -> np.ndarray:
        """Left, bottom, right, top of what is black between two heights, mm."""
        at = self.place(np.argwhere(self.grey < 128)[:, ::-1])
        at = at[(at[:, 1] > bottom) & (at[:, 1] < top)]
        return np.array([*at.min(axis=0), *at.max(axis=0)])


@pytest.fixture(scope="module", params=BOARDS)
def printed(request) -> tuple[Board, Page, np.ndarray, tuple[float, float]]:
    """A board, its page, where its (0, 0) lies on the page in mm, and the size of the paper in mm."""
    board, paper, size = BOARDS[request.param]
    page = Page(pdf_bytes(board, paper))
    tags = {tag.id: tag for tag in detect(page.grey, board.family)}
    return board, page, page.place(tags[board.grid.first_id].center)[0], size


def test_every_tag_is_read_upright_where_the_toml_says(printed):
    board, page, origin, _ = printed
    tags = detect(page.grey, board.family)
    assert [t.id for t in tags] == sorted(board.centers())
    truth = 1000 * board.points(t.id for t in tags)[:, :2] + origin
    assert np.abs(page.place([t.center for t in tags]) - truth).max() < 0.1
    # Lower left, lower right, upper right, upper left of the upright tag: neither turned nor mirrored.
    square = 500 * board.tag_edge * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    assert np.abs(page.place([t.corners for t in tags]).reshape(-1, 4, 2) - (truth[:, None] + square)).max() < 0.1


def test_no_seam_shows_between_neighbouring_black_cells(printed):
    """A dot on both sides as well: rounding decides in which of them a seam would lie."""
    board, page, origin, _ = printed
    for tag_id, center in board.centers().items():
        black = tag_cells(board.family, tag_id)[::-1] == 0
        side, corner = 1000 * board.tag_edge / len(black), origin + 1000 * np.array(center) - 500 * board.tag_edge
        for axis, both in enumerate((black[:, 1:] & black[:, :-1], black[1:] & black[:-1])):
            ahead = np.eye(2)[axis]
            border = corner + side * (np.argwhere(both)[:, ::-1] + 0.5 + ahead / 2)
            for d in (-1, 0, 1):
                x, y = ((border + ahead * d / page.dots) * [1, -1] + [0, page.size[1]]).T * page.dots[:, None]
                assert page.grey[y.astype(int), x.astype(int)].max() < 10


def test_the_page_has_the_papers_size_a_bar_of_100_mm_and_white_round_the_board(printed):
    board, page, origin, size = printed
    assert page.size == pytest.approx(size, abs=1e-3)
    assert not raw.FPDF_VIEWERREF_GetPrintScaling(page.file)
    low = origin[1] - 500 * board.tag_edge
    foot = low - 30 / 8 - 7  # a bit of white, then 7 mm for the bar and the notes
    left, _, right, top = page.box(foot + 5.1, low - 0.2)
    assert (right - left, left + right, top) == pytest.approx((100, size[0], foot + 7), abs=0.2)
    left, bottom, right, top = page.box(0, size[1])
    assert left + right == pytest.approx(size[0], abs=0.2)
    assert min(left, bottom, size[0] - right, size[1] - top) > 5 - 0.1
    assert foot - 5 == pytest.approx(size[1] - top - 5, abs=0.2)
    how, about = page.text.splitlines()
    first, last = min(board.centers()), max(board.centers())
    assert how == f"print at 100 %; this bar must measure 100 mm; X right, Y up from the centre of tag {first}"
    assert about == f"tag36h11, ids {first} to {last}, tag 30 mm, pitch {1000 * board.grid.pitch:g} mm"
    assert page.file.get_metadata_dict()["Title"] == f"raytwin board: {about}"


def test_of_pdf_and_toml_both_are_written_or_neither(tmp_path):
    toml = write_sheet(tmp_path / "new" / "board.PDF", DEFAULT, "letter")
    assert sorted(p.name for p in toml.parent.iterdir()) == ["board.PDF", "board.toml"]
    assert read_board(toml) == DEFAULT
    assert toml.read_text().startswith("# Printed from board.PDF, at 100 %.\n")
    (tmp_path / "board.toml").mkdir()
    with pytest.raises(InputError):
        write_sheet(tmp_path / "board.pdf", DEFAULT, "letter")
    for name, got in (("board.txt", r"\.txt"), ("board", "no ending")):
        with pytest.raises(InputError, match=rf"{name}: expected a name that ends in \.pdf, got {got}"):
            write_sheet(tmp_path / name, DEFAULT, "letter")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["board.toml", "new"]


def test_boards_that_no_detector_and_no_paper_can_take_are_refused(subtests):
    """258 mm of tags need 278.75: 5 and 5 of margin, a bit of white and 7 for the bar."""
    for grid, said in (
        (Grid(3, 3, 0.0337), "--pitch: .*at least 33.75 mm.* got 33.7 mm"),
        (Grid(5, 7, 0.03811), "--paper: .* got letter, too small for 192.44 mm x 279.41 mm"),
        (Grid(8, 6, 0.038), "--paper: .* got letter, too small for 306 mm x 240.75 mm"),
    ):
        with subtests.test(said), pytest.raises(InputError, match=f"^{said}"):
            pdf_bytes(Board("tag36h11", 0.03, grid), "letter")
