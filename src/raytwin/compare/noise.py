"""What the noise of two images is: each one's own variance, what t - r shows of it, and what neighbours share."""

import math
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Float, Float32, Float64
from raytwin.compare.blocks import SIDE, Blocks, Pixels, block_counts, block_sums, strips, to_pixels
from raytwin.images.image import Image

EVENTS = 8.0
"""A pixel of mean m and variance v is the sum of some m²/v events of one size; of fewer than this it is rare light."""

ONE_EVENT = 1.01
"""Upper limit of m² / v for a pixel that one event made: exactly 1 without rounding."""

CAP = 4.0
"""A block's claimed variance may be this many times what the scatter of t - r within it shows."""

TINY = np.float32(1e-38)
"""Close to the smallest float32 with full precision."""


# ------------------------------------------------------------------------------------------------------ one image


def degrees_of_freedom(image: Image) -> float:
    """batches - 1, or samples - 1 where every sample was a batch; infinite where neither is known."""
    batches = image.batches if image.batches is not None else image.samples
    return float(batches - 1) if batches > 1 else math.inf


def rare_light(image: Image) -> float:
    """The share of an image's light in pixels whose mean is the sum of few rare events.

    m² / v events made a pixel: fewer than EVENTS, and fewer than an eighth of its samples, which are not rare. A single
    event has v = m² exactly, so that it counts in however few samples.
    """
    if image.variance is None:
        return 0.0
    samples = image.samples if image.samples > 1 else image.batches or 0
    few = np.square(image.mean) < image.variance * np.float32(max(ONE_EVENT, min(EVENTS, samples / EVENTS)))
    lit = np.maximum(image.mean, 0)
    return float(np.vdot(lit, few)) / max(float(lit.sum(dtype=np.float64)), 1e-300)


def block_means(x: Pixels) -> Float64[np.ndarray, "by bx 3"]:
    """(H, W, 3) to (by, bx, 3): the means of its 8 x 8 blocks."""
    return np.concatenate([block_sums(x[a:b], rows) / block_counts(x[a:b], rows) for a, b, rows in strips(x.shape)])


# ------------------------------------------------------------------------------------------------- what t - r shows


class Residual(NamedTuple):
    """The scatter of t - r within 8 x 8 blocks: its mean square (by, bx, 3), an unbiased variance where there is noise.

    `carrying`: the effective number of values that carry it, (Σd²)² / Σd⁴; a third of them all for Gaussian noise.
    """

    square: Blocks
    carrying: Blocks
    pixels: Blocks


def residual(test: Pixels, reference: Pixels) -> Residual:
    """Return the scatter of the difference of two means (H, W, 3)."""
    squares, fourths, counts = [], [], []
    for y0, y1, rows in strips(test.shape):
        square = demeaned(np.subtract(test[y0:y1], reference[y0:y1], dtype=np.float32), rows)
        square *= square
        squares.append(block_sums(square, rows))
        square *= square
        fourths.append(block_sums(square, rows))
        counts.append(np.broadcast_to(block_counts(square, rows), squares[-1].shape))
    total, fourth, pixels = (np.concatenate(x) for x in (squares, fourths, counts))
    variance = np.divide(total, pixels - 1, out=np.full_like(total, np.inf), where=pixels > 1)
    return Residual(variance, np.divide(total**2, fourth, out=np.zeros_like(total), where=fourth > 0), pixels)


def demeaned(error: Float32[np.ndarray, "h w 3"], rows: int) -> Float32[np.ndarray, "h w 3"]:
    """`error` less its blocks' means, in place."""
    mean = (block_sums(error, rows) / block_counts(error, rows)).astype(np.float32)
    error -= to_pixels(mean, *error.shape[:2])
    return error


def estimated(test: Pixels, reference: Pixels) -> Float32[np.ndarray, "h w 3"]:
    """A variance of t - r where neither image tells one: the square of its deviation from its block's mean."""
    out = np.subtract(test, reference, dtype=np.float32)
    for y0, y1, rows in strips(out.shape):
        n = block_counts(out[y0:y1], rows)
        free = to_pixels((n / np.maximum(n - 1, 1)).astype(np.float32), y1 - y0, out.shape[1])
        out[y0:y1] = np.square(demeaned(out[y0:y1], rows)) * free
    return np.asarray(out)


