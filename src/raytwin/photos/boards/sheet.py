"""A board to print: a PDF at exact size with a bar to measure on it, and beside it the board's TOML."""

import os
from dataclasses import dataclass
from pathlib import Path

from raytwin.errors import InputError
from raytwin.photos.boards.board import Board, Grid, tag_cells, write_board
from raytwin.safe_write import replacing

POINTS = 72 / 0.0254
"""A PDF's points in a metre."""

BAR, SHORTEST_BAR = 0.100, 0.020
"""Metres: length of the bar to measure, and its least length on narrow paper; it shrinks in steps of 10 mm."""

MARGIN = 0.005
"""Metres: blank at each edge of the paper, as most printers need it."""

TICK, THIN, LINE, STRIP = 0.0018, 0.00015, 0.0024, 0.0070
"""Metres: height and width of the bar's strokes, height of a line of text, and of the bar with two lines below it."""

SMALLEST_CELL = 0.0002
"""Metres: five dots of a printer with 600 dots per inch."""

TEXT = "Helvetica"
FILL_NON_ZERO = 1
"""reportlab's; its default, even-odd, leaves holes where two rectangles overlap."""


@dataclass(frozen=True)
class Sheet:
    """Where a board lies on its paper: metres from the paper's lower left corner, X right, Y up as in the board frame.

    `origin` is the centre of the grid's first tag. What stands below the board, the bar of length `bar` and two notes,
    has its lower edge at `bottom`.
    """

    board: Board
    grid: Grid
    paper: tuple[float, float]
    origin: tuple[float, float]
    bottom: float
    bar: float


def lay_out(board: Board, paper: tuple[float, float]) -> Sheet:
    """The board in the middle of the paper, a bar to measure below it; InputError where it does not fit.

    The paper is turned where that alone fits.
    """
    grid, ring = check_gap(board), cell(board)
    across, up = ((n - 1) * grid.pitch for n in (grid.columns, grid.rows))
    # The detector needs a cell's width of white around the outermost tags too.
    blank = max(MARGIN, ring)
    wide = max(across + board.tag_edge + 2 * blank, SHORTEST_BAR + 2 * MARGIN)
    high = blank + up + board.tag_edge + ring + STRIP + MARGIN
    fits = [p for p in (paper, paper[::-1]) if p[0] >= wide - 1e-9 and p[1] >= high - 1e-9]
    if not fits:
        want = f"at least {_mm(wide)} x {_mm(high)} for this board, its bar and a margin of {_mm(MARGIN)}"
        raise InputError("--paper", want, f"{_mm(paper[0])} x {_mm(paper[1])}, which does not fit turned either")
    bottom = MARGIN + (fits[0][1] - high) / 2
    row_0 = bottom + STRIP + ring + board.tag_edge / 2 + (up if grid.order == "down" else 0)
    bar = min(BAR, int((fits[0][0] - 2 * MARGIN) / 0.01 + 1e-9) * 0.01)
    return Sheet(board, grid, fits[0], ((fits[0][0] - across) / 2, row_0), bottom, bar)


def cell(board: Board) -> float:
    """Metres: the side of a tag's bit."""
    return board.tag_edge / len(tag_cells(board.family, 0))


def check_gap(board: Board) -> Grid:
    """The board's grid; InputError unless it can be printed, with a bit of white between two tags.

    The detector takes what is white from half a bit outside the black edge; with less than a bit between two tags the
    neighbour's black edge comes into that, and the blur of lens and print closes the gap.
    """
    if board.grid is None:
        raise InputError("board", "a grid of tags", "a list of them")
    if cell(board) < SMALLEST_CELL:
        smallest = SMALLEST_CELL * board.tag_edge / cell(board)
        raise InputError("--tag", f"at least {_mm(smallest)}, so that a printer can draw its bits", _mm(board.tag_edge))
    least = board.tag_edge + cell(board)
    if board.grid.pitch < least - 1e-9:
        want = f"at least {_mm(least)}: the tag and one of its bits of white, which the detector needs"
        raise InputError("--pitch", want, _mm(board.grid.pitch))
    return board.grid


