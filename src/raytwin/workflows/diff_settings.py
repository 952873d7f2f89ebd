"""The settings of `raytwin.compare`, which a light install has."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from raytwin.errors import InputError, check_one_of
from raytwin.rungs import RUNGS

if TYPE_CHECKING:
    from raytwin.scene import Scene, SceneFile


@dataclass(frozen=True)
class DiffSettings:
    """How `raytwin.compare` reads two images and decides; checked when it is made.

    Values without noise may differ by `tolerance`; the others are tested at `false_alarm_rate`. `part` and `layer`
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
    variances: tuple[Any, Any] = (None, None)
    samples: tuple[int, int] = (0, 0)
    scene: "Scene | SceneFile | str | Path | None" = None
    rung: str | None = None
    renders: int = 8

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < math.inf:
            raise InputError("tolerance", "a finite number > 0", self.tolerance)
        if min(self.samples) < 0:
            raise InputError("samples", "numbers of rays per pixel, or 0 if unknown", self.samples)
        if self.rung is not None:
            check_one_of("rung", self.rung, RUNGS)
