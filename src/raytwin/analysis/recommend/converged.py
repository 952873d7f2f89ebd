"""The whole light in two independent halves, and the errors of images against it, without bias by its noise.

The squared error of an image c is estimated by mean((c - a)(c - b)), since the noises of the halves a and b have
nothing in common; its standard error follows from their difference. So a tolerance far below the noise of a pixel can
be told: what meets it does so with two standard errors added.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from raytwin.compare.metrics import METRICS

MOST_SAMPLES = 1 << 14
"""Most samples per pixel of any render."""


SURE = 2.0
"""Standard errors that an error may be off by."""


class Error(NamedTuple):
    """A metric's value, and SURE standard errors below and above."""

    value: float
    least: float
    most: float


def measure(
    metric: str, one: np.ndarray, other: np.ndarray, whole: np.ndarray, sampled: bool = False, errors: float = SURE
) -> Error:
    """The metric of an error, of which `one` and `other` (H, W, 3) are two estimates with independent noise.

    With d their difference and m their mean the product's variance is at most m² d² + (d²/2)², the noise of the three
    channels of a pixel being taken as one; where the pixels are only `sampled` from more, it is what their products
    scatter by, if that is larger. Metrics that are no mean of squares have no such estimate: theirs is of m,
    which the noise only makes larger, and the same of d/2 says by how much.
    """
    mean, apart = (one + other) / 2, one - other
    if metric not in ("rmse", "relmse"):
        function = METRICS[metric].function
        value, noise = function(whole + mean, whole), function(whole + apart / 2, whole)
        return Error(value, max(value - noise, 0.0), value)
    if metric == "relmse":  # the same with both errors divided
        root_weight = 1 / np.sqrt(np.square(whole) + np.float32(0.01))
        one, other, mean, apart = (x * root_weight for x in (one, other, mean, apart))
    value = float((one * other).mean(dtype=float))
    per_pixel = (np.square(x[..., 0] + x[..., 1] + x[..., 2]) for x in (np.abs(mean * apart), np.square(apart) / 2))
    sigma = math.sqrt(sum(float(x.sum(dtype=float)) for x in per_pixel)) / one.size
    if sampled:
        sigma = max(sigma, float((one * other).mean(axis=-1).std(dtype=float)) / math.sqrt(one.size / one.shape[-1]))
    root = math.sqrt if metric == "rmse" else float
    return Error(*(root(max(x, 0.0)) for x in (value, value - errors * sigma, max(value, 0.0) + errors * sigma)))


@dataclass(frozen=True, eq=False)
class Truth:
    """The whole light in two halves, each of `samples`; `parts` of each half where they are told apart.

    `sampled`: at some of the pixels that are judged.
    """

    halves: tuple[np.ndarray, np.ndarray]
    samples: int
    parts: tuple[dict[str, np.ndarray], ...] = ()
    sampled: bool = False

    @cached_property
    def mean(self) -> np.ndarray:
        return np.asarray((self.halves[0] + self.halves[1]) / 2)

    def error(self, image: np.ndarray, metric: str, noisy: bool = False, errors: float = SURE) -> Error:
        """`noisy`: another seed gives another image, whose error must be covered too."""
        one, other = (image - half for half in self.halves)
        return measure(metric, one, other, self.mean, self.sampled or noisy, errors)

    def noise(self, metric: str) -> float:
        """Return the largest error that is indistinguishable from zero."""
        a, b = self.halves
        if metric in ("rmse", "relmse"):
            return measure(metric, (a - b) / 2, (b - a) / 2, self.mean).most
        return float(METRICS[metric].function(self.mean + (a - b) / 2, self.mean))

    def of(self, metric: str, *names: str) -> Error:
        """The error of an image that lacks these parts and has all others."""
        one, other = (-sum((half[name] for name in names), np.zeros_like(self.mean)) for half in self.parts)
        return measure(metric, one, other, self.mean, self.sampled)

    def every(self, step: int) -> "Truth":
        """At every `step`-th of its pixels."""
        one, other = (np.ascontiguousarray(half[::step, ::step]) for half in self.halves)
        return Truth((one, other), self.samples, sampled=True)

    def sample_noise(self) -> float:
        """The variance of one sample a pixel, on average."""
        return float(np.square(self.halves[0] - self.halves[1], dtype=float).mean()) / 2 * self.samples


Render = Callable[[int, int], dict[str, np.ndarray]]
"""samples, seed -> parts of the whole light."""


def converge(render: Render, metric: str, enough: float, pixels: int, first: int, most: int) -> Truth:
    """Halves with as many samples as it takes to bring the noise below `enough`, or as many as may be."""

    def halves(samples: int, seed: int) -> Truth:
        parts = render(samples, seed), render(samples, seed + 1)
        one, other = (sum(half.values(), np.float32(0)) for half in parts)
        return Truth((np.asarray(one), np.asarray(other)), samples, parts)

    truth = halves(first, 1001)
    falls = 0.5 if metric != "relmse" else 1.0  # the noise is a power of the samples
    for seed in range(2001, 9001, 1000):
        missing = truth.noise(metric) / enough
        if missing <= 1:
            break
        # No more than six times as many at once: samples of a sequence often do better than chance.
        wanted = truth.samples * min(1.1 * missing ** (1 / falls), 6.0)
        wanted = int(min(wanted, MOST_SAMPLES, most // pixels)) - truth.samples
        if wanted <= 0:
            break
        truth = _together(truth, halves(wanted, seed))
    return truth


def _together(a: Truth, b: Truth) -> Truth:
    share = np.float32(b.samples / (a.samples + b.samples))

    def mixed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(x + (y - x) * share)

    one, other = (mixed(x, y) for x, y in zip(a.halves, b.halves, strict=True))
    parts = tuple({k: mixed(x[k], y[k]) for k in x} for x, y in zip(a.parts, b.parts, strict=True))
    return Truth((one, other), a.samples + b.samples, parts)
