"""May the scatter of t - r, which no variance explains, be a renderer's noise? Only then may it excuse anything.

Two questions, each of pixels alone:

    borne_out   Does the reference scatter too? With t = s + n_t and r = s + n_r, the covariance of t - r with r is
                -var(n_r), whatever s shows. An image without noise has none, so that a pattern of wrong pixels beside
                it is never excused; one with noise bears out at most 1 / LEVEL times its own variance.
    patterned   Do errors repeat from place to place? Stripes, checkerboards, ordered dithering. Asked where a variance
                is claimed, too: noise is independent of place.
"""

import math

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

REPEATS, SURE = 0.3, 6.0
"""The correlation of errors at a distance that no renderer's noise has, and the standard deviations it must be from 0:
of a hundred thousand correlations of independent errors none is as far off.
"""

CELL, MOST_CELLS = 64, 16
"""Pixels of the side of the cells in which errors are correlated, and at most how many cells are asked: of 16, spread
over the image, a pattern in a quarter of it meets four."""


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


def patterned(test: Pixels, reference: Pixels, square: Blocks, claimed: bool = False) -> bool:
    """Whether errors repeat at some distance up to LONGEST along rows, columns or diagonals, in a cell or in all.

    Neighbours within a filter's reach may be alike, but not opposite. `square`: the blocks' variances of t - r.
    `claimed`: they are what an image claims. Errors that are alike over an area are tested elsewhere then: a pattern's
    are less alike between neighbours, in some direction, than at a distance.
    """
    finite = square[np.isfinite(square)]
    # What float32 rounds is no scatter: where errors are all alike, they are left out.
    rounding = 1e-9 * float(finite.mean()) if finite.size else 0.0
    e = standardised(test, reference, np.where(square > rounding, square, np.inf), most_pixels=test.size)
    high, wide = (min(CELL, n) for n in e.shape[:2])
    cells = [_correlations(e[y : y + high, x : x + wide]) for y, x in _cells(e.shape, high, wide)]
    for together, power in (*cells, tuple(np.sum(cells, axis=0))):
        lines = [_along(together, power, (high, wide), *direction) for direction in ((0, 1), (1, 0), (1, 1), (1, -1))]
        near = min((1.0, *(x for alike, _ in lines for x in alike[:2])))
        for alike, sure in lines:
            far = np.arange(1, len(alike) + 1)
            again = (alike > REPEATS) & (far > FILTER)
            if claimed:
                nearer = np.minimum.accumulate(np.concatenate([[near], alike]))[:-1]
                again = (alike - nearer > REPEATS) & (far > 1)
            if bool((sure & ((alike < -REPEATS) | again)).any()):
                return True
    return False


def _along(
    together: np.ndarray, power: np.ndarray, size: tuple[int, int], down: int, right: int
) -> tuple[np.ndarray, np.ndarray]:
    """How alike errors are at the distances 1 to LONGEST in a direction (fewer in small cells); whether that is SURE.

    `together` and `power` are those of `_correlations` in cells of `size`.
    """
    far = np.arange(1, LONGEST + 1)
    pairs = np.maximum(size[0] - down * far, 0) * np.maximum(size[1] - abs(right) * far, 0)
    far, pairs = far[pairs >= SIDE * SIDE], pairs[pairs >= SIDE * SIDE]
    at = together[down * far, right * far]
    alike = at / np.maximum(together[0, 0] * pairs / math.prod(size), 1e-30)
    sure = np.abs(at) > SURE * np.sqrt(np.maximum(power[down * far, right * far], 0)) + 1e-6 * together[0, 0]
    return alike, sure


def _cells(shape: tuple[int, ...], high: int, wide: int) -> list[tuple[int, int]]:
    """The upper left corners of MOST_CELLS cells at most, spread evenly over the image."""
    corners = [(y, x) for y in range(0, shape[0] - high + 1, high) for x in range(0, shape[1] - wide + 1, wide)]
    return corners[:: -(-len(corners) // MOST_CELLS)]


def _correlations(e: Pixels) -> tuple[np.ndarray, np.ndarray]:
    """Sums of e(x) e(x + h) over pixels, for all offsets h = (down, right) as indices, negative ones from the end.

    And a bound of the variance that such a sum has if errors are independent: a pixel's channels may share theirs.
    Both by the inverse transform of a power spectrum (Wiener and Khinchin).
    """
    size = e.shape[0] + LONGEST, e.shape[1] + LONGEST

    def at_all_offsets(x: np.ndarray) -> np.ndarray:
        spectrum = np.fft.rfft2(x, size, axes=(0, 1))
        return np.asarray(np.fft.irfft2((spectrum * spectrum.conj()).real.sum(axis=-1), size))

    return at_all_offsets(e), at_all_offsets(np.square(e).sum(axis=-1, keepdims=True))
