"""What the noise is: each image's own, regularised; what its residuals allow; its fireflies; what neighbours share."""

import math
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Float, Float32, Float64
from raytwin.compare.blocks import (
    SIDE,
    Blocks,
    Pixels,
    block_counts,
    block_sums,
    strips,
    to_pixels,
)
from raytwin.images.image import Image

FIREFLY = 25.0
"""A firefly's variance over that of its block: five times the standard deviation."""

EVENTS = 8.0
"""A pixel of mean m and variance v is the sum of some m²/v events of one size; of fewer than this it is rare light."""

ONE_EVENT = 1.01
"""Events that the mean and variance of a single one amount to at most: 1, but for rounding."""

CAP = 4.0
"""A block's claimed variance may be this many times what the scatter of t - r within it shows."""


TINY = np.float32(1e-38)
"""Nearly the least that float32 holds with all its digits."""


def degrees_of_freedom(image: Image) -> float:
    """batches - 1, or samples - 1 where every sample was a batch; infinite where neither is known."""
    batches = image.batches if image.batches is not None else image.samples
    return float(batches - 1) if batches > 1 else math.inf


# ------------------------------------------------------------------------------------------------------ one image


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


def samples_behind(image: Image, side: Blocks, least: float) -> int:
    """How many samples of a pixel agree where the variance is 0; 0 where the image has no noise (beyond `least`)."""
    if not float(side.max()) > least**2:
        return 0
    return image.samples if image.samples > 1 else max(image.batches or 0, 2)


