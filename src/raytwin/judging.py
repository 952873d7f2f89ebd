"""How two images are judged: one record, which every command and function that compares passes on."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from raytwin.errors import InputError

if TYPE_CHECKING:
    from raytwin.scene import Tolerance  # with NumPy, which the command line's options need not

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
