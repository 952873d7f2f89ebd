"""A board to print: a PDF at exact size with a ruler on it, and beside it the board's TOML."""

import os
from dataclasses import dataclass
from pathlib import Path

from raytwin import files
from raytwin.calib.boards.board import Board, Grid, tag_cells, write_board
from raytwin.errors import InputError

POINTS = 72 / 0.0254
"""A PDF's points in a metre."""

BAR, SHORTEST_BAR = 0.100, 0.020
"""Metres: the ruler's length, and its least length on narrow paper; it shrinks in steps of 10 mm."""

RULER, LINE, NOTES = 0.0070, 0.0024, 0.066
"""Metres: heights of the ruler with its numbers and of a line of text; the width that the text takes beside it."""

BELOW, BEYOND = 3 * LINE + 0.001, 0.003
"""Metres: height of the text where it stands below the ruler; how far a number reaches past the ruler's ends."""

SMALLEST_CELL = 0.0002
"""Metres: five dots of a printer with 600 dots per inch."""

TEXT = "Helvetica"
FILL_NON_ZERO = 1
"""reportlab's; its default, even-odd, leaves holes where two rectangles overlap."""


@dataclass(frozen=True)
class Sheet:
    """Where a board lies on its paper: metres from the paper's lower left corner, X right, Y up as in the board frame.

    `origin` is the centre of the grid's first tag. `strip` is the lower left corner of ruler and text, which stand
    side by side where `beside`, else one above the other.
    """

    board: Board
    paper: tuple[float, float]
    origin: tuple[float, float]
    strip: tuple[float, float]
    bar: float
    beside: bool
    inches: bool


def lay_out(
    board: Board, paper: tuple[float, float], margin: float, landscape: bool | None = None, inches: bool = False
) -> Sheet:
    """The board in the middle of the paper's free width, ruler below it; InputError where it does not fit.

    `landscape` None: upright where that fits, else turned. `margin`: blank at each edge of the paper, metres.
    """
    check_gap(board)
    low, high = sorted(paper)
    turns = {None: (paper, paper[::-1]), True: ((high, low),), False: ((low, high),)}[landscape]
    tried = [_fit(board, turn, margin, inches) for turn in turns]
    for sheet, _ in tried:
        if sheet:
            return sheet
    (_, (width, height)), (across, up) = tried[0], turns[0]
    want = f"at least {_mm(width)} x {_mm(height)} for this board, its ruler and a margin of {_mm(margin)}"
    turned = ", which does not fit turned either" * (len(tried) > 1)
    raise InputError("--paper", want, f"{_mm(across)} x {_mm(up)}{turned}")


def _fit(
    board: Board, paper: tuple[float, float], margin: float, inches: bool
) -> tuple[Sheet | None, tuple[float, float]]:
    """The sheet, None where the paper is too small; and the smallest paper that would do at this width's layout."""
    grid, ring = grid_of(board), cell(board)
    # The detector needs a cell's width of white around the outermost tags too; three digits are 1.7 sizes wide.
    blank, side = max(margin, ring), max(margin + 2 * _id_size(board), ring)
    wide, high = ((n - 1) * grid.pitch + board.tag_edge for n in (grid.columns, grid.rows))
    free = paper[0] - 2 * (margin + BEYOND)
    bar = min(BAR, int(free / 0.01 + 1e-9) * 0.01)
    beside = free >= bar + NOTES
    strip = RULER + (0 if beside else BELOW)
    needed = max(wide + 2 * side, SHORTEST_BAR + 2 * (margin + BEYOND)), blank + high + ring + strip + margin
    if paper[0] < needed[0] - 1e-9 or paper[1] < needed[1] - 1e-9:
        return None, needed
    spare = (paper[1] - needed[1]) / 2
    bottom = margin + spare
    left = (paper[0] - wide) / 2
    row_0 = bottom + strip + ring + board.tag_edge / 2 + (high - board.tag_edge if grid.order == "down" else 0)
    origin = left + board.tag_edge / 2, row_0
    notes = NOTES if beside else 0
    return Sheet(board, paper, origin, ((paper[0] - bar - notes) / 2, bottom), bar, beside, inches), needed


def grid_of(board: Board) -> Grid:
    """The board's grid: a list of tags cannot be laid out."""
    if board.grid is None:
        raise InputError("board", "a grid of tags", "a list of them")
    return board.grid


def cell(board: Board) -> float:
    """Metres: the side of a tag's bit."""
    return board.tag_edge / len(tag_cells(board.family, 0, board.border_bits))


def _id_size(board: Board) -> float:
    """Metres: the size of the ids' letters, so that three digits fit into the gap."""
    return min(0.002, 0.45 * (grid_of(board).pitch - board.tag_edge))


