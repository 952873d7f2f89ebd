"""Statistics of the bench: quartiles, the speed-accuracy frontier, exponents of growth."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

NEAR_TIME, NEAR_ERROR = 1.1, 1.05
"""Times within this ratio, or errors, are a tie: another run might turn them round."""


def median_iqr(seconds: Sequence[float]) -> tuple[float, float]:
    """The median and the distance of the quartiles."""
    low, middle, high = np.quantile(seconds, (0.25, 0.5, 0.75))
    return float(middle), float(high - low)


def on_frontier(seconds: Sequence[float], errors: Sequence[float], floor: float = 0.0) -> list[bool]:
    """Which methods no other clearly beats: none is as accurate and clearly faster, or as fast and clearly better.

    Errors below `floor` count as `floor`: the truth cannot tell them apart. Ties share the frontier, so that noise of a
    few per cent does not push a method off it.
    """
    t, e = np.asarray(seconds, float), np.maximum(np.asarray(errors, float), floor)
    e = np.where(np.isfinite(e), e, np.inf)
    faster = (t[None] * NEAR_TIME < t[:, None]) & (e[None] <= e[:, None] * NEAR_ERROR)
    better = (e[None] * NEAR_ERROR < e[:, None]) & (t[None] <= t[:, None] * NEAR_TIME)
    return [bool(b) for b in ~(faster | better).any(axis=1) & np.isfinite(e)]


def staircase(seconds: Sequence[float], errors: Sequence[float], floor: float = 0.0) -> list[int]:
    """Indices of the methods that no other beats at all, from the fastest to the most accurate: the line to draw."""
    found, best = [], np.inf
    for i in sorted(range(len(seconds)), key=lambda i: (seconds[i], errors[i])):
        if max(errors[i], floor) < best:
            best = max(errors[i], floor)
            found.append(i)
    return found


class PowerLaw(NamedTuple):
    """seconds = factor x^exponent over `used` points; `sigma`: the exponent's standard error, NaN for two points."""

    exponent: float
    sigma: float
    factor: float
    used: tuple[float, ...]


def fit_power(x: Sequence[float], seconds: Sequence[float]) -> PowerLaw | None:
    """Least squares in log-log over the upper half of the points (at least three), where fixed costs matter least."""
    order = np.argsort(x)
    x, y = np.log(np.asarray(x, float)[order]), np.log(np.asarray(seconds, float)[order])
    keep = slice(-max(3, (len(x) + 1) // 2), None)
    x, y = x[keep], y[keep]
    if len(x) < 2 or np.ptp(x) == 0:
        return None
    from scipy.stats import linregress

    line = linregress(x, y)
    sigma = float(line.stderr) if len(x) > 2 else float("nan")
    return PowerLaw(float(line.slope), sigma, float(np.exp(line.intercept)), tuple(float(v) for v in np.exp(x)))
