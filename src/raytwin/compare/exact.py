"""Values without noise: what they may err by, relative to the images' own scale, and how many err by more.

The verdict stays when both images are multiplied by a number.
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np

from raytwin.array_types import Float
from raytwin.compare.blocks import Pixels
from raytwin.compare.finding import CHANNELS, Finding, Place, at, blocks_of, plural
from raytwin.images.image import Image
from raytwin.scene import Tolerance

BRIGHT_QUANTILE = 0.99
"""The scale is this quantile of the reference's positive values: what is lit best, but for a few highlights."""


def scale_of(*images: Image) -> float:
    """The BRIGHT_QUANTILE of some positive values of the first image that has any; 1 where none has."""
    for image in images:
        step = max(1, math.isqrt(image.mean.size // 3 // 50_000))
        values = np.asarray(image.mean[::step, ::step], np.float64)
        values = values[(values > 0) & np.isfinite(values)]
        if values.size:
            return float(np.partition(values, k := int(BRIGHT_QUANTILE * (values.size - 1)))[k])
    return 1.0


def scaled(tolerance: Tolerance, *images: Image) -> Tolerance:
    """The tolerance in units of radiance: what a value as bright as the first image's scale may err by."""
    return msgspec.structs.replace(tolerance, p999_abs=tolerance.p999_abs * scale_of(*images))


def unit_of(scale: float) -> float:
    """The power of two at or below `scale`: dividing by it changes no digit."""
    return math.ldexp(1.0, math.frexp(scale)[1] - 1)


class Bound(NamedTuple):
    """How far a value without noise may err: `share` of the larger of the image's `scale` and the value itself."""

    share: float
    scale: float

    @property
    def least(self) -> float:
        return self.share * self.scale

    def of(self, radiance: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """(...) the same shape: share * max(scale, |r|)."""
        out = np.asarray(np.abs(radiance))
        np.maximum(out, out.dtype.type(self.scale), out=out)
        return np.asarray(np.multiply(out, out.dtype.type(self.share), out=out))


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

    def findings(self, tolerance: Tolerance, scale: float, pixels: int, excused: int) -> list[Finding]:
        """The two bounds of the tolerance; `excused` pixels see another object, so they may be off."""
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


def count_noise_free(
    error: Pixels, values: int, bound: Bound, radiance: Pixels, forgiven: Pixels | None = None
) -> NoiseFree:
    """Count the errors of so many noise-free `values`; `error` (H, W, 3) is |t - r|, 0 where there is noise.

    `forgiven` is added to the bound: the outlier test multiplies only the bound.
    """
    y, x, channel = (int(i) for i in np.unravel_index(int(error.argmax()), error.shape))
    worst = float(error[y, x, channel])
    if worst <= bound.least:
        return NoiseFree(values, 0, 0, worst, x, y, channel)
    # No value may err by less than `bound.least`: only those beyond it, mostly few, are looked at one by one.
    off = np.flatnonzero(error > bound.least)
    allowed, more = bound.of(radiance.ravel()[off]), 0 if forgiven is None else forgiven.ravel()[off]
    off_by, pixel = error.ravel()[off], off // error.shape[2]
    wrong = off_by > allowed + more
    outliers = len(np.unique(pixel[off_by > OUTLIER * allowed + more]))
    seen_wrong = np.zeros(error.shape[:2], bool)
    seen_wrong.ravel()[pixel[wrong]] = True
    places = blocks_of(seen_wrong, 0, len(error))
    return NoiseFree(values, int(np.count_nonzero(wrong)), outliers, worst, x, y, channel, places)
