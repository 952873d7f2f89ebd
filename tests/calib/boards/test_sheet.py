"""The printed board: its paths and words as PDFium reads them from the PDF, its tags as the detector sees them."""

import ctypes
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pypdfium2
import pytest
from pypdfium2 import raw

from raytwin.calib.boards.board import Board, BoardTag, Grid, read_board, tag_cells
from raytwin.calib.boards.lengths import parse_paper
from raytwin.calib.boards.sheet import Sheet, check_gap, lay_out, pdf_bytes, write_sheet
from raytwin.calib.photos.detection import detect
from raytwin.errors import InputError

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


class Words(NamedTuple):
    """A text, its ink (left, bottom, right, top) in mm, the height of its base line, the size of its letters."""

    text: str
    ink: np.ndarray
    base: float
    size: float


class Page:
    """A PDF's one page in mm from its lower left corner: of each path its rectangles (n, 4); its words."""

    def __init__(self, data: bytes) -> None:
        self.file = pypdfium2.PdfDocument(data)
        self.page = self.file[0]
        assert len(self.file) == 1
        self.size = 25.4 / 72 * np.array(self.page.get_size())
        letters = self.page.get_textpage()
        things = [raw.FPDFPage_GetObject(self.page, i) for i in range(raw.FPDFPage_CountObjects(self.page))]
        is_path = [raw.FPDFPageObj_GetType(thing) == raw.FPDF_PAGEOBJ_PATH for thing in things]
        self.paths = [rectangles(thing) for thing, path in zip(things, is_path, strict=True) if path]
        self.words = [words(thing, letters) for thing, path in zip(things, is_path, strict=True) if not path]
        *self.tags, self.bar = self.paths
        self.ink = np.concatenate([*self.paths, [w.ink for w in self.words]])

    def notes(self) -> list[Words]:
        """The last two."""
        return self.words[-2:]


def rectangles(path: Any) -> np.ndarray:
    """(n, 4) mm: left, bottom, right, top of a path's; filled whole where they overlap, without an outline."""
    mode, stroked = ctypes.c_int(), ctypes.c_int()
    raw.FPDFPath_GetDrawMode(path, mode, stroked)
    assert (mode.value, stroked.value) == (raw.FPDF_FILLMODE_WINDING, 0)
    points = []
    for i in range(raw.FPDFPath_CountSegments(path)):
        x, y = ctypes.c_float(), ctypes.c_float()
        raw.FPDFPathSegment_GetPoint(raw.FPDFPath_GetPathSegment(path, i), x, y)
        points.append((x.value, y.value))
    corners = 25.4 / 72 * np.array(points).reshape(-1, 5, 2)
    low, high = corners.min(axis=1), corners.max(axis=1)
    np.testing.assert_array_equal(np.abs(np.diff(corners, axis=1)).sum(axis=(1, 2)), 2 * (high - low).sum(axis=1))
    return np.c_[low, high]


def words(thing: Any, letters: Any) -> Words:
    text, size, matrix = (ctypes.c_ushort * 200)(), ctypes.c_float(), raw.FS_MATRIX()
    length = raw.FPDFTextObj_GetText(thing, letters, text, 400) // 2 - 1
    box = [ctypes.c_float() for _ in range(4)]
    raw.FPDFPageObj_GetBounds(thing, *box)
    raw.FPDFTextObj_GetFontSize(thing, size)
    raw.FPDFPageObj_GetMatrix(thing, matrix)
    ink, base, height = 25.4 / 72 * np.array([v.value for v in box]), 25.4 / 72 * matrix.f, 25.4 / 72 * size.value
    return Words("".join(map(chr, text[:length])).strip(), ink, base, height)


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


# ------------------------------------------------------------------------------------------------ the tags


def test_the_page_has_the_papers_exact_size_and_asks_to_be_printed_at_it(printed):
    sheet, page = printed
    assert page.size == near(1000 * np.array(sheet.paper))
    assert not raw.FPDF_VIEWERREF_GetPrintScaling(page.file)


def test_every_tag_is_read_upright_where_the_toml_says(printed):
    sheet, page = printed
    image = np.ascontiguousarray(page.page.render(scale=150 / 72, grayscale=True).to_numpy().squeeze())
    tags = detect(image, sheet.board.family)
    assert [t.id for t in tags] == sorted(sheet.board.centers())

    def place(pixels) -> np.ndarray:
        """OpenCV's pixels as mm from the paper's lower left corner, Y up. PDFium fits the page into whole pixels."""
        x, y = ((np.asarray(pixels).reshape(-1, 2) + 0.5) / image.shape[::-1] * page.size).T
        return np.stack([x, page.size[1] - y], axis=1)

    truth = 1000 * (sheet.board.points(t.id for t in tags)[:, :2] + sheet.origin)
    assert np.abs(place([t.center for t in tags]) - truth).max() < 0.1
    # Lower left, lower right, upper right, upper left of the upright tag: neither turned nor mirrored.
    square = 500 * sheet.board.tag_edge * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    assert np.abs(place([t.corners for t in tags]).reshape(-1, 4, 2) - (truth[:, None] + square)).max() < 0.1


