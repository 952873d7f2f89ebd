"""How two images are judged: one record, which every command and function that compares passes on.

Nothing here needs more than a light install has.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from raytwin.errors import InputError, check_one_of
from raytwin.rungs import RUNGS

if TYPE_CHECKING:
    from raytwin.scene import Scene, Tolerance  # with NumPy, which the command line's options need not

DETECTABLE_BIAS = 0.1
"""A pass that could have missed a relative bias of the whole image above this is undecided, unless another is asked."""


@dataclass(frozen=True)
class Judging:
    """What may differ, and what a verdict is worth; checked when it is made.

    Values without noise must meet `tolerance` (a number: its `p999_abs`); for noisy ones `false_alarm_rate` is the
    probability that two images fail that differ by noise alone. A pass that could have missed a relative bias of
    `detectable_bias` of the whole image (DETECTABLE_BIAS), or of `detectable_tile_bias` of 24 x 24 pixels anywhere (any
    size), is undecided instead. `noise="reference"` ignores the variance that the test claims; "none" takes both images
    for noise-free, as for a tracer with one ray per pixel.
    """

    tolerance: "Tolerance | float" = 1e-5
    false_alarm_rate: float = 1e-3
    noise: Literal["both", "reference", "none"] = "both"
    detectable_bias: float | None = None
    detectable_tile_bias: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.tolerance, int | float) and not 0 < self.tolerance < math.inf:
            raise InputError("tolerance", "a finite number > 0", self.tolerance)
        if not 0 < self.false_alarm_rate < 1:
            raise InputError("false_alarm_rate", "a probability between 0 and 1", self.false_alarm_rate)
        if self.noise not in ("both", "reference", "none"):
            raise InputError("noise", "both, reference or none", self.noise)
        for name in ("detectable_bias", "detectable_tile_bias"):
            bias = getattr(self, name)
            if bias is not None and not bias > 0:
                raise InputError(name, "a number > 0", bias)

    @property
    def bounds(self) -> "Tolerance":
        """The tolerance of values without noise."""
        from raytwin.scene import Tolerance

        return self.tolerance if isinstance(self.tolerance, Tolerance) else Tolerance(p999_abs=self.tolerance)

    @property
    def detectable(self) -> tuple[float, float]:
        """The biases of the whole image, and of 24 x 24 pixels, that a pass must not have missed."""
        image, tile = self.detectable_bias, self.detectable_tile_bias
        return DETECTABLE_BIAS if image is None else image, math.inf if tile is None else tile


@dataclass(frozen=True)
class DiffSettings(Judging):
    """How `raytwin.compare` reads two images and judges them; checked when it is made.

    `layer` chooses within EXRs. `variances` (arrays or files) and `samples` of the two images are used where they lack
    them. `scene` (one made in Python, a file or a name) and `rung` say what is shown, so that a failure names its
    cause; `renders`: how often a function is called.
    """

    layer: str | None = None
    flip: bool = False
    variances: tuple[Any, Any] = (None, None)
    samples: tuple[int, int] = (0, 0)
    scene: "Scene | str | Path | None" = None
    rung: str | None = None
    renders: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.samples, tuple) and len(self.samples) == 2 and all(map(_is_count, self.samples))):
            expected = "rays per pixel of both images, as (4, 512); 0 if unknown"
            raise InputError("samples", expected, repr(self.samples))
        if self.rung is not None:
            check_one_of("rung", self.rung, RUNGS)

    @property
    def judging(self) -> Judging:
        return Judging(*(getattr(self, field) for field in Judging.__dataclass_fields__))


def _is_count(n: object) -> bool:
    return isinstance(n, int) and n >= 0
