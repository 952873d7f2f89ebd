"""The images' own scale. Tolerances are relative to it: the verdict stays when both are multiplied by a number."""

import math
from typing import NamedTuple

import msgspec
import numpy as np

from raytwin.array_types import Float
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
