"""Verdicts over time: a line of JSON per cell and run, and which cells hover near their limit or drift."""

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import scipy.stats

from raytwin import files
from raytwin.errors import InputError
from raytwin.workflows.matrix import Cell

NEAR = 0.5
"""Share of the limit from which on a cell that passes hovers."""
RECENT = 10
"""Runs within which a changed verdict makes a cell hover."""
FEWEST = 6
"""Runs below which no drift is looked for: five in a row come in order by chance once in 60 times."""
DRIFT_RATE = 0.01
"""Probability that a page names any drift where every cell's error only scatters: shared by its cells."""


class Line(msgspec.Struct, frozen=True):
    """One cell of one run."""

    made: str
    scene: str
    subject: str
    rung: str
    verdict: str
    key: str = ""
    rmse: float | None = None
    margin: float | None = None
    seconds: float | None = None


class Past(NamedTuple):
    """What a cell's history shows: `trend`: Kendall's tau of its error, where that is no chance."""

    runs: int
    verdicts: tuple[str, ...]
    hovers: str = ""
    trend: float | None = None
    median_margin: float | None = None


def read_history(path: Path) -> list[Line]:
    """The lines of the file, in its order; none where there is no file. Raises InputError for a line that is none."""
    if not path.exists():
        return []
    files.check_file(path, "a file of lines of JSON")
    found = []
    for number, line in enumerate(path.read_bytes().splitlines(), start=1):
        try:
            found.append(msgspec.json.decode(line, type=Line))
        except msgspec.DecodeError as error:
            raise InputError(f"{path}: line {number}", "a line that raytwin matrix --history wrote", error) from None
    return found


def add_to_history(path: Path, cells: Sequence[Cell]) -> list[Line]:
    """Append a line for each cell that is not there yet, and return all lines."""
    lines = read_history(path)
    there = {(line.key, line.made) for line in lines}
    new = [
        Line(c.made, c.scene, c.subject, c.rung, c.verdict, c.key, c.rmse, c.margin, c.seconds)
        for c in cells
        if (c.key, c.made) not in there
    ]
    if new:
        before = path.read_bytes() if path.exists() else b""
        text = b"".join(msgspec.json.encode(line) + b"\n" for line in new)
        if before and not before.endswith(b"\n"):
            before += b"\n"
        with files.replacing(path) as temporary:
            temporary.write_bytes(before + text)
    return [*lines, *new]


def pasts(lines: Sequence[Line]) -> dict[tuple[str, str, str], Past]:
    """(scene, subject, rung) -> what its history shows."""
    cells: dict[tuple[str, str, str], list[Line]] = {}
    for line in sorted(lines, key=lambda line: line.made):
        cells.setdefault((line.scene, line.subject, line.rung), []).append(line)
    return {cell: _past(runs, DRIFT_RATE / len(cells)) for cell, runs in cells.items()}


def _past(runs: Sequence[Line], rate: float) -> Past:
    verdicts = tuple(line.verdict for line in runs)
    margins = [line.margin for line in runs if line.margin is not None]
    median = statistics.median(margins) if margins else None
    hovers = ""
    if len(set(verdicts[-RECENT:])) > 1:
        hovers = f"its verdict has changed within {min(RECENT, len(verdicts))} runs"
    elif verdicts[-1] == "pass" and median is not None and median >= NEAR:
        hovers = f"its error is {100 * median:.0f} % of what is allowed"
    errors = [line.rmse for line in runs if line.rmse is not None]
    trend = None
    if len(errors) >= FEWEST and len(set(errors)) > 1:
        found = scipy.stats.kendalltau(range(len(errors)), errors)
        trend = float(found.statistic) if found.pvalue < rate else None
    return Past(len(runs), verdicts, hovers, trend, median)
