"""May the scatter of t - r, which no variance explains, be a renderer's noise? Only then may it excuse anything.

Two questions, each of pixels alone, since nothing here is claimed:

    borne_out   Does the reference scatter too? With t = s + n_t and r = s + n_r, the covariance of t - r with r is
                -var(n_r), whatever s shows. An image without noise has none, so that a pattern of wrong pixels beside
                it is never excused; one with noise bears out at most 1 / LEVEL times its own variance.
    patterned   Do errors repeat from place to place? Stripes, checkerboards, ordered dithering.
"""

import numpy as np

from raytwin.array_types import Float, Float64
from raytwin.compare.blocks import SIDE, Blocks, Pixels, block_counts, block_sums, strips
from raytwin.compare.noise import Residual, standardised

LEVEL = 1 / 16
"""The reference's share of the scatter's variance: at least this, so at most 4 of its own standard deviations."""

REGION = 4
"""Blocks of 8 x 8 pixels on the side of the region whose median block is asked."""

ALMOST_ALL = 0.95
"""The share of the regions that must bear the scatter out; edges and texture make a few of them doubtful."""

FILTER, LONGEST = 5, 16
"""Pixels: up to FILTER a reconstruction filter makes neighbours alike; LONGEST is the longest period looked for."""

REPEATS = 0.3
"""The correlation of errors at a distance that no renderer's noise has."""


def borne_out(test: Pixels, reference: Pixels, shown: Residual, least: float) -> bool:
    """Whether the reference's own noise is LEVEL of the scatter's variance in almost all regions that scatter.

    `least`: a standard deviation below it is no scatter.
    """
    scatter = shown.square.sum(axis=-1)
    scatters = (shown.square > least**2).any(axis=-1) & (shown.pixels[..., 0] >= 16)
    share = np.divide(_own_noise(test, reference), scatter, out=np.zeros_like(scatter), where=scatters)
    high, wide = share.shape
    places = [
        (slice(y, y + REGION), slice(x, x + REGION)) for y in range(0, high, REGION) for x in range(0, wide, REGION)
    ]
    medians = [np.median(share[p][scatters[p]]) for p in places if np.count_nonzero(scatters[p]) > 1]
    return bool(medians) and float(np.mean(np.array(medians) >= LEVEL)) >= ALMOST_ALL


def _own_noise(test: Pixels, reference: Pixels) -> Float64[np.ndarray, "by bx"]:
    """The reference's variance, summed over channels, from the covariance of t - r with r within 2 x 2 pixels."""
    found = []
    for y0, y1, rows in strips(test.shape):
        r = np.asarray(reference[y0:y1], np.float32)
        d = _within_cells(np.subtract(test[y0:y1], r, dtype=np.float32))
        product = np.zeros((*r.shape[:2], 1), np.float32)
        product[: len(d), : d.shape[1]] = -(d * _within_cells(r)).sum(axis=-1, keepdims=True)
        # Three of the four differences from a cell's mean are free.
        found.append(block_sums(product, rows)[..., 0] / (0.75 * block_counts(product, rows)[..., 0]))
    return np.concatenate(found)


def _within_cells(x: Float[np.ndarray, "h w c"]) -> Float[np.ndarray, "he we c"]:
    """`x` less the mean of its cell of 2 x 2 pixels; an odd row or column is left out."""
    h, w = x.shape[0] // 2, x.shape[1] // 2
    cells = x[: 2 * h, : 2 * w].reshape(h, 2, w, 2, -1)
    return np.asarray((cells - cells.mean(axis=(1, 3), keepdims=True)).reshape(2 * h, 2 * w, -1))


def patterned(test: Pixels, reference: Pixels, square: Blocks) -> bool:
    """Whether errors repeat at some distance along rows, columns or diagonals.

    Neighbours within a filter's reach may be alike, but not opposite. `square`: the blocks' variances of t - r.
    """
    e = standardised(test, reference, square)
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for h in range(1, LONGEST + 1):
            here, there = _apart(e, h * down, h * right)
            if here.size < 3 * SIDE * SIDE:
                break
            power = float(np.sqrt(np.vdot(here, here) * np.vdot(there, there)))
            alike = float(np.vdot(here, there)) / power if power > 0 else 0.0
            if alike < -REPEATS or (alike > REPEATS and h > FILTER):
                return True
    return False


def _apart(e: Pixels, down: int, right: int) -> tuple[np.ndarray, np.ndarray]:
    """The values, and those `down` and `right` of them."""
    h, w = e.shape[:2]
    left, over = max(-right, 0), max(right, 0)
    return (
        np.ascontiguousarray(e[: h - down, left : w - over]),
        np.ascontiguousarray(e[down:, over : w - left]),
    )
