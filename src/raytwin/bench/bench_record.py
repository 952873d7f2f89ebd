"""What the bench writes and reads back: plain records, one JSON file."""

import os
from collections.abc import Sequence
from typing import Any

from raytwin import files
from raytwin.compare import Verdict
from raytwin.notebook import InNotebook
from raytwin.scene.record_base import Row

ERRORS = ("rmse", "relmse", "p999_abs")
"""The metrics that a row carries: rows of compare.METRICS."""


class Measurement(Row, frozen=True):
    """One method at one size. Errors are against the converged truth of the method's own rung and sampling.

    `seconds_median`, `seconds_iqr` of the warm calls; `compile_seconds`: what only the first calls cost; `peak_mib`:
    the most memory beyond what the process held before the call; `truth_floor`: the truth's own RMSE, below which
    `rmse` tells nothing. null: not measured. `verdict` of the first image beside the twin of the same rung; `reason`:
    its first reason, in words.
    """

    method: str
    engine: str
    precision: str
    rung: str
    trim: str | None
    speculation: int
    samples: int
    width: int
    height: int
    seconds_median: float
    seconds_iqr: float
    compile_seconds: float
    peak_mib: float | None
    rmse: float
    relmse: float
    p999_abs: float
    truth_floor: float
    on_frontier: bool
    verdict: Verdict
    reason: str


class Converged(Row, frozen=True):
    """A converged image and the noise it still has, in each metric: what a perfect method would score against it."""

    name: str
    width: int
    height: int
    samples: int
    seconds: float
    floor: dict[str, float | None]


class Deviation(Row, frozen=True):
    """One method's error against one truth, its own or another."""

    method: str
    width: int
    height: int
    truth: str
    rmse: float
    relmse: float
    p999_abs: float
    on_frontier: bool


class LeftOut(Row, frozen=True):
    """A method that was asked for and not measured, and why."""

    method: str
    width: int
    height: int
    why: str


class Bench(Row, InNotebook, frozen=True):
    """A whole run. `subjects`: the names of the methods that were given themselves, not by a pattern."""

    scene: str
    machine: dict[str, str]
    versions: dict[str, str]
    budget: float
    seconds: float
    rows: tuple[Measurement, ...]
    truths: tuple[Converged, ...] = ()
    errors: tuple[Deviation, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    subjects: tuple[str, ...] = ()

    @property
    def exit_code(self) -> int:
        """1 if a subject fails, else 2 if one is undecided or was not measured, else 0: nothing else decides."""
        verdicts = [row.verdict for row in self.rows if row.method in self.subjects]
        if "fail" in verdicts:
            return 1
        measured = {row.method for row in self.rows}
        return 2 if "undecided" in verdicts or not measured.issuperset(self.subjects) else 0

    def table(self) -> list[dict[str, Any]]:
        """Return a row per method and size: what `pandas.DataFrame` takes."""
        return [row.to_dict() for row in self.rows]

    def __repr__(self) -> str:
        return f"<raytwin.bench of {self.scene}: {len(self.rows)} measurements, {len(self.left_out)} left out>"


def write_bench(benches: Sequence[Bench], path: str | os.PathLike[str]) -> None:
    """As JSON: one scene's result, or a list of several; NaN and infinity, which JSON lacks, become null."""
    files.write_json(path, benches[0] if len(benches) == 1 else list(benches))