def capped(variance: Pixels, shown: Residual) -> Pixels:
    """The claimed variance, in no block more than CAP times what t - r shows there or in a neighbouring block."""
    from scipy.ndimage import maximum_filter

    claimed, most = block_means(variance), CAP * maximum_filter(shown.square, (3, 3, 1), mode="constant", cval=-np.inf)
    over = claimed > most
    if not over.any():
        return variance
    factor = np.divide(most, claimed, out=np.ones_like(most), where=over).astype(np.float32)
    return np.asarray(variance * to_pixels(factor, *variance.shape[:2]))


ALIKE, MOST_FEW_SAMPLES = (0.5, 1.5), 16
"""The median block's share of what so many samples scatter: 0.67 to 1.06 in correct renders of 1 to 16 samples, at most
0.35 or at least 1.6 in most wrong images. Samples per pixel up to which noise is too sparse for `untold.dense`."""


def equivalent_samples(reference: Image, shown: Residual) -> float | None:
    """How many samples per pixel of the reference's renderer scatter as t - r does within 8 x 8 pixels.

    None where the reference tells no noise, where the test has less than a tenth of its variance, and where t - r is
    spread over the blocks otherwise than the reference's noise.
    """
    if reference.variance is None or reference.samples < 2:
        return None
    known = block_means(reference.variance)
    noisy = (known > 0) & (shown.pixels > 1)
    if not noisy.any():
        return None
    known, beyond = known[noisy], shown.square[noisy] - known[noisy]
    ratio = float(beyond.sum() / known.sum())
    if ratio <= 0.1 or not ALIKE[0] <= float(np.median(beyond / known)) / ratio <= ALIKE[1]:
        return None
    return reference.samples / ratio


def few_samples(n: float | None) -> int:
    """Return equivalent samples where they are few: a rounded number from 1 to MOST_FEW_SAMPLES, else 0."""
    return max(1, round(n)) if n is not None and ALIKE[0] <= n <= MOST_FEW_SAMPLES else 0


# ------------------------------------------------------------------------------------------- what neighbours share

LAGS, FAR_LAGS = 5, (7, 8, 9)
"""Neighbours at 1 to LAGS pixels may share noise; at FAR_LAGS pixels they share nothing that is not in all."""

CHANCE = 3.1
"""Times 1 / sqrt(values): correlations below are chance. A median scatters 1.25 times as much as a mean."""

OPPOSITE = -0.3
"""A correlation of neighbours' errors below this is no renderer's noise, but a pattern, such as stripes."""

PIXELS_CORRELATED = 200_000
"""Most pixels that are correlated, from the image's middle rows."""


class Correlation(NamedTuple):
    """How many times the variance of independent pixels a mean over many has, and whether errors form a pattern."""

    inflation: float
    patterned: bool


