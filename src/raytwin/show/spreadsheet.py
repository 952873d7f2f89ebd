"""Rows as CSV, in which no cell is taken for a formula."""

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from raytwin.safe_write import write_text


def write_csv(path: Path, rows: Iterable[Sequence[str]]) -> None:
    """Write a line per row; a cell's line ends become blanks."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([tame(" ".join(cell.split())) for cell in row] for row in rows)
    write_text(path, text.getvalue())


def tame(cell: str) -> str:
    """Put an apostrophe before what a spreadsheet takes for a formula; numbers stay as they are.

    >>> tame("=1+1"), tame("-2.5"), tame("@x"), tame("Ada")
    ("'=1+1", '-2.5', "'@x", 'Ada')
    """
    return f"'{cell}" if cell[:1] in ("=", "+", "-", "@", "\t", "\r") and not _is_number(cell) else cell


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False
