"""A board to print: a PDF at exact size with a bar to measure on it, and beside it the board's TOML."""

import os
from pathlib import Path

import numpy as np
from scipy.spatial.distance import pdist

from raytwin.errors import InputError
from raytwin.photos.boards.board import Board, tag_cells, write_board
from raytwin.safe_write import replacing

PAPERS = {"a4": (0.210, 0.297), "letter": (0.2159, 0.2794)}
"""Width and height, metres, upright."""

POINTS = 72 / 0.0254
"""PDF points per metre."""

MARGIN, FOOT = 0.005, 0.007
"""Metres: blank at each edge of the paper, as most printers need it; height of the bar with the two notes below it."""

BAR, BAR_HEIGHT = 0.100, 0.0018
"""Metres: size of the bar to measure."""

NOTE_POINTS = 6
"""Font size of the notes."""

FILL_NON_ZERO = 1
"""reportlab's fill mode without holes where two rectangles touch."""


def write_sheet(path: str | os.PathLike, board: Board, paper: str) -> Path:
    """Write the board as a PDF to `path` and as TOML beside it, whose path is returned: both, or neither."""
    path = Path(path)
    if path.suffix.lower() != ".pdf":
        raise InputError(path, "a name that ends in .pdf", path.suffix or "no ending")
    toml = path.with_suffix(".toml")
    with replacing(path) as temporary:
        temporary.write_bytes(pdf_bytes(board, paper))
        write_board(toml, board, f"Printed from {path.name}, at 100 %.")
    return toml


def pdf_bytes(board: Board, paper: str) -> bytes:
    """Draw a grid of tags in the middle of one page: upright paper, or turned if it fits only so.

    Raises InputError for a board that does not fit the paper, or whose tags are too close for the detector.
    """
    from reportlab.pdfgen.canvas import Canvas  # only who prints needs it

    ids, xy, edge = board.centers().keys(), np.array([*board.centers().values()]), board.tag_edge
    cell, pitch = edge / len(tag_cells(board.family, min(ids))), pdist(xy, "chebyshev").min()
    if pitch < edge + cell - 1e-9:
        want = f"at least {_mm(edge + cell)}: the tag and one of its bits of white, which the detector needs"
        raise InputError("--pitch", want, _mm(pitch))
    low, high = xy.min(axis=0) - edge / 2, xy.max(axis=0) + edge / 2
    blank, below = max(MARGIN, cell), MARGIN + FOOT + cell
    least = high - low + (2 * blank, blank + below)
    sizes = [size for size in (PAPERS[paper], PAPERS[paper][::-1]) if (size >= least - 1e-9).all()]
    if not sizes:
        got = f"{paper}, too small for {_mm(least[0])} x {_mm(least[1])}: this board, its bar and its margins"
        raise InputError("--paper", "paper that holds the board, turned or not", got)
    width, height = sizes[0]
    foot = MARGIN + (height - least[1]) / 2
    origin = np.array([(width - low[0] - high[0]) / 2, foot + FOOT + cell - low[1]])
    about = f"{board.family}, ids {min(ids)} to {max(ids)}, tag {_mm(edge)}, pitch {_mm(pitch)}"
    how = f"print at 100 %; this bar must measure {_mm(BAR)}; X right, Y up from the centre of tag {min(ids)}"
    canvas = Canvas("", pagesize=(POINTS * width, POINTS * height))
    canvas.setTitle(f"raytwin board: {about}")
    # Asks viewers not to offer "fit to page" first.
    canvas.setViewerPreference("PrintScaling", "None")
    for tag_id, center in board.centers().items():
        tag = canvas.beginPath()
        left, bottom = origin + center - edge / 2
        for row, column in np.argwhere(tag_cells(board.family, tag_id)[::-1] == 0):
            tag.rect(*(POINTS * np.array([left + column * cell, bottom + row * cell, cell, cell])))
        canvas.drawPath(tag, stroke=0, fill=1, fillMode=FILL_NON_ZERO)
    bar = np.array([(width - BAR) / 2, foot + FOOT - BAR_HEIGHT, BAR, BAR_HEIGHT])
    canvas.rect(*(POINTS * bar), stroke=0, fill=1)
    canvas.setFont("Helvetica", NOTE_POINTS)
    for i, note in enumerate((how, about), start=1):
        canvas.drawCentredString(POINTS * width / 2, POINTS * bar[1] - i * NOTE_POINTS, note)
    canvas.showPage()
    return canvas.getpdfdata()


def _mm(metres: float) -> str:
    return f"{metres * 1000:.6g} mm"