def test_no_seam_shows_between_neighbouring_cells(printed):
    """Of n cells a side all rectangles begin and end on n + 1 numbers, the same for all, so that none is a hair off."""
    sheet, page = printed
    for tag_id, path in zip(sheet.board.centers(), page.tags, strict=True):
        n = round(1000 * sheet.board.tag_edge / bit(sheet.board))
        assert len(set(path[:, [0, 2]].ravel())) <= n + 1 == len(set(path[:, [1, 3]].ravel()))
        black = np.sum(tag_cells(sheet.board.family, tag_id) == 0)
        assert np.sum(np.prod(path[:, 2:] - path[:, :2], axis=1)) == near(black * bit(sheet.board) ** 2, 0.05)


# ------------------------------------------------------------------------------------------------ bar and notes


def test_the_bar_measures_what_it_says(printed):
    """Its ends stand upright, flush with it."""
    sheet, page = printed
    left, bottom, right, _ = line = page.bar[0]
    assert right - left == near(1000 * sheet.bar)
    assert line[3] - bottom == near(0.15)
    assert page.notes()[0].text.startswith(
        f"print at 100 %; this bar must measure {right - left:.0f} mm; X right, Y up"
    )
    assert page.bar[1] == near(np.array([left, bottom, left + 0.15, bottom + 1.8]))
    assert page.bar[2] == near(np.array([right - 0.15, bottom, right, bottom + 1.8]))


def test_the_notes_tell_the_board_and_each_id_stands_at_its_tags_lower_left(printed):
    sheet, page = printed
    grid = sheet.board.grid
    lines = page.notes()
    ids = f"ids {min(sheet.board.centers())} to {max(sheet.board.centers())}, each at its tag's lower left"
    lengths = f"tag {1000 * sheet.board.tag_edge:g} mm, pitch {1000 * grid.pitch:g} mm"
    assert lines[1].text == f"{sheet.board.family}, {ids}; {lengths}"
    assert lines[0].text.endswith(f"from the centre of tag {grid.first_id}")
    assert page.file.get_metadata_dict()["Title"] == f"raytwin board: {lines[1].text}"
    assert lines[1].base - lines[0].base == near(-2.4)
    for tag_id, path, word in zip(sheet.board.centers(), page.tags, page.words, strict=False):
        left, bottom = path[:, :2].min(axis=0)
        assert word.text == str(tag_id)
        assert left - 0.5 * word.size < word.ink[2] < left - 0.1 * word.size
        assert word.base == near(bottom - word.size, 0.1 * word.size)


# ------------------------------------------------------------------------------------------------ where all lies


def overlapping(ink: np.ndarray, other: np.ndarray) -> bool:
    return bool(((ink[:2] < other[..., 2:]) & (ink[2:] > other[..., :2])).all(axis=-1).any())


def test_nothing_is_printed_within_the_margin_or_over_something_else(printed):
    _, page = printed
    assert (page.ink[:, :2] > MARGIN - ROUNDED).all()
    assert (page.ink[:, 2:] < page.size - MARGIN + ROUNDED).all()
    black = np.concatenate(page.paths)
    assert not any(overlapping(w.ink, black) for w in page.words)
    assert not any(overlapping(a.ink, b.ink) for a, b in combinations(page.words, 2))


def test_the_board_stands_in_the_middle_with_a_bit_of_white_all_round(printed):
    """Across in the middle of the paper; in height what is left over is halved."""
    sheet, page = printed
    tags = np.concatenate(page.tags)
    left, bottom, right, top = *tags[:, :2].min(axis=0), *tags[:, 2:].max(axis=0)
    white = bit(sheet.board)
    assert left + right == near(page.size[0])
    assert bottom - page.bar[:, 3].max() == near(white)
    assert min(left, page.size[1] - top) > white
    strip = 1000 * sheet.strip[1]
    assert strip - MARGIN == near(page.size[1] - top - max(MARGIN, white))
    assert strip <= page.ink[:, 1].min() < strip + 0.5


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
        lay_out(board, paper, margin, landscape=False)
    assert (error.value.where, error.value.expected) == ("--paper", want)
    assert error.value.got == f"{1000 * paper[0]:g} mm x {1000 * paper[1]:g} mm"
    w, h = (n / 1000 + 1e-6 for n in least)
    lay_out(board, (w, h), margin, landscape=False)
    for less in ((w - 1e-5, h + 0.01), (w + 0.001, h - 1e-5)):
        with pytest.raises(InputError):
            lay_out(board, less, margin, landscape=False)


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
    assert lay_out(small, A4[::-1], 0.005, landscape=False).paper == A4
    assert lay_out(small, A4, 0.005, landscape=True).paper == A4[::-1]
    with pytest.raises(InputError, match=r"got 210 mm x 297 mm$"):
        lay_out(wide, A4, 0.005, landscape=False)
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
