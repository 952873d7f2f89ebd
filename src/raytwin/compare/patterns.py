"""Do errors repeat from place to place? Stripes, checkerboards, ordered dithering: noise is independent of place.

A variance that is claimed excuses none of them.
"""

import math

import numpy as np
from scipy.ndimage import uniform_filter

from raytwin.compare.blocks import SIDE, Blocks, Pixels
from raytwin.compare.noise import standardised

LONGEST = 16
"""Pixels: the longest period looked for."""

REPEATING_CORRELATION, REPEATING_SIGMAS = 0.3, 6.0
"""The correlation of errors at a distance that no renderer's noise has, and the standard deviations it must be from 0:
of a hundred thousand correlations of independent errors none is as far off.
"""

ROUNDED = 1e-6
"""What a correlation's variance is rounded by, as a share of that of the errors themselves."""

CELL, MOST_CELLS = 64, 16
"""Pixels of the side of the cells in which errors are correlated, and at most how many cells are asked: of 16, spread
over the image, a pattern in a quarter of it meets four."""


def patterned(test: Pixels, reference: Pixels, square: Blocks, inflation: float = 1.0) -> bool:
    """Whether errors repeat at some distance up to LONGEST along rows, columns or diagonals, in a cell or in all.

    `square`: the blocks' variances of t - r that are claimed; `inflation`: of the variance of sums, because neighbours
    share samples, whose correlations scatter more, too. Errors that are alike over an area are tested elsewhere:
    a pattern's are less alike between neighbours, in some direction, than at a distance; or they are opposite.
    """
    # A block that saw none of a few events claims too little.
    square = np.maximum(square, uniform_filter(square, (5, 5, 1), mode="nearest"))
    finite = square[np.isfinite(square)]
    # What float32 rounds is no scatter: where errors are all alike, they are left out.
    rounding = 1e-9 * float(finite.mean()) if finite.size else 0.0
    e = standardised(test, reference, np.where(square > rounding, square, np.inf), most_pixels=test.size)
    high, wide = (min(CELL, n) for n in e.shape[:2])
    cells = [_correlations(e[y : y + high, x : x + wide]) for y, x in _cells(e.shape, high, wide)]
    for together, power in (*cells, tuple(np.sum(cells, axis=0))):
        lines = [
            _along(together, power * inflation, (high, wide), *direction)
            for direction in ((0, 1), (1, 0), (1, 1), (1, -1))
        ]
        near = min((1.0, *(x for alike, _ in lines for x in alike[:2])))
        for alike, sure in lines:
            nearer = np.minimum.accumulate(np.concatenate([[near], alike]))[:-1]
            again = (alike - nearer > REPEATING_CORRELATION) & (np.arange(len(alike)) > 0)
            if bool((sure & ((alike < -REPEATING_CORRELATION) | again)).any()):
                return True
    return False


def _along(
    together: np.ndarray, power: np.ndarray, size: tuple[int, int], down: int, right: int
) -> tuple[np.ndarray, np.ndarray]:
    """How alike errors are at 1 to LONGEST pixels in a direction, fewer in small cells, and whether that repeats.

    `together` and `power` are those of `_correlations` in cells of `size`.
    """
    far = np.arange(1, LONGEST + 1)
    pairs = np.maximum(size[0] - down * far, 0) * np.maximum(size[1] - abs(right) * far, 0)
    far, pairs = far[pairs >= SIDE * SIDE], pairs[pairs >= SIDE * SIDE]
    at = together[down * far, right * far]
    alike = at / np.maximum(together[0, 0] * pairs / math.prod(size), 1e-30)
    # The transform rounds: a few errors have no products at most distances.
    variance = np.maximum(power[down * far, right * far], ROUNDED * power[0, 0])
    sure = np.abs(at) > REPEATING_SIGMAS * np.sqrt(variance)
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
