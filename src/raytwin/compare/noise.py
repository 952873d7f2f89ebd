"""What the noise is: each image's own, regularised; its fireflies; how the two images' variances go together."""

import math
from typing import NamedTuple

import numpy as np

from raytwin.compare.blocks import SIDE, block_sums, dilate, strips, unblock
from raytwin.image import Image
from raytwin.scene import Tolerance

FIREFLY = 25.0
"""A firefly's variance over that of its block and its neighbours: five times their standard deviation."""

SURE = 20.0
"""A sum over pixels that expects more fireflies than this has seen some: missing all has probability exp(-20)."""


def degrees_of_freedom(image: Image) -> float:
    """batches - 1, or samples - 1 where every sample was a batch; infinite where nothing is told."""
    batches = image.batches if image.batches is not None else image.samples
    return float(batches - 1) if batches > 1 else math.inf


class Side(NamedTuple):
    """One image's noise: its mean v, that of each 8 x 8 block, and sums over its fireflies, per channel (3,).

    `first` sums the fireflies' contributions to their pixels, `second` the squares.
    """

    mean: float
    blocks: np.ndarray
    first: np.ndarray
    second: np.ndarray

    @property
    def events(self) -> np.ndarray:
        """(3,) the effective number of fireflies: their count, where all are alike."""
        return np.divide(np.square(self.first), self.second, out=np.zeros(3), where=self.second > 0)


def survey(image: Image) -> Side | None:
    """The noise of one image, in one pass; None where it has none."""
    v = image.variance
    if v is None:
        return None
    blocks = []
    first, second = np.zeros(3), np.zeros(3)
    for y0, y1, rows in strips(len(v)):
        strip = v[y0:y1]
        count = block_sums(np.ones((y1 - y0, v.shape[1], 1), np.float32), rows)
        blocks.append((block_sums(strip, rows) / count).astype(np.float32))
        # (mean sqrt(v))^2 is typical of the block even when one value of it is huge.
        typical = FIREFLY * np.square(block_sums(np.sqrt(strip), rows) / count)
        bright = unblock(strip, rows) > np.repeat(typical.astype(np.float32), SIDE, axis=1)[:, None, : v.shape[1]]
        if bright.any():
            y, x, c = np.nonzero(bright.reshape(strip.shape))
            own, c = _fireflies(v, y + y0, x, c)
            # A single event of size S in n samples lifts the mean by S/n and makes its variance (S/n)^2.
            first += np.bincount(c, np.sqrt(own), 3)
            second += np.bincount(c, own, 3)
    return Side(float(v.mean(dtype=np.float64)), np.concatenate(blocks), first, second)


def _fireflies(v: np.ndarray, y: np.ndarray, x: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variance and channel of those values that stand alone: an edge is noisier than its block too, but not alone."""
    height, width = v.shape[:2]
    neighbours = np.zeros((8, len(y)), v.dtype)
    steps = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]
    for k, (dy, dx) in enumerate(steps):
        inside = (y + dy >= 0) & (y + dy < height) & (x + dx >= 0) & (x + dx < width)
        neighbours[k, inside] = v[y[inside] + dy, x[inside] + dx, c[inside]]
    own = v[y, x, c].astype(np.float64)
    alone = own > FIREFLY * np.partition(neighbours, -2, axis=0)[-2]
    return own[alone], c[alone]


class Allowance(NamedTuple):
    """The bias that is no failure, per channel (3,): `always`, and more for what may have missed all `fireflies`.

    `density` is the number of fireflies per pixel in the image that saw fewer.
    """

    always: float
    fireflies: np.ndarray
    density: np.ndarray

    def of(self, pixels: np.ndarray | int) -> np.ndarray:
        """For means over so many pixels, (..., 1) or one number, to (..., 3)."""
        return self.always + np.where(self.density * pixels < SURE, self.fireflies, 0.0)


def allowance(sides: list[Side], tolerance: Tolerance, pixels: int, share: float) -> Allowance:
    """An upper limit of the fireflies' mean, at confidence 1 - share: the larger of the two images'.

    For k events of one size the limit is that of a Poisson mean: (sqrt(k) + c / 2)^2 + 1, c the Gaussian's quantile.
    """
    from scipy.special import ndtri

    c = -float(ndtri(share))
    limits = []
    for s in sides:
        size = np.divide(s.second, s.first, out=np.zeros(3), where=s.first > 0)
        limits.append((s.first + c * np.sqrt(s.second) + (c * c / 4 + 1) * size) / pixels)
    events = np.array([s.events for s in sides])
    # Among many fireflies some have two neighbours of their kind, and pass for an edge.
    return Allowance(tolerance.p999_abs, 1.2 * np.max(limits, axis=0), events.min(axis=0) / pixels)


def variance_ratio(
    test: Image, reference: Image, a: Side | None, b: Side | None, least: float = 0.0
) -> tuple[float | None, float | None]:
    """(typical, largest) ratio of the test's variance to the reference's; None where one of the images has no noise.

    Typical is the median over pixels, or the samples' inverse ratio where too few have noise (more than `least`) in
    both; largest is that or the ratio of the means, which fireflies rule.
    """
    if a is None or b is None:
        return None, None
    step = max(1, math.isqrt(test.mean.size // 3 // 50_000))
    va, vb = (np.asarray(i.variance[::step, ::step], np.float64).ravel() for i in (test, reference))
    # Rounding makes a variance of its own, which has nothing to tell.
    both = (va > least) & (vb > least)
    typical = None
    if both.sum() >= 30:
        typical = float(np.median(va[both] / vb[both]))
    elif test.samples > 1 and reference.samples > 1:
        typical = reference.samples / test.samples
    largest = max(a.mean / b.mean if a.mean > 0 and b.mean > 0 else 0.0, typical or 0.0)
    # A ratio beyond a million compares a render with none: what one says of the other is nothing.
    return tuple(x if x and 1e-6 < x < 1e6 else None for x in (typical, largest))


def mutual(va: np.ndarray, vb: np.ndarray, ratio: float | None) -> np.ndarray:
    """The variance of t - r: each image's own, or what the other's says of it, whichever is larger."""
    if ratio is None:
        return va + vb
    ratio = va.dtype.type(ratio)
    va = np.maximum(va, ratio * vb)
    return va + np.maximum(vb, va / ratio)


def regularised(v: np.ndarray | None, side: Side | None, y0: int, y1: int, rows: int) -> np.ndarray:
    """Rows y0 to y1 of `v`: the largest of each 3 x 3 neighbourhood, but no less than the 8 x 8 block's mean."""
    if v is None or side is None:
        return np.zeros((), np.float32)
    out = dilate(v, y0, y1)
    blocks = side.blocks[y0 // SIDE : y0 // SIDE + (y1 - y0) // rows]
    in_blocks = unblock(out, rows)
    np.maximum(in_blocks, np.repeat(blocks, SIDE, axis=1)[:, None, : v.shape[1]], out=in_blocks)
    return out
