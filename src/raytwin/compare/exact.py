"""Values without noise: how many are off by more than the tolerance, and where the worst is."""

from typing import NamedTuple

import numpy as np

from raytwin.compare.blocks import Pixels, strips
from raytwin.compare.finding import CHANNELS, MOST_PLACES, Finding, Place, at, blocks_of, plural
from raytwin.compare.scale import Bound
from raytwin.scene import Tolerance

OUTLIER = 10.0
"""A pixel is an outlier when a value of it errs by more than this many tolerances."""


class NoiseFree(NamedTuple):
    """Values without noise: how many, how many beyond the tolerance and where, how many outliers, and the worst."""

    values: int = 0
    over: int = 0
    outliers: int = 0
    error: float = 0.0
    x: int = 0
    y: int = 0
    channel: int = 0
    places: tuple[Place, ...] = ()

    def plus(self, error: Pixels, values: int, bound: Pixels, granted: Pixels | float, y0: int) -> "NoiseFree":
        """With the rows from y0 on: `error` (h, W, 3) is |t - r|, 0 where there is noise.

        `bound` is what a value may err by, `granted` what is forgiven beyond it, once, not ten times.
        """
        peak = int(error.argmax())
        place = self[3:-1]
        if error.flat[peak] > self.error:
            y, x, c = (int(i) for i in np.unravel_index(peak, error.shape))
            place = (float(error.flat[peak]), x, y + y0, c)
        over, outliers, places = 0, 0, self.places
        if float(error.flat[peak]) > bound.min():
            wrong = error > bound + granted
            over = int(np.count_nonzero(wrong))
            if over and len(places) < MOST_PLACES:
                places = tuple(dict.fromkeys((*places, *blocks_of(np.any(np.atleast_3d(wrong), axis=-1), y0))))[
                    :MOST_PLACES
                ]
            beyond = error > OUTLIER * bound + granted
            outliers = int(np.count_nonzero(beyond.any(axis=-1)))
        return NoiseFree(self.values + values, self.over + over, self.outliers + outliers, *place, places)

    def findings(self, tolerance: Tolerance, scale: float, pixels: int, excused: int) -> list[Finding]:
        """The two bounds of the tolerance; `excused` pixels see another object, and may."""
        findings = []
        worst = f"the worst {self.error:.3g} at {at(self.x, self.y)}, {CHANNELS[self.channel]}"
        bound = f"{tolerance.p999_abs * scale:.3g}"
        if self.over > self.values // 1000 + 3 * excused:
            share = f"{100 * self.over / self.values:.3g} % of the noise-free values ({self.over} of {self.values})"
            text = f"{share} are off by more than the tolerance of {bound} (0.1 % may be)"
            findings.append(Finding("exact", f"{text}; {worst}", Place(self.x, self.y)))
        if self.outliers > int(tolerance.outlier_fraction * pixels) + excused:
            share = f"{plural(self.outliers, 'pixel')} of {pixels} {'is' if self.outliers == 1 else 'are'}"
            text = f"{share} off by more than {OUTLIER:g} times the tolerance of {bound}"
            allowed = f"{100 * tolerance.outlier_fraction:g} % may be"
            findings.append(Finding("exact", f"{text} ({allowed}); {worst}", Place(self.x, self.y)))
        return findings


def count_noise_free(test: Pixels, reference: Pixels, bound: Bound, granted: Pixels | None = None) -> NoiseFree:
    """Every value of two noise-free images of one shape; `granted` (H, W, 3) is forgiven beyond the bound."""
    noise_free = NoiseFree()
    for y0, y1, _ in strips(test.shape):
        d = np.subtract(test[y0:y1], reference[y0:y1])
        np.abs(d, out=d)
        more = 0.0 if granted is None else granted[y0:y1]
        noise_free = noise_free.plus(d, d.size, bound.of(reference[y0:y1]), more, y0)
    return noise_free