def check_gap(board: Board) -> None:
    """Raise InputError unless tags are big enough to print, and a bit of white lies between two of them.

    The detector takes what is white from half a bit outside the black edge; with less than a bit between two tags the
    neighbour's black edge comes into that, and the blur of lens and print closes the gap.
    """
    if cell(board) < SMALLEST_CELL:
        smallest = SMALLEST_CELL * len(tag_cells(board.family, 0, board.border_bits))
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
    with files.replacing(path) as temporary:
        temporary.write_bytes(pdf_bytes(sheet))
        write_board(toml, sheet.board, f"Printed from {path.name}, at 100 %.")
    return toml


def pdf_bytes(sheet: Sheet) -> bytes:
    """One page, black on nothing, one path for each tag; the same bytes each time."""
    from reportlab.pdfgen.canvas import Canvas  # only who prints needs it

    board, (x0, y0) = sheet.board, sheet.origin
    canvas = Canvas("", pagesize=tuple(POINTS * v for v in sheet.paper), invariant=1)
    canvas.setTitle("raytwin board: " + "; ".join(_notes(sheet)[1:]))
    # Asks viewers not to offer "fit to page" first.
    canvas.setViewerPreference("PrintScaling", "None")
    size = _id_size(board)
    for tag_id, (x, y) in board.centers().items():
        left, bottom = x0 + x - board.tag_edge / 2, y0 + y - board.tag_edge / 2
        _draw_tag(canvas, board, tag_id, left, bottom)
        # Off the corner, where gaps cross: the detector reads white beside a tag's edges, not at its corners.
        canvas.setFont(TEXT, size * POINTS)
        canvas.drawRightString((left - 0.3 * size) * POINTS, (bottom - size) * POINTS, str(tag_id))
    _draw_ruler(canvas, sheet)
    canvas.showPage()
    return canvas.getpdfdata()


def _draw_tag(canvas, board: Board, tag_id: int, left: float, bottom: float) -> None:
    """The tag's black runs as one path with shared coordinates, so that no seam shows between neighbours."""
    cells = tag_cells(board.family, tag_id, board.border_bits)
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
        f"print at 100 %; this bar must measure {_mm(sheet.bar)}",
        f"{board.family}, ids {grid.first_id} to {last}; tag {_mm(board.tag_edge)}, pitch {_mm(grid.pitch)}",
        f"X right, Y up from the centre of tag {grid.first_id}; each id at its tag's lower left",
    ]


def _draw_ruler(canvas, sheet: Sheet) -> None:
    """A bar with millimetres above it and, where wanted, inches below; then the notes, beside it or below."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    x, bottom = sheet.strip
    notes = _notes(sheet)
    line = bottom + (0 if sheet.beside else BELOW) + (0.0033 if sheet.inches else 0.0012)
    path = canvas.beginPath()
    thin = 0.00015
    _add_rectangle(path, *(POINTS * v for v in (x, line - thin / 2, x + sheet.bar, line + thin / 2)))
    marks = [
        (mm * 0.001, 0.0018 if mm % 10 == 0 else 0.0014 if mm % 5 == 0 else 0.0009)
        for mm in range(round(sheet.bar * 1000) + 1)
    ]
    if sheet.inches:
        eighths = range(int(sheet.bar / 0.0254 * 8) + 1)
        marks += [(i * 0.0254 / 8, -0.0016 if i % 8 == 0 else -0.0012 if i % 4 == 0 else -0.0007) for i in eighths]
    for at, length in marks:
        # The first and the last mark end flush with the bar, so that the whole measures its length.
        left = min(max(at - thin / 2, 0), sheet.bar - thin)
        low, high = sorted((line, line + length))
        _add_rectangle(path, *(POINTS * v for v in (x + left, low, x + left + thin, high)))
    canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_NON_ZERO)
    canvas.setFont(TEXT, 0.002 * POINTS)
    for cm in range(round(sheet.bar * 100) + 1):
        canvas.drawCentredString((x + cm * 0.01) * POINTS, (line + 0.0021) * POINTS, f"{cm * 10}" + " mm" * (cm == 0))
    for inch in range(int(sheet.bar / 0.0254) + 1 if sheet.inches else 0):
        text = f"{inch}" + " in" * (inch == 0)
        canvas.drawCentredString((x + inch * 0.0254) * POINTS, (line - 0.0032) * POINTS, text)
    left = x + sheet.bar + 0.004 if sheet.beside else x
    top = bottom + (RULER if sheet.beside else 3 * LINE)
    room = NOTES - 0.004 if sheet.beside else sheet.bar
    widest = max(stringWidth(note, TEXT, 1) for note in notes)
    canvas.setFont(TEXT, min(0.0022 * POINTS, room * POINTS / widest))
    for i, note in enumerate(notes, start=1):
        canvas.drawString(left * POINTS, (top - i * LINE + 0.0007) * POINTS, note)


def _mm(metres: float) -> str:
    return f"{metres * 1000:.6g} mm"
