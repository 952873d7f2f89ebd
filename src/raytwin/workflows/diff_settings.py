"""The settings of `raytwin.compare`, which a light install has, and the limits of `raytwin diff`."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from raytwin.errors import InputError, check_one_of
from raytwin.rungs import RUNGS

if TYPE_CHECKING:
    from raytwin.compare import Limits
    from raytwin.scene import Scene, SceneFile


@dataclass(frozen=True)
class DiffSettings:
    """How `raytwin.compare` reads two images and decides; checked when it is made.

    Without `limits`, `compare` decides: values without noise by `tolerance`, the others at `false_alarm_rate`. With
    them, they alone do (and NaN, infinity or another size fail); `warn` are limits that never fail. `part` and `layer`
    choose within EXRs. `variances` (arrays or files) and `samples` of the two images are used where they lack them;
    `noise` and the detectable biases as in `compare_images`. `scene` (one made in Python, a file or a name) and `rung`
    say what is shown, so that a failure names its cause; `renders`: how often a function is called.
    """

    part: str | None = None
    layer: str | None = None
    tolerance: float = 1e-5
    false_alarm_rate: float = 1e-3
    noise: Literal["both", "reference", "none"] = "both"
    detectable_bias: float = 0.1
    detectable_tile_bias: float | None = None
    flip: bool = False
    limits: "Limits | None" = None
    warn: "Limits | None" = None
    variances: tuple[Any, Any] = (None, None)
    samples: tuple[int, int] = (0, 0)
    scene: "Scene | SceneFile | str | Path | None" = None
    rung: str | None = None
    renders: int = 8

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < math.inf:
            raise InputError("tolerance", "a finite number > 0", self.tolerance)
        if self.rung is not None:
            check_one_of("rung", self.rung, RUNGS)


@dataclass(frozen=True)
class IdiffLimits:
    """The limits of OpenImageIO's idiff, as its options have them; what is not given is as in idiff."""

    fail: float | None = None
    fail_relative: float | None = None
    fail_percent: float | None = None
    hard_fail: float | None = None
    allow_failures: int | None = None
    warn: float | None = None
    warn_relative: float | None = None
    warn_percent: float | None = None
    hard_warn: float | None = None

    @property
    def failing(self) -> "Limits | None":
        """Return the limits that fail; None where none was given."""
        return self._limits("fail", "fail_relative", "fail_percent", "hard_fail", "allow_failures")

    @property
    def warning(self) -> "Limits | None":
        """Return the limits that only warn."""
        return self._limits("warn", "warn_relative", "warn_percent", "hard_warn")

    def _limits(self, *fields: str) -> "Limits | None":
        from raytwin.compare import Limits

        given = {}
        for name, field in zip(("error", "relative", "percent", "hard", "pixels"), fields, strict=False):
            value = getattr(self, field)
            if value is not None and not value >= 0:
                raise InputError(f"--{field.replace('_', '')}", "a number >= 0", value)
            if value is not None:
                given[name] = value
        return Limits(**given) if given else None
