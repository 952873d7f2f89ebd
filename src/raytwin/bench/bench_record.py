"""What the bench writes and reads back: plain records, one JSON file."""

import os
from typing import Any

import msgspec

from raytwin import files
from raytwin.errors import InputError
from raytwin.notebook import InNotebook
from raytwin.scene.record_base import Row

ERRORS = ("rmse", "relmse", "p999_abs")
"""The metrics that a row carries: rows of compare.METRICS."""


class Measurement(Row, frozen=True):
    """One method at one size. Errors are against the converged truth of the method's own rung and sampling.

    `seconds_median`, `seconds_iqr` of the warm calls; `compile_seconds`: what only the first calls cost; `peak_mib`:
    the most memory beyond what the process held before the call; `truth_floor`: the truth's own RMSE, below which
    `rmse` tells nothing. null: not measured.
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


class Growth(Row, frozen=True):
    """Seconds of a method with so many small spheres in the picture."""

    method: str
    spheres: int
    width: int
    height: int
    seconds_median: float
    seconds_iqr: float
    compile_seconds: float


class Equal(Row, frozen=True):
    """Where a family of methods falls to one relMSE against its own rung's truth: seconds a frame, samples a pixel.

    Interpolated between two measured sample counts if `measured`, else extrapolated beyond the last one.
    """

    family: str
    truth: str
    width: int
    height: int
    relmse: float
    seconds: float
    samples: float
    measured: bool = True


class LeftOut(Row, frozen=True):
    """A method that was asked for and not measured, and why."""

    method: str
    width: int
    height: int
    why: str


class Repeats(Row, frozen=True):
    """Every timed call, in seconds, and the RMSE of its image where that was taken."""

    method: str
    width: int
    height: int
    seconds: tuple[float, ...]
    rmse: tuple[float, ...]


class Bench(Row, InNotebook, frozen=True):
    """A whole run. `repeats` is what two runs are compared by; `--json` leaves it out."""

    scene: str
    machine: dict[str, str]
    versions: dict[str, str]
    budget: float
    seconds: float
    rows: tuple[Measurement, ...]
    truths: tuple[Converged, ...] = ()
    errors: tuple[Deviation, ...] = ()
    growth: tuple[Growth, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    repeats: tuple[Repeats, ...] = ()
    equal: tuple[Equal, ...] = ()

    def table(self) -> list[dict[str, Any]]:
        """Return a row per method and size: what `pandas.DataFrame` takes."""
        return [row.to_dict() for row in self.rows]

    def __repr__(self) -> str:
        return f"<raytwin.bench of {self.scene}: {len(self.rows)} measurements, {len(self.left_out)} left out>"


def write_bench(bench: Bench, path: str | os.PathLike[str], repeats: bool = True) -> None:
    """As JSON; NaN and infinity, which JSON lacks, become null."""
    files.write_json(path, bench if repeats else msgspec.structs.replace(bench, repeats=()))


def read_bench(path: str | os.PathLike[str]) -> Bench:
    """What `write_bench` wrote. Raises InputError with the file and the field that is wrong."""
    path = files.check_file(path, "a file that `raytwin bench --save` wrote")
    try:
        data = msgspec.json.decode(path.read_bytes())
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(path, "JSON that `raytwin bench --save` wrote", error) from None
    return files.to_record(path, data, Bench)
