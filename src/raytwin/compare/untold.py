"""Unreported noise, estimated from the scatter within blocks of 8 x 8 pixels if the reference scatters too.

    dense       Does t - r scatter in most values of a block, wherever it scatters? A wrong edge or pixel does not.
    borne_out   Does the reference scatter, too? With t = s + n_t and r = s + n_r, the covariance of t - r with r is
                -var(n_r), whatever s shows. An image without noise has none, so that wrong pixels beside it are never
                excused; one with noise bears out at most 1 / MIN_REFERENCE_SHARE times its own variance.

What is dense may fail an image by the means of its tiles; only what is borne out may pass one.
"""

import numpy as np

from raytwin.array_types import Float, Float64
from raytwin.compare.blocks import Pixels, block_counts, block_sums, strips
from raytwin.compare.noise import Residual

MIN_CARRYING = 1 / 6
"""Least effective share of a block's values that carry its scatter, if it is noise; Gaussian noise has a third."""

MIN_CARRYING_ONE_SAMPLE = 1 / 24
"""The same for noise of one sample per pixel: the exponential's has a sixth, and blocks differ widely."""

MIN_DENSE_BLOCKS = 0.8
"""Least share of the scattering blocks that is dense, if the scatter is to count as unreported noise."""

MIN_REFERENCE_SHARE = 1 / 16
"""Least share of the scatter's variance that the reference's noise must explain, so that the scatter is at most 4 of
its standard deviations."""

REGION_BLOCKS = 4
"""Blocks of 8 x 8 pixels on the side of the region whose median block is asked."""

MIN_REGIONS = 0.95
"""The share of the regions that must bear the scatter out; edges and texture make a few of them doubtful."""

UNEXPLAINED = "the images differ from pixel to pixel by more than the reference's own noise explains"

GIVE = "give a variance (variance=, --variance-a), the samples per pixel (--samples-a) or several renders"

ESTIMATED = "noise was estimated from the difference within 8 x 8 pixels, where single wrong pixels go unnoticed"


def dense(shown: Residual, known: Float[np.ndarray, "*blocks 3"], least: float) -> bool:
    """Whether scatter above the `known` variance is spread over most values of the blocks that have it.

    Where most of the picture scatters, the scatter is not an edge, and may have the tails of few samples.
    `least`: a standard deviation below it is no scatter.
    """
    scatters = (shown.square > 1.5 * known + least**2) & (shown.pixels >= 16)
    carried = shown.carrying >= (MIN_CARRYING if scatters.mean() < 0.5 else MIN_CARRYING_ONE_SAMPLE) * shown.pixels
    return bool(scatters.any()) and float(carried[scatters].mean()) >= MIN_DENSE_BLOCKS


def unexplained(shown: Residual, known: Float[np.ndarray, "*blocks 3"]) -> bool:
    """Whether most blocks scatter clearly more than the `known` variance: by 20 %."""
    known = np.broadcast_to(known, shown.square.shape)
    noisy = known > 0
    return bool(noisy.any()) and float(np.median(shown.square[noisy] / known[noisy])) > 1.2


def borne_out(test: Pixels, reference: Pixels, shown: Residual, least: float) -> bool:
    """Whether the reference's noise explains its share of the scatter in almost all regions that scatter."""
    scatter = shown.square.sum(axis=-1)
    scatters = (shown.square > least**2).any(axis=-1) & (shown.pixels[..., 0] >= 16)
    share = np.divide(_own_noise(test, reference), scatter, out=np.zeros_like(scatter), where=scatters)
    medians = []
    for y in range(0, share.shape[0], REGION_BLOCKS):
        for x in range(0, share.shape[1], REGION_BLOCKS):
            region = np.s_[y : y + REGION_BLOCKS, x : x + REGION_BLOCKS]
            if np.count_nonzero(scatters[region]) > 1:
                medians.append(np.median(share[region][scatters[region]]))
    return bool(medians) and float(np.mean(np.array(medians) >= MIN_REFERENCE_SHARE)) >= MIN_REGIONS


def _own_noise(test: Pixels, reference: Pixels) -> Float64[np.ndarray, "by bx"]:
    """The reference's variance, summed over channels: minus the covariance of t - r with r within 2 x 2 pixels."""
    found = []
    for y0, y1, rows in strips(test.shape):
        r = np.asarray(reference[y0:y1], np.float32)
        error = _within_cells(np.subtract(test[y0:y1], r, dtype=np.float32))
        product = np.zeros((*r.shape[:2], 1), np.float32)
        product[: len(error), : error.shape[1]] = -(error * _within_cells(r)).sum(axis=-1, keepdims=True)
        # Three of the four differences from a cell's mean are free.
        found.append(block_sums(product, rows)[..., 0] / (0.75 * block_counts(product, rows)[..., 0]))
    return np.concatenate(found)


def _within_cells(x: Float[np.ndarray, "h w c"]) -> Float[np.ndarray, "he we c"]:
    """`x` less the mean of its cell of 2 x 2 pixels; an odd row or column is left out."""
    h, w = x.shape[0] // 2, x.shape[1] // 2
    cells = x[: 2 * h, : 2 * w].reshape(h, 2, w, 2, x.shape[2])
    return np.asarray((cells - cells.mean(axis=(1, 3), keepdims=True)).reshape(2 * h, 2 * w, x.shape[2]))