def correlation(test: Pixels, reference: Pixels, variance: Blocks) -> Correlation:
    """How alike the errors of neighbouring pixels are; `variance`: the blocks' (by, bx, 3), of t - r.

    A reconstruction filter wider than the pixel gives neighbours the same samples: the variance of a mean is
    1 + Σ ρ(lag) times that of independent pixels. ρ is read off the variogram of e = (t - r) / sd,
    γ(h) = <(e(x) - e(x + h))²> / <e(x)² + e(x + h)²> = 1 - ρ(h), in which whatever is alike over some pixels (a wrong
    brightness) cancels, and so does noise that is less towards the image's edges. Filters are separable: rows and
    columns are measured apart, and ρ is the smaller of two estimates: the sum over all lines, which a wrong corner can
    dominate, and the median of the lines, which lines that hardly scatter can dominate. A negative ρ shows a pattern.
    """
    height, width = test.shape[:2]
    rows = min(height, max(SIDE, PIXELS_CORRELATED // width // SIDE * SIDE))
    top = (height - rows) // 2 // SIDE * SIDE
    error = np.subtract(test[top : top + rows], reference[top : top + rows], dtype=np.float32)
    sd = np.sqrt(variance[top // SIDE : -(-(top + rows) // SIDE)]).astype(np.float32)
    per_sd = np.divide(np.float32(1), sd, out=np.zeros_like(sd), where=np.isfinite(sd) & (sd > 0))
    error *= to_pixels(per_sd, rows, width)
    np.clip(error, -3, 3, out=error)  # so that neither edges nor fireflies dominate
    square = error * error
    total, fourth = float(square.sum(dtype=float)), float(np.vdot(square, square))
    # Of Gaussian noise a third of its values' number, since channels share their samples; of noise in places, less.
    values = total * total / fourth if fourth > 0 else 1.0
    down, across = _along(error, values), _along(error.swapaxes(0, 1), values)
    return Correlation(down.inflation * across.inflation, down.patterned or across.patterned)


def _along(error: Float32[np.ndarray, "n lines 3"], values: float) -> Correlation:
    """1 + 2 Σ ρ(h) along the first axis, up to the first lag at which it is no more than chance."""
    if len(error) < 2 * FAR_LAGS[-1]:
        return Correlation(1.0, False)
    square = np.einsum("ijk,ijk->ij", error, error)

    def gamma(h: int) -> Float[np.ndarray, " lines_and_all"]:
        step = error[h:] - error[:-h]
        parts = np.einsum("ijk,ijk->j", step, step), (square[h:] + square[:-h]).sum(axis=0)
        apart, both = (np.append(x, x.sum(dtype=float)) for x in parts)
        return np.asarray(apart[both > 0] / both[both > 0])

    far = np.asarray(sum(gamma(h) for h in FAR_LAGS) / len(FAR_LAGS))
    if not far.size or not far[-1] > 0:  # nothing scatters
        return Correlation(1.0, False)
    total, chance, adds = 1.0, CHANCE / math.sqrt(values), True
    for h in range(1, LAGS + 1):
        alike = 1 - np.divide(gamma(h), far, out=np.ones_like(far), where=far > 0)
        median, of_all = float(np.median(alike)), float(alike[-1])
        # What neighbours share makes correlations scatter more: 1 in 200 renders with clusters of 3 x 3 failed without.
        if max(median, of_all) < min(OPPOSITE, -2 * chance * total):
            return Correlation(total, True)
        adds &= min(median, of_all) >= chance
        total += 2 * min(median, of_all) * adds
    return Correlation(total, False)


# ------------------------------------------------------------------------------------------------------ two images


def variance_ratio(test: Image, reference: Image, least: float = 0.0) -> float | None:
    """The typical ratio of the test's variance to the reference's; None where one of the images has no noise.

    It is the samples' inverse ratio where both state them, but no less than the median over pixels with noise (more
    than `least`) in both: rare events show in the median of the better-known image alone.
    """
    if test.variance is None or reference.variance is None:
        return None
    step = max(1, math.isqrt(test.mean.size // 3 // 50_000))
    mine, theirs = (np.asarray(v[::step, ::step], np.float64).ravel() for v in (test.variance, reference.variance))
    # Rounding makes a variance of its own, which carries no information.
    both = (mine > least) & (theirs > least)
    typical = float(np.median(mine[both] / theirs[both])) if both.sum() >= 30 else 0.0
    if test.samples > 1 and reference.samples > 1:
        typical = max(typical, reference.samples / test.samples)
    # Beyond a million one image is practically noise-free, and its variance says nothing about the other's.
    return typical if 1e-6 < typical < 1e6 else None


def larger_variance(
    test: Float[np.ndarray, "..."], reference: Float[np.ndarray, "..."], ratio: float | None
) -> Float[np.ndarray, "..."]:
    """The variance of t - r: each image's own, or what the other's says of it, whichever is larger.

    max(va, ρ vb) + max(vb, va / ρ) = (1 + 1/ρ) max(va, ρ vb).
    """
    if ratio is None:
        return np.asarray(test + reference)
    return np.asarray(np.maximum(test, reference * ratio) * (1 + 1 / ratio))
