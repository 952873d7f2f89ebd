"""Scale, tint, offset, gamma, order of pixels and channels, tried under noise: by means of blocks, in units of their
standard deviation.

A single noisy pixel tells little; the mean of a block of 64 has an eighth of the noise. Of images that differ by noise
alone, the squares of the blocks' errors by their variances have mean 1; a cause is named where it brings them there.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from raytwin.diagnose.parametric_faults import bright

BLOCK = 8
"""Pixels across."""
FIRM = 8.0
"""Standard deviations of the mean square, by which a cause has to lower it."""
LEFT = 0.1
"""Share of what exceeds 1 that a cause may leave."""
LEAST = 1e-3
"""A fitted number that changes the image by less than this is ignored."""
Array = np.ndarray


class Trial(NamedTuple):
    """The reference as a cause would change it: (H, W, 3) `mean` and `variance`; `numbers`: how many were fitted."""

    words: str
    mean: Array
    variance: Array
    numbers: int = 0


def noisy_cause(shown: Array, right: Array, variance: Array, reference_variance: Array) -> str:
    """What has happened to the values or the order of the test (H, W, 3); empty where nothing of it explains it."""
    if min(shown.shape[:2]) < 4 * BLOCK:
        return ""
    s, r, v, rv = (np.asarray(x, float) for x in (shown, right, variance, reference_variance))
    if not (_blocks(v + rv) > 0).all():
        return ""
    before = _misfit(s, r, v + rv)
    doubt = np.sqrt(2 / _blocks(s).size)
    if before - 1 < FIRM * doubt:
        return ""
    best, found = before, ""
    for trial in _trials(s, r, v, rv):
        after = _misfit(s, trial.mean, v + trial.variance) + trial.numbers * 2 * doubt**2
        if after < best:
            best, found = after, trial.words
    return found if best - 1 < LEFT * (before - 1) + 4 * doubt and before - best > FIRM * doubt else ""


def _trials(s: Array, r: Array, v: Array, rv: Array) -> Iterator[Trial]:
    moved: tuple[tuple[str, Callable[[Array], Array]], ...] = (
        ("the image is mirrored left to right", lambda x: x[:, ::-1]),
        ("the image is upside down", lambda x: x[::-1]),
        ("the image is turned by half a turn", lambda x: x[::-1, ::-1]),
        ("red and blue are swapped", lambda x: x[..., ::-1]),
    )
    for words, move in moved:
        yield Trial(words, move(r), move(rv))
    weight = 1 / _blocks(v + rv)
    S, R, RV = _blocks(s), _blocks(r), _blocks(rv) / BLOCK**2
    squares = R * R - RV  # the reference's own noise would pull the factor towards 0
    k = float((weight * S * R).sum() / max((weight * squares).sum(), 1e-300))
    if abs(k - 1) > LEAST and k > 0:
        yield Trial(f"the whole image, background too, is {bright(k)}", k * r, k * k * rv, 1)
    tint = (weight * S * R).sum(axis=(0, 1)) / np.maximum((weight * squares).sum(axis=(0, 1)), 1e-300)
    if np.ptp(tint) > LEAST and (tint > 0).all():
        factors = ", ".join(f"{x:.4g}" for x in tint)
        yield Trial(f"the channels are off by the factors {factors} (red, green, blue)", tint * r, tint**2 * rv, 3)
    more = float((weight * (S - R)).sum() / weight.sum())
    yield Trial(f"{more:.4g} is added to every value", r + more, rv, 1)
    yield from _powers(s, r, v, rv)


def _powers(s: Array, r: Array, v: Array, rv: Array) -> Iterator[Trial]:
    """r^g for g between 1/3 and 3; the curve moves the mean of noisy values, to second order corrected."""
    from scipy.optimize import minimize_scalar

    base = np.maximum(r, 1e-6 * max(float(r.max()), 1e-300))

    def made(g: float) -> tuple[Array, Array]:
        slope = g * base ** (g - 1)
        bend = g * (g - 1) * base ** (g - 2)
        return base**g - np.clip(bend * rv / 2, -np.abs(base**g), np.abs(base**g)), slope**2 * rv

    def cost(log_g: float) -> float:
        mean, variance = made(float(np.exp(log_g)))
        return _misfit(s, mean, v + variance)

    g = float(np.exp(minimize_scalar(cost, bounds=(-np.log(3), np.log(3)), method="bounded").x))
    named = {"encoded for display (gamma)": 1 / 2.2, "decoded once too often (gamma)": 2.2}
    words = next((f"the values are {name}" for name, x in named.items() if abs(g / x - 1) < 0.03), "")
    yield Trial(words or f"the values are raised to the power {g:.3g}", *made(g), 1)


def _blocks(x: Array) -> Array:
    """Means over whole blocks, (h // BLOCK, w // BLOCK, 3)."""
    h, w = (n // BLOCK for n in x.shape[:2])
    return np.asarray(x[: h * BLOCK, : w * BLOCK].reshape(h, BLOCK, w, BLOCK, 3).mean(axis=(1, 3)))


def _misfit(s: Array, made: Array, variance: Array) -> float:
    """The mean square of the blocks' errors in units of their standard deviation."""
    return float((np.square(_blocks(s - made)) / np.maximum(_blocks(variance) / BLOCK**2, 1e-300)).mean())
