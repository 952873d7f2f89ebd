"""What the noise is: each image's own, regularised; what its residuals allow; its fireflies; what neighbours share."""

import math
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Bool, Float, Float32, Float64
from raytwin.compare.blocks import (
    SIDE,
    Blocks,
    Pixels,
    block_counts,
    block_sums,
    strips,
    to_pixels,
    unblock,
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


def per_pixel(blocks: Float[np.ndarray, "by bx c"], width: int) -> Float[np.ndarray, "by 1 {width} c"]:
    """A number per block (by, bx, c) for each of its pixels, to be broadcast over rows: (by, 1, width, c)."""
    return np.asarray(np.repeat(blocks, SIDE, axis=1)[:, None, :width])


def samples_behind(image: Image, side: Blocks | None, least: float) -> int:
    """How many samples of a pixel agree where the variance is 0; 0 where the image has no noise (beyond `least`)."""
    if side is None or not float(side.max()) > least**2:
        return 0
    return image.samples if image.samples > 1 else max(image.batches or 0, 2)


def fireflies(v: Pixels, rows: int) -> Bool[np.ndarray, "h w 3"]:
    """Values of FIREFLY times the variance that is typical of their block, (mean sqrt(v))²: few events made them."""
    typical = np.square(block_sums(np.sqrt(v), rows) / block_counts(v, rows))
    return np.asarray(unblock(v, rows) > per_pixel((FIREFLY * typical).astype(np.float32), v.shape[1])).reshape(v.shape)


def regularised(
    v: Pixels | None, side: Blocks | None, y0: int, y1: int, rows: int
) -> Float32[np.ndarray, "{y1-y0} w 3"] | Float32[np.ndarray, ""]:
    """Rows y0 to y1 of `v`, float32, each value no less than its 8 x 8 block's mean."""
    if v is None or side is None:
        return np.zeros((), np.float32)
    out = np.array(v[y0:y1], np.float32)
    blocks = side[y0 // SIDE : y0 // SIDE + (y1 - y0) // rows]
    in_blocks = unblock(out, rows)
    np.maximum(in_blocks, per_pixel(blocks, v.shape[1]), out=in_blocks)
    return out


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


def equivalent_samples(test: Image, reference: Image) -> float | None:
    """How many samples per pixel of the reference's renderer scatter as t - r does within 8 x 8 pixels.

    None where the reference tells no noise, or the test has less than a tenth of its variance.
    """
    if reference.variance is None or reference.samples < 2:
        return None
    known = float(block_means(reference.variance).sum())
    scatter = float(residual(test.mean, reference.mean).square.sum()) - known
    return known * reference.samples / scatter if scatter > 0.1 * known > 0 else None


def block_means(x: Pixels) -> Float64[np.ndarray, "by bx 3"]:
    """(H, W, 3) to (by, bx, 3): the means of its 8 x 8 blocks."""
    return np.concatenate([block_sums(x[a:b], rows) / block_counts(x[a:b], rows) for a, b, rows in strips(x.shape)])


def demeaned(d: Float32[np.ndarray, "h w 3"], rows: int) -> Float32[np.ndarray, "h w 3"]:
    """`d` less its blocks' means, in place."""
    mean = (block_sums(d, rows) / block_counts(d, rows)).astype(np.float32)
    in_blocks = unblock(d, rows)
    in_blocks -= per_pixel(mean, d.shape[1])
    return d


def estimated(test: Pixels, reference: Pixels) -> Float32[np.ndarray, "h w 3"]:
    """A variance of t - r where neither image tells one: the square of its deviation from its block's mean."""
    out = np.subtract(test, reference, dtype=np.float32)
    for y0, y1, rows in strips(out.shape):
        d = demeaned(out[y0:y1], rows)
        d *= d
        n = block_counts(d, rows)
        in_blocks = unblock(d, rows)
        in_blocks *= per_pixel((n / np.maximum(n - 1, 1)).astype(np.float32), d.shape[1])
    return np.asarray(out)


def capped(variance: Pixels, claimed: Blocks, shown: Residual) -> tuple[Pixels, float]:
    """The claimed variance, no more than CAP times what the residuals show; the share of blocks that
    claim more than their own.

    `claimed`: the blocks' means of `variance`. Where the neighbouring blocks scatter more, so may this one.
    """
    around = np.full((shown.square.shape[0] + 2, shown.square.shape[1] + 2, 3), -np.inf)
    around[1:-1, 1:-1] = shown.square
    h, w = shown.square.shape[:2]
    most = CAP * np.max([around[i : i + h, j : j + w] for i in range(3) for j in range(3)], axis=0)
    over = claimed > most
    much = float((claimed > CAP * shown.square).mean())
    if not over.any():
        return variance, much
    factor = np.divide(most, claimed, out=np.ones_like(most), where=over).astype(np.float32)
    out = variance.copy()
    for y0, y1, rows in strips(out.shape):
        in_blocks = unblock(out[y0:y1], rows)
        in_blocks *= per_pixel(factor[y0 // SIDE : y0 // SIDE + (y1 - y0) // rows], out.shape[1])
    return out, much


LAGS, FAR_LAGS = 5, (7, 8, 9)
"""Neighbours at 1 to LAGS pixels may share noise; at FAR_LAGS pixels they share nothing that is not in all."""


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
    Filters are separable: rows and columns are measured apart. Only correlation that is more than noise counts.
    """
    e = standardised(test, reference, blocks)
    square = e * e
    total, fourth = float(square.sum(dtype=float)), float(np.vdot(square, square))
    # Of Gaussian noise a third of its values' number, since channels share their samples; of noise in places, less.
    values = total * total / fourth if fourth > 0 else 1.0
    across = (square.sum(axis=axes, dtype=float) for axes in ((1, 2), (0, 2)))
    return math.prod(_along(e, lines, axis, values) for axis, lines in enumerate(across))


def _along(e: Float32[np.ndarray, "h w 3"], lines: Float64[np.ndarray, " n"], axis: int, values: float) -> float:
    """1 + 2 Σ ρ(h) along the axis, up to the first lag that is no more than chance. `lines`: sums of e² across it."""
    if e.shape[axis] < 2 * FAR_LAGS[-1]:
        return 1.0

    def gamma(h: int) -> float:
        step = e[h:] - e[:-h] if axis == 0 else e[:, h:] - e[:, :-h]
        both = float(lines[h:].sum() + lines[:-h].sum())
        return float(np.vdot(step, step)) / both if both > 0 else 0.0

    far = sum(gamma(h) for h in FAR_LAGS) / len(FAR_LAGS)
    total = 1.0
    for h in range(1, LAGS + 1):
        rho = 1 - gamma(h) / far if far > 0 else 0.0
        if rho < 2.5 / math.sqrt(values):
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
    va: Float[np.ndarray, "..."],
    vb: Float[np.ndarray, "..."],
    ratio: float | None,
    total: Float[np.ndarray, "*n"] | None = None,
) -> Float[np.ndarray, "*n"]:
    """The variance of t - r: each image's own, or what the other's says of it, whichever is larger.

    `total`: their sum, where it is known already. max(va, ρ vb) + max(vb, va / ρ) = (1 + 1/ρ) max(va, ρ vb).
    """
    if ratio is None:
        return np.asarray(va + vb if total is None else total)
    out = vb * va.dtype.type(ratio)
    out = np.maximum(va, out)
    out *= va.dtype.type(1 + 1 / ratio)
    return np.asarray(out)
