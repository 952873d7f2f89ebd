"""Error metrics: a table of name, formula, source and function. t: test, r: reference; means run over all values.

One more metric is one more row of METRICS.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Metric(NamedTuple):
    """`function(test, reference) -> float` takes two linear arrays (H, W, 3); `formula` is what it computes."""

    name: str
    formula: str
    source: str
    function: Callable[[np.ndarray, np.ndarray], float]


def rmse(test: np.ndarray, reference: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(test - reference), dtype=np.float64)))


def relmse(test: np.ndarray, reference: np.ndarray) -> float:
    return float(np.mean(np.square(test - reference) / (np.square(reference) + 0.01), dtype=np.float64))


def mae(test: np.ndarray, reference: np.ndarray) -> float:
    return float(np.mean(np.abs(test - reference), dtype=np.float64))


def max_abs(test: np.ndarray, reference: np.ndarray) -> float:
    return float(np.max(np.abs(test - reference)))


def p999_abs(test: np.ndarray, reference: np.ndarray) -> float:
    return upper_quantile(np.abs(test - reference), 0.999)


def upper_quantile(values: np.ndarray, q: float) -> float:
    """The smallest value with at least a share q of all values at or below it (no interpolation)."""
    flat = values.ravel()
    k = max(int(np.ceil(q * flat.size)) - 1, 0)
    return float(np.partition(flat, k)[k])


def psnr(test: np.ndarray, reference: np.ndarray) -> float:
    error = rmse(test, reference)
    return float(20 * np.log10(np.max(reference) / error)) if error > 0 else float("inf")


def mean_ratio(test: np.ndarray, reference: np.ndarray) -> float:
    below = float(np.mean(reference, dtype=np.float64))
    return float(np.mean(test, dtype=np.float64)) / below if below else float("nan")


METRICS: dict[str, Metric] = {
    m.name: m
    for m in (
        Metric("rmse", "sqrt(mean((t - r)^2))", "textbook", rmse),
        Metric("relmse", "mean((t - r)^2 / (r^2 + 0.01))", "tev", relmse),
        Metric("mae", "mean(|t - r|)", "textbook", mae),
        Metric("max_abs", "max(|t - r|)", "textbook", max_abs),
        Metric("p999_abs", "99.9 % quantile of |t - r|", "textbook", p999_abs),
        Metric("psnr", "20 log10(max(r) / rmse), dB", "textbook, peak = the reference's maximum", psnr),
        Metric("mean_ratio", "mean(t) / mean(r)", "textbook", mean_ratio),
    )
}
