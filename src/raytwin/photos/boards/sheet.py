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

TICK, LINE, STRIP = 0.0018, 0.0024, 0.0070
"""Metres: heights of the bar's ends, of a line of text, and of the bar with two lines below it."""

SMALLEST_CELL = 0.0002
"""Metres: five dots of a printer with 600 dots per inch."""

TEXT = "Helvetica"
FILL_NON_ZERO = 1
"""reportlab's; its default, even-odd, leaves holes where two rectangles overlap."""


@dataclass(frozen=True)
class Sheet:
    """Where a board lies on its paper: metres from the paper's lower left corner, X right, Y up as in the board frame.

    `origin` is the centre of the grid's first tag. `strip` is the lower left corner of what stands below the board: the
    bar of length `bar`, and notes as wide as the paper without its margins.
    """

    board: Board
    paper: tuple[float, float]
    origin: tuple[float, float]
    strip: tuple[float, float]
    bar: float


def lay_out(board: Board, paper: tuple[float, float], margin: float) -> Sheet:
    """The board in the middle of the paper's free width, a bar to measure below it; InputError where it does not fit.

    The paper is turned where that alone fits. `margin`: blank at each edge of the paper, metres.
    """
    check_gap(board)
    width, height = _needed(board, margin)
    for across, up in (paper, paper[::-1]):
        if across >= width - 1e-9 and up >= height - 1e-9:
            return _placed(board, (across, up), margin, (up - height) / 2)
    want = f"at least {_mm(width)} x {_mm(height)} for this board, its bar and a margin of {_mm(margin)}"
    raise InputError("--paper", want, f"{_mm(paper[0])} x {_mm(paper[1])}, which does not fit turned either")


def _needed(board: Board, margin: float) -> tuple[float, float]:
    """The smallest paper that would do."""
    grid, ring = grid_of(board), cell(board)
    # The detector needs a cell's width of white around the outermost tags too; three digits are 1.7 sizes wide.
    blank, side = max(margin, ring), max(margin + 2 * _id_size(board), ring)
    wide, high = ((n - 1) * grid.pitch + board.tag_edge for n in (grid.columns, grid.rows))
    return max(wide + 2 * side, SHORTEST_BAR + 2 * margin), blank + high + ring + STRIP + margin


def _placed(board: Board, paper: tuple[float, float], margin: float, spare: float) -> Sheet:
    grid, half = grid_of(board), board.tag_edge / 2
    bar = min(BAR, int((paper[0] - 2 * margin) / 0.01 + 1e-9) * 0.01)
    bottom = margin + spare
    row_0 = bottom + STRIP + cell(board) + half + ((grid.rows - 1) * grid.pitch if grid.order == "down" else 0)
    origin = (paper[0] - (grid.columns - 1) * grid.pitch) / 2, row_0
    return Sheet(board, paper, origin, (margin, bottom), bar)


def grid_of(board: Board) -> Grid:
    """The board's grid: a list of tags cannot be laid out."""
    if board.grid is None:
        raise InputError("board", "a grid of tags", "a list of them")
    return board.grid


def cell(board: Board) -> float:
    """Metres: the side of a tag's bit."""
    return board.tag_edge / len(tag_cells(board.family, 0))


def _id_size(board: Board) -> float:
    """Metres: the size of the ids' letters, so that three digits fit into the gap."""
    return min(0.002, 0.45 * (grid_of(board).pitch - board.tag_edge))


