"""A Comparison, what was compared, and what each stage cost: the keys of comparison.json."""

from typing import Any

import msgspec

from raytwin.compare.comparison import Comparison
from raytwin.scene import Record

STAGES = ("calibrate", "tracer", "twin", "compare")
"""The stages that comparison.json always names, null where one was not run."""


class Part(Record, frozen=True):
    """A row of the ledger: one named part of the error against the whole light.

    `seconds`: per frame, on the cheapest rung that has it. `share_of_light`: its mean divided by that of all light,
    signed: less than 0 where light is missing. `share_of_error`: its correlation with the whole error over that error's
    square; all add up to 1. `noise`: the rms standard error of the part, where it was sampled.
    """

    part: str
    rmse: float | None = None
    seconds: float | None = None
    share_of_light: float | None = None
    share_of_error: float | None = None
    noise: float | None = None


class Report(Record, frozen=True):
    """`comparison` of `scene` at `rung`, the seconds of every stage by name, and what computed them (`backend`).

    `rung` and `ledger` are None where nothing is known of the scene's light: a Mitsuba file.
    """

    scene: str
    rung: str | None
    comparison: Comparison
    seconds: dict[str, float] = msgspec.field(default_factory=dict)
    backend: dict[str, Any] = msgspec.field(default_factory=dict)
    ledger: tuple[Part, ...] | None = ()

    def saying(self, *further: str) -> "Report":
        """The same with further reasons, behind the others."""
        return msgspec.structs.replace(self, comparison=self.comparison.saying(*further))

    def numbers(self) -> dict[str, Any]:
        """What comparison.json holds, in its order."""
        about: dict[str, Any] = {"scene": self.scene, "rung": self.rung}
        made = msgspec.structs.asdict(self.comparison)
        own, *_ = (made.pop(key) for key in ("seconds", "failing", "excluded_bias", "findings"))
        about |= {"verdict": made.pop("verdict"), "reasons": self.comparison.reasons}
        seconds = {stage: self.seconds.get(stage, own if stage == "compare" else None) for stage in STAGES}
        return about | made | {"ledger": self.ledger, "seconds": seconds, "backend": self.backend}
