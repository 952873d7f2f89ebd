"""What `raytwin needs` answers."""

from typing import Any

from raytwin.notebook import InNotebook
from raytwin.scene.record_base import Record


class Row(Record, frozen=True):
    """One way to the image. `speculation`: every n-th pixel traced. `pixels`: the share of the frame on which the error
    was taken. `error_most`: the error and two standard errors. `calls`: timed at full size; 0: scaled from less."""

    rung: str
    depth: int | None
    engine: str
    precision: int
    sampling: str
    samples: int
    speculation: int
    trim: str | None
    method: str
    error: float | None = None
    error_most: float | None = None
    pixels: float | None = None
    seconds: float | None = None
    spread: float | None = None
    calls: int = 0
    reason: str = ""


class NotNeeded(Record, frozen=True):
    """`bound`: proven, null where nothing is; `measured`: seen. Of the metric, but for the lens, which is in pixels."""

    what: str
    why: str
    bound: float | None
    measured: float | None


class Whole(Record, frozen=True):
    """The truth: `noise` is the largest error that it cannot tell from none; `beyond`: bound of what is deeper."""

    depth: int
    samples: int
    pixels: int
    noise: float
    beyond: float | None


class Needs(Record, InNotebook, frozen=True):
    """The answer; `choice` is null where none meets the tolerance or it cannot be told, and `reason` says which."""

    scene: str
    tolerance: float
    metric: str
    choice: Row | None
    rejected: tuple[Row, ...]
    not_needed: tuple[NotNeeded, ...]
    truth: Whole
    reason: str
    seconds: float

    def table(self) -> list[dict[str, Any]]:
        """Return a row per way to the image, the chosen one first: what `pandas.DataFrame` takes."""
        ways = [("cheapest", self.choice)] if self.choice else []
        return [
            {"answer": answer} | row.to_dict() for answer, row in (*ways, *(("rejected", r) for r in self.rejected))
        ]
