"""Scale, tint, offset, gamma, order of pixels and channels, tried under noise: by means of blocks, in units of their
standard deviation.

A single noisy pixel tells little; the mean of a block of 64 has an eighth of the noise. Of images that differ by noise
alone, the squares of the blocks' errors by their variances have mean 1; a cause is named where it brings them there.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from raytwin.explain.parametric_faults import bright

BLOCK = 8
"""Side of a block, pixels."""
FIRM_SIGMAS = 8.0
"""A cause must lower the mean square by this many of its standard deviations."""
LEFT_SHARE = 0.1
"""Largest share of (mean square - 1) that may remain once a cause is assumed."""
LEAST_CHANGE = 1e-3
"""A fitted number that changes the image by less than this is ignored."""
GAMMAS = ((1 / 2.2, "encoded for display (gamma)"), (2.2, "decoded once too often (gamma)"))
Array = np.ndarray


class Trial(NamedTuple):
    """The reference as a cause would change it: (H, W, 3) `mean` and `variance`; `numbers`: how many were fitted."""

    words: str
    mean: Array
    variance: Array
    numbers: int = 0


def noisy_cause(shown: Array, right: Array, variance: Array, reference_variance: Array) -> str:
    """Name the change of values or pixel order that explains the test (H, W, 3); empty if none does."""
    if min(shown.shape[:2]) < 4 * BLOCK:
        return ""
    s, r, v, rv = (np.asarray(x, float) for x in (shown, right, variance, reference_variance))
    if not (_blocks(v + rv) > 0).all():
        return ""
    before, doubt = _misfit(s, r, v + rv), np.sqrt(2 / _blocks(s).size)
    if before - 1 < FIRM_SIGMAS * doubt:
        return ""
    after, words = min(
        (_misfit(s, trial.mean, v + trial.variance) + trial.numbers * 2 * doubt**2, trial.words)
        for trial in _trials(s, r, v, rv)
    )
    return words if after - 1 < LEFT_SHARE * (before - 1) + 4 * doubt and before - after > FIRM_SIGMAS * doubt else ""


def _trials(s: Array, r: Array, v: Array, rv: Array) -> Iterator[Trial]:
    yield Trial("the image is mirrored left to right", r[:, ::-1], rv[:, ::-1])
    yield Trial("the image is upside down", r[::-1], rv[::-1])
    yield Trial("the image is turned by half a turn", r[::-1, ::-1], rv[::-1, ::-1])
    yield Trial("red and blue are swapped", r[..., ::-1], rv[..., ::-1])
    weight = 1 / _blocks(v + rv)
    S, R, RV = _blocks(s), _blocks(r), _blocks(rv) / BLOCK**2
    products, squares = weight * S * R, weight * (R * R - RV)  # the reference's noise would pull factors towards 0
    k = float(products.sum() / max(squares.sum(), 1e-300))
    if abs(k - 1) > LEAST_CHANGE and k > 0:
        yield Trial(f"the whole image, background too, is {bright(k)}", k * r, k * k * rv, 1)
    tint = products.sum(axis=(0, 1)) / np.maximum(squares.sum(axis=(0, 1)), 1e-300)
    if np.ptp(tint) > LEAST_CHANGE and (tint > 0).all():
        factors = ", ".join(f"{x:.4g}" for x in tint)
        yield Trial(f"the channels are off by the factors {factors} (red, green, blue)", tint * r, tint**2 * rv, 3)
    more = float((weight * (S - R)).sum() / weight.sum())
    yield Trial(f"{more:.4g} is added to every value", r + more, rv, 1)
    base = np.maximum(r, 1e-6 * max(float(r.max()), 1e-300))
    for g, how in GAMMAS:
        bend = g * (g - 1) * base ** (g - 2) * rv / 2  # noise shifts the mean of r^g: to second order, by this
        mean = base**g - np.clip(bend, -np.abs(base**g), np.abs(base**g))
        yield Trial(f"the values are {how}", mean, (g * base ** (g - 1)) ** 2 * rv)


def _blocks(x: Array) -> Array:
    """Means over whole blocks, (h // BLOCK, w // BLOCK, 3)."""
    h, w = (n // BLOCK for n in x.shape[:2])
    return np.asarray(x[: h * BLOCK, : w * BLOCK].reshape(h, BLOCK, w, BLOCK, 3).mean(axis=(1, 3)))


def _misfit(s: Array, made: Array, variance: Array) -> float:
    """The mean square of the blocks' errors in units of their standard deviation."""
    return float((np.square(_blocks(s - made)) / np.maximum(_blocks(variance) / BLOCK**2, 1e-300)).mean())