def regularised(v: Pixels, side: Blocks, y0: int, y1: int) -> Float32[np.ndarray, "{y1-y0} w 3"]:
    """Rows y0 to y1 of `v`, float32, each value no less than its 8 x 8 block's mean."""
    blocks = to_pixels(side[y0 // SIDE :], y1 - y0, v.shape[1])
    return np.asarray(np.maximum(v[y0:y1], blocks, dtype=np.float32))


# ------------------------------------------------------------------------------------------------- what residuals show


class Residual(NamedTuple):
    """The scatter of t - r within 8 x 8 blocks: its mean square (by, bx, 3), an unbiased variance where there is noise.

    `carrying`: the effective number of values that carry it, (Σd²)² / Σd⁴; a third of them all for Gaussian noise.
    """

    square: Blocks
    carrying: Blocks
    pixels: Blocks


def residual(test: Pixels, reference: Pixels, carrying: bool = False) -> Residual:
    """Compare two means (H, W, 3); the part that carries the difference is computed on request, else 0."""
    squares, fourths, counts = [], [], []
    for y0, y1, rows in strips(test.shape):
        d = demeaned(np.subtract(test[y0:y1], reference[y0:y1], dtype=np.float32), rows)
        d *= d
        squares.append(block_sums(d, rows))
        if carrying:
            d *= d
        fourths.append(block_sums(d, rows) if carrying else np.zeros_like(squares[-1]))
        counts.append(np.broadcast_to(block_counts(d, rows), squares[-1].shape))
    s, f, n = (np.concatenate(x) for x in (squares, fourths, counts))
    with np.errstate(divide="ignore", invalid="ignore"):
        return Residual(np.where(n > 1, s / (n - 1), np.inf), np.where(f > 0, s * s / f, 0), n)


ALIKE, FEW = (0.5, 1.5), 16
"""The median block's share of what so many samples scatter: 0.67 to 1.06 in correct renders of 1 to 16 samples, at most
0.35 or at least 1.6 in most wrong images. Samples per pixel up to which noise is too sparse for `untold.dense`."""


def equivalent_samples(test: Image, reference: Image) -> float | None:
    """How many samples per pixel of the reference's renderer scatter as t - r does within 8 x 8 pixels.

    None where the reference tells no noise, where the test has less than a tenth of its variance, and where t - r is
    spread over the blocks otherwise than the reference's noise.
    """
    if reference.variance is None or reference.samples < 2:
        return None
    known = block_means(reference.variance)
    shown = residual(test.mean, reference.mean)
    noisy = (known > 0) & (shown.pixels > 1)
    if not noisy.any():
        return None
    known, beyond = known[noisy], shown.square[noisy] - known[noisy]
    ratio = float(beyond.sum() / known.sum())
    if ratio <= 0.1 or not ALIKE[0] <= float(np.median(beyond / known)) / ratio <= ALIKE[1]:
        return None
    return reference.samples / ratio


def few_samples(n: float | None) -> int:
    """Return equivalent samples where they are few: a rounded number from 1 to FEW, else 0."""
    return max(1, round(n)) if n is not None and ALIKE[0] <= n <= FEW else 0


def block_means(x: Pixels) -> Float64[np.ndarray, "by bx 3"]:
    """(H, W, 3) to (by, bx, 3): the means of its 8 x 8 blocks."""
    return np.concatenate([block_sums(x[a:b], rows) / block_counts(x[a:b], rows) for a, b, rows in strips(x.shape)])


def demeaned(d: Float32[np.ndarray, "h w 3"], rows: int) -> Float32[np.ndarray, "h w 3"]:
    """`d` less its blocks' means, in place."""
    mean = (block_sums(d, rows) / block_counts(d, rows)).astype(np.float32)
    d -= to_pixels(mean, *d.shape[:2])
    return d


def estimated(test: Pixels, reference: Pixels) -> Float32[np.ndarray, "h w 3"]:
    """A variance of t - r where neither image tells one: the square of its deviation from its block's mean."""
    out = np.subtract(test, reference, dtype=np.float32)
    for y0, y1, rows in strips(out.shape):
        n = block_counts(out[y0:y1], rows)
        free = to_pixels((n / np.maximum(n - 1, 1)).astype(np.float32), y1 - y0, out.shape[1])
        out[y0:y1] = np.square(demeaned(out[y0:y1], rows)) * free
    return np.asarray(out)


def capped(variance: Pixels, claimed: Blocks, shown: Residual) -> tuple[Pixels, float]:
    """The claimed variance, no more than CAP times what the residuals show; the share of blocks that
    claim more than their own.

    `claimed`: the blocks' means of `variance`. Where the neighbouring blocks scatter more, so may this one.
    """
    from scipy.ndimage import maximum_filter

    most = CAP * maximum_filter(shown.square, (3, 3, 1), mode="constant", cval=-np.inf)
    over, much = claimed > most, float((claimed > CAP * shown.square).mean())
    if not over.any():
        return variance, much
    factor = np.divide(most, claimed, out=np.ones_like(most), where=over).astype(np.float32)
    return variance * to_pixels(factor, *variance.shape[:2]), much


LAGS, FAR_LAGS = 5, (7, 8, 9)
"""Neighbours at 1 to LAGS pixels may share noise; at FAR_LAGS pixels they share nothing that is not in all."""

CHANCE = 3.1
"""Times 1 / sqrt(values): correlations below are chance. A median scatters 1.25 times as much as a mean."""


def standardised(
    test: Pixels, reference: Pixels, variance: Blocks, most_pixels: int = 500_000
) -> Float32[np.ndarray, "h w 3"]:
    """(t - r) / sd, cut at 3 so that neither edges nor fireflies rule, of the middle rows; 0 where nothing scatters.

    `variance`: the blocks' (by, bx, 3).
    """
    height, width = test.shape[:2]
    rows = min(height, max(SIDE, most_pixels // width // SIDE * SIDE))
    y0 = (height - rows) // 2 // SIDE * SIDE
    e = np.subtract(test[y0 : y0 + rows], reference[y0 : y0 + rows], dtype=np.float32)
    sd = np.sqrt(variance[y0 // SIDE : -(-(y0 + rows) // SIDE)]).astype(np.float32)
    e *= to_pixels(np.divide(np.float32(1), sd, out=np.zeros_like(sd), where=np.isfinite(sd) & (sd > 0)), rows, width)
    return np.asarray(np.clip(e, -3, 3, out=e))


def inflation(test: Pixels, reference: Pixels, blocks: Float32[np.ndarray, "by bx 3"]) -> float:
    """By how much the variance of a mean over many pixels exceeds that of independent ones: 1 + Σ ρ(lag), >= 1.

    A reconstruction filter wider than the pixel gives neighbours the same samples. Its correlation ρ is read off the
    variogram of e = (t - r) / sd, γ(h) = <(e(x) - e(x + h))²> / <e(x)² + e(x + h)²> = 1 - ρ(h), in which whatever is
    alike over some pixels (a wrong brightness) cancels, and so does noise that is less towards the image's edges.
    Filters are separable: rows and columns are measured apart, and ρ is what both all of them and their median show. No
    wrong corner rules the median, and rows that hardly scatter rule it alone.
    """
    e = standardised(test, reference, blocks)
    square = e * e
    total, fourth = float(square.sum(dtype=float)), float(np.vdot(square, square))
    # Of Gaussian noise a third of its values' number, since channels share their samples; of noise in places, less.
    values = total * total / fourth if fourth > 0 else 1.0
    return _along(e, values) * _along(e.swapaxes(0, 1), values)


def _along(e: Float32[np.ndarray, "n lines 3"], values: float) -> float:
    """1 + 2 Σ ρ(h) along the first axis, up to the first lag at which it is no more than chance."""
    if len(e) < 2 * FAR_LAGS[-1]:
        return 1.0
    square = np.einsum("ijk,ijk->ij", e, e)

    def gamma(h: int) -> Float[np.ndarray, " lines_and_all"]:
        step = e[h:] - e[:-h]
        parts = np.einsum("ijk,ijk->j", step, step), (square[h:] + square[:-h]).sum(axis=0)
        apart, both = (np.append(x, x.sum(dtype=float)) for x in parts)
        return np.asarray(apart[both > 0] / both[both > 0])

    far = np.asarray(sum(gamma(h) for h in FAR_LAGS) / len(FAR_LAGS))
    total = 1.0
    if not far.size or not far[-1] > 0:  # nothing scatters
        return total
    for h in range(1, LAGS + 1):
        alike = 1 - np.divide(gamma(h), far, out=np.ones_like(far), where=far > 0)
        rho = min(float(np.median(alike)), float(alike[-1]))
        if rho < CHANCE / math.sqrt(values):
            break
        total += 2 * rho
    return total


# ------------------------------------------------------------------------------------------------------ two images


def variance_ratio(test: Image, reference: Image, least: float = 0.0) -> float | None:
    """The typical ratio of the test's variance to the reference's; None where one of the images has no noise.

    It is the samples' inverse ratio where both state them, but no less than the median over pixels with noise (more
    than `least`) in both: rare events show in the median of the better-known image alone.
    """
    if test.variance is None or reference.variance is None:
        return None
    step = max(1, math.isqrt(test.mean.size // 3 // 50_000))
    va, vb = (np.asarray(v[::step, ::step], np.float64).ravel() for v in (test.variance, reference.variance))
    # Rounding makes a variance of its own, which carries no information.
    both = (va > least) & (vb > least)
    typical = float(np.median(va[both] / vb[both])) if both.sum() >= 30 else 0.0
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