def check_gap(board: Board) -> None:
    """Raise InputError unless tags are big enough to print, and a bit of white lies between two of them.

    The detector takes what is white from half a bit outside the black edge; with less than a bit between two tags the
    neighbour's black edge comes into that, and the blur of lens and print closes the gap.
    """
    if cell(board) < SMALLEST_CELL:
        smallest = SMALLEST_CELL * len(tag_cells(board.family, 0))
        raise InputError("--tag", f"at least {_mm(smallest)}, so that a printer can draw its bits", _mm(board.tag_edge))
    least = board.tag_edge + cell(board)
    if grid_of(board).pitch < least - 1e-9:
        want = f"at least {_mm(least)}: the tag and one of its bits of white, which the detector needs"
        raise InputError("--pitch", want, _mm(grid_of(board).pitch))


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

    board, (x0, y0) = sheet.board, sheet.origin
    canvas = Canvas("", pagesize=tuple(POINTS * v for v in sheet.paper), invariant=1)
    canvas.setTitle("raytwin board: " + _notes(sheet)[1])
    # Asks viewers not to offer "fit to page" first.
    canvas.setViewerPreference("PrintScaling", "None")
    size = _id_size(board)
    for tag_id, (x, y) in board.centers().items():
        left, bottom = x0 + x - board.tag_edge / 2, y0 + y - board.tag_edge / 2
        _draw_tag(canvas, board, tag_id, left, bottom)
        # Off the corner, where gaps cross: the detector reads white beside a tag's edges, not at its corners.
        canvas.setFont(TEXT, size * POINTS)
        canvas.drawRightString((left - 0.3 * size) * POINTS, (bottom - size) * POINTS, str(tag_id))
    _draw_bar(canvas, sheet)
    canvas.showPage()
    return canvas.getpdfdata()


def _draw_tag(canvas, board: Board, tag_id: int, left: float, bottom: float) -> None:
    """The tag's black runs as one path with shared coordinates, so that no seam shows between neighbours."""
    cells = tag_cells(board.family, tag_id)
    n = len(cells)
    xs = [POINTS * (left + board.tag_edge * i / n) for i in range(n + 1)]
    ys = [POINTS * (bottom + board.tag_edge * i / n) for i in range(n, -1, -1)]
    path = canvas.beginPath()
    for row in range(n):
        edges = [i for i in range(n + 1) if (i < n and cells[row, i] == 0) != (i > 0 and cells[row, i - 1] == 0)]
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            _add_rectangle(path, xs[a], ys[row + 1], xs[b], ys[row])
    canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_NON_ZERO)


def _add_rectangle(path, left: float, bottom: float, right: float, top: float) -> None:
    # Corners, not width and height: a sum would round to another number than the neighbour's corner.
    path.moveTo(left, bottom)
    path.lineTo(right, bottom)
    path.lineTo(right, top)
    path.lineTo(left, top)
    path.close()


def _notes(sheet: Sheet) -> list[str]:
    board, grid = sheet.board, grid_of(sheet.board)
    last = grid.first_id + grid.columns * grid.rows - 1
    return [
        f"print at 100 %; this bar must measure {_mm(sheet.bar)}; X right, Y up from the centre of tag {grid.first_id}",
        f"{board.family}, ids {grid.first_id} to {last}, each at its tag's lower left; tag {_mm(board.tag_edge)}, "
        f"pitch {_mm(grid.pitch)}",
    ]


def _draw_bar(canvas, sheet: Sheet) -> None:
    """A line with an upright at each end, flush with it, so that the whole measures its length; the notes below."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    x, line, thin = (sheet.paper[0] - sheet.bar) / 2, sheet.strip[1] + STRIP - TICK, 0.00015
    path = canvas.beginPath()
    for left, right, top in ((0, sheet.bar, thin), (0, thin, TICK), (sheet.bar - thin, sheet.bar, TICK)):
        _add_rectangle(path, *(POINTS * v for v in (x + left, line, x + right, line + top)))
    canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_NON_ZERO)
    notes = _notes(sheet)
    widest = max(stringWidth(note, TEXT, 1) for note in notes)
    canvas.setFont(TEXT, POINTS * min(0.0022, (sheet.paper[0] - 2 * sheet.strip[0]) / widest))
    for i, note in enumerate(notes, start=1):
        canvas.drawCentredString(sheet.paper[0] / 2 * POINTS, (line - i * LINE + 0.0003) * POINTS, note)


def _mm(metres: float) -> str:
    return f"{metres * 1000:.6g} mm"
