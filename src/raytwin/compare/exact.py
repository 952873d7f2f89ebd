"""Values without noise: how many are off by more than the tolerance, and where the worst is."""

from typing import NamedTuple

import numpy as np

from raytwin.compare.blocks import strips
from raytwin.compare.finding import CHANNELS, EXACT, Finding, at, plural
from raytwin.image import Image
from raytwin.scene import Tolerance

OUTLIER = 10.0
"""A pixel is an outlier when a value of it errs by more than this many tolerances."""


class Quiet(NamedTuple):
    """Values without noise: how many, how many beyond the tolerance, how many pixels are outliers, and the worst."""

    values: int = 0
    over: int = 0
    outliers: int = 0
    error: float = 0.0
    x: int = 0
    y: int = 0
    channel: int = 0

    def plus(self, error: np.ndarray, values: int, allowed: np.ndarray, tolerance: Tolerance, y0: int) -> "Quiet":
        """With the rows from y0 on: `error` (h, W, 3) is |t - r|, 0 where there is noise; `allowed` (3,) the bound."""
        peak = int(error.argmax())
        place = self[3:]
        if error.flat[peak] > self.error:
            y, x, c = (int(i) for i in np.unravel_index(peak, error.shape))
            place = (float(error.flat[peak]), x, y + y0, c)
        over = outliers = 0
        if float(error.flat[peak]) > allowed.min():
            over = int(np.count_nonzero(error > allowed))
            beyond = error > allowed + np.float32((OUTLIER - 1) * tolerance.p999_abs)
            outliers = int(np.count_nonzero(beyond.any(axis=-1)))
        return Quiet(self.values + values, self.over + over, self.outliers + outliers, *place)

    def findings(self, tolerance: Tolerance, pixels: int, excused: int) -> list[Finding]:
        """The two bounds of the tolerance; `excused` pixels see another object, and may."""
        findings = []
        worst = f"the worst {self.error:.3g} at {at(self.x, self.y)}, {CHANNELS[self.channel]}"
        if self.over > self.values // 1000 + 3 * excused:
            share = f"{100 * self.over / self.values:.3g} %"
            findings.append(
                Finding(
                    EXACT,
                    f"{share} of the noise-free values ({self.over} of {self.values}) err by more than "
                    f"{tolerance.p999_abs:g} (allowed 0.1 %); {worst}",
                )
            )
        if self.outliers > int(tolerance.outlier_fraction * pixels) + excused:
            findings.append(
                Finding(
                    EXACT,
                    f"{plural(self.outliers, 'pixel')} of {pixels} err by more than {OUTLIER * tolerance.p999_abs:g} "
                    f"(allowed {100 * tolerance.outlier_fraction:g} %); {worst}",
                )
            )
        return findings


def count_quiet(test: Image, reference: Image, tolerance: Tolerance) -> Quiet:
    """Every value of two noise-free images of one shape."""
    quiet, allowed = Quiet(), np.full(3, tolerance.p999_abs, np.float32)
    for y0, y1, _ in strips(test.shape[0]):
        d = np.subtract(test.mean[y0:y1], reference.mean[y0:y1])
        quiet = quiet.plus(np.abs(d, out=d), d.size, allowed, tolerance, y0)
    return quiet
