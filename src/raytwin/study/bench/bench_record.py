"""What the bench writes and reads back: plain records, one JSON file."""

import os
from collections.abc import Sequence
from typing import Any

from raytwin.compare import Verdict
from raytwin.notebook import InNotebook
from raytwin.scene.record_base import Row
from raytwin.scene.toml_json import write_json


class Measurement(Row, frozen=True):
    """Seconds and error of one method at one size, against the converged reference `truth` ("shadow-center").

    `seconds_median`, `seconds_iqr` of the warm calls; `compile_seconds`: what only the first call cost. `rmse`,
    `relmse` and `p999_abs` are means over the images of independent seeds, `rmse_sigma` is the standard error of the
    mean of `rmse` (None: one image). `truth_floor`: the reference's own RMSE, below which `rmse` tells nothing.
    `on_frontier`: among the methods measured against the same reference. `verdict` of the first image beside the twin
    at the method's own light level; `reason`: its first reason, in words.
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
    truth: str
    rmse: float
    rmse_sigma: float | None
    relmse: float
    p999_abs: float
    truth_floor: float
    on_frontier: bool
    verdict: Verdict
    reason: str


class Bench(Row, InNotebook, frozen=True):
    """A whole run at `sizes` (width, height).

    `rows`: each method against its own light level; `errors`: against the highest one.
    `left_out`: the methods that were not measured at some size -> why. `subjects`: the names of the methods that were
    given themselves, not by a pattern.
    """

    scene: str
    machine: dict[str, str]
    versions: dict[str, str]
    budget: float
    seconds: float
    sizes: tuple[tuple[int, int], ...]
    rows: tuple[Measurement, ...]
    errors: tuple[Measurement, ...]
    left_out: dict[str, str]
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
    write_json(path, benches[0] if len(benches) == 1 else list(benches))