def write_sheet(path: str | os.PathLike, sheet: Sheet) -> Path:
    """The sheet as a PDF at `path`, and the board as TOML beside it, whose path is returned: both, or neither."""
    path = Path(path)
    if path.suffix.lower() != ".pdf":
        raise InputError(path, "a name that ends in .pdf", path.suffix or "no ending")
    toml = path.with_suffix(".toml")
    with replacing(path) as temporary:
        temporary.write_bytes(pdf_bytes(sheet))
        write_board(toml, sheet.board, f"Printed from {path.name}, at 100 %.")
    return toml


def pdf_bytes(sheet: Sheet) -> bytes:
    """One page, black on nothing, one path for each tag; the same bytes each time."""
    from reportlab.pdfgen.canvas import Canvas  # only who prints needs it

    board, grid, (x0, y0) = sheet.board, sheet.grid, sheet.origin
    last = grid.first_id + grid.columns * grid.rows - 1
    lengths = f"tag {_mm(board.tag_edge)}, pitch {_mm(grid.pitch)}"
    about = f"{board.family}, ids {grid.first_id} to {last}, {lengths}"
    canvas = Canvas("", pagesize=tuple(POINTS * v for v in sheet.paper), invariant=1)
    canvas.setTitle(f"raytwin board: {about}")
    # Asks viewers not to offer "fit to page" first.
    canvas.setViewerPreference("PrintScaling", "None")
    for tag_id, (x, y) in board.centers().items():
        _draw_tag(canvas, board, tag_id, x0 + x - board.tag_edge / 2, y0 + y - board.tag_edge / 2)
    _draw_bar(canvas, sheet, about)
    canvas.showPage()
    return canvas.getpdfdata()


def _draw_tag(canvas, board: Board, tag_id: int, left: float, bottom: float) -> None:
    """The tag's black cells as one path with shared coordinates, so that no seam shows between neighbours."""
    cells = tag_cells(board.family, tag_id)
    side = [board.tag_edge * i / len(cells) for i in range(len(cells) + 1)]
    xs, ys = [POINTS * (left + v) for v in side], [POINTS * (bottom + v) for v in reversed(side)]
    path = canvas.beginPath()
    for row, column in zip(*(cells == 0).nonzero(), strict=True):
        # Corners, not width and height: a sum would round to another number than the neighbour's corner.
        path.moveTo(xs[column], ys[row])
        for i, j in ((1, 0), (1, 1), (0, 1)):
            path.lineTo(xs[column + i], ys[row + j])
        path.close()
    canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_NON_ZERO)


def _draw_bar(canvas, sheet: Sheet, about: str) -> None:
    """A line with an upright at each end, flush with it, so that the whole measures its length; the notes below."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    x, line = (sheet.paper[0] - sheet.bar) / 2, sheet.bottom + STRIP - TICK
    for left, width, height in ((0, sheet.bar, THIN), (0, THIN, TICK), (sheet.bar - THIN, THIN, TICK)):
        canvas.rect(*(POINTS * v for v in (x + left, line, width, height)), stroke=0, fill=1)
    how = f"print at 100 %; this bar must measure {_mm(sheet.bar)}"
    notes = f"{how}; X right, Y up from the centre of tag {sheet.grid.first_id}", about
    widest = max(stringWidth(note, TEXT, 1) for note in notes)
    canvas.setFont(TEXT, POINTS * min(0.0022, (sheet.paper[0] - 2 * MARGIN) / widest))
    for i, note in enumerate(notes, start=1):
        canvas.drawCentredString(sheet.paper[0] / 2 * POINTS, (line - i * LINE + 0.0003) * POINTS, note)


def _mm(metres: float) -> str:
    return f"{metres * 1000:.6g} mm"
