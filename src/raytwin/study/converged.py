"""The converged reference of a light level, in two independent halves, and unbiased errors against it.

    lambert, shadow   the tracer in float64: one ray through each pixel's center, or many spread over its area
    sky, path         many samples of the twin

The squared error of an image x is estimated by mean((x - a)(x - b)). The noises of the halves a and b are independent,
so their product has none in its mean, and an error far below the noise of a pixel can be measured. The estimate's own
standard error follows from a - b: it is the floor.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from raytwin import twin
from raytwin.compare.metrics import METRICS
from raytwin.errors import MachineError
from raytwin.fast import ENGINES, background, draw
from raytwin.images.image import Image
from raytwin.images.image_pool import ImagePool
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

UNCERTAINTY = 2.0
"""Standard errors between an error's value and its bounds."""
SEEDS = 10_001, 20_001
"""Of the two halves. No other render of raytwin has these."""
MAX_SAMPLES = 256
"""Samples per pixel of one render, at most."""
MAX_TIMED_SAMPLES = 16
"""The same where a time limit is checked after each render."""
SQUARES = "rmse", "relmse"
"""Metrics that are means of squares, so that two halves give an unbiased estimate."""
R2 = np.array([0.7548776662466927, 0.5698402909980532])
"""Steps of the R2 sequence in x and y (Roberts 2018)."""


class Error(NamedTuple):
    """A metric's value, and its bounds UNCERTAINTY standard errors below and above."""

    value: float
    least: float
    most: float


def unbiased_error(metric: str, one: np.ndarray, other: np.ndarray, whole: np.ndarray, sampled: bool = False) -> Error:
    """Return the metric of an error of which `one` and `other` (H, W, 3) are two estimates with independent noise.

    `whole` (H, W, 3): the reference. With d the estimates' difference and m their mean, the variance of a product is at
    most m² d² + (d²/2)². The noise of the three channels of a pixel is taken as one. `sampled`: other random numbers
    would give another image, so the bounds also cover the scatter of the products over the pixels. A metric that is no
    mean of squares has no unbiased estimate: its value is that of m, which noise only raises.
    """
    mean, difference = (one + other) / 2, one - other
    if metric not in SQUARES:
        function = METRICS[metric].function
        value, noise = function(whole + mean, whole), function(whole + difference / 2, whole)
        return Error(value, max(value - noise, 0.0), value)
    if metric == "relmse":  # the mean square of weighted errors
        weight = 1 / np.sqrt(np.square(whole) + np.float32(0.01))
        one, other, mean, difference = (x * weight for x in (one, other, mean, difference))
    value = float((one * other).mean(dtype=float))
    per_pixel = (np.square(x.sum(axis=-1)) for x in (np.abs(mean * difference), np.square(difference) / 2))
    sigma = math.sqrt(sum(float(x.sum(dtype=float)) for x in per_pixel)) / one.size
    if sampled:
        scatter = float((one * other).mean(axis=-1).std(dtype=float))
        sigma = max(sigma, scatter / math.sqrt(one.size / one.shape[-1]))
    root = math.sqrt if metric == "rmse" else float
    bounds = value, value - UNCERTAINTY * sigma, max(value, 0.0) + UNCERTAINTY * sigma
    return Error(*(root(max(x, 0.0)) for x in bounds))


@dataclass(frozen=True, eq=False)
class Reference:
    """A light level at one `sampling` of the pixel, with almost no noise.

    `image`: the mean of both `halves`, (H, W, 3) each. `image.samples` counts both. `seconds`: what it took.
    """

    rung: str
    sampling: str
    image: Image
    halves: tuple[np.ndarray, np.ndarray]
    seconds: float

    @property
    def name(self) -> str:
        """Light level and sampling: "path-area"."""
        return f"{self.rung}-{self.sampling}"

    def error(self, image: np.ndarray, metric: str = "rmse", noisy: bool = False) -> Error:
        """Return the metric of `image` (H, W, 3). `noisy`: the bounds must hold for another seed, too."""
        one, other = (image - half for half in self.halves)
        return unbiased_error(metric, one, other, self.image.mean, noisy)

    def floor(self, metric: str = "rmse") -> float:
        """Return the largest value of the metric that cannot be told from 0.

        A formula's image has no noise: its floor is what rounding to float32 may change.
        """
        a, b = self._rounded if self.halves[0] is self.halves[1] else self.halves
        noise = (a - b) / 2
        return unbiased_error(metric, noise, -noise if metric in SQUARES else noise, self.image.mean).most

    @property
    def noise(self) -> float:
        """Return the RMSE that a perfect method has against `image`."""
        a, b = self._rounded if self.halves[0] is self.halves[1] else self.halves
        return float(np.sqrt(np.mean(np.square(a - b), dtype=float))) / 2

    @cached_property
    def _rounded(self) -> tuple[np.ndarray, np.ndarray]:
        """Half a unit in the last place either way."""
        exact, rng = self.image.mean.astype(float), np.random.default_rng(0)
        one, other = (exact + np.spacing(self.image.mean) * (rng.random(exact.shape) - 0.5) for _ in SEEDS)
        return one, other


def converged(
    scene: Scene,
    rung: str = "path",
    sampling: str = "area",
    *,
    samples: int = 4096,
    seconds: float = math.inf,
    enough: float = 0.0,
    metric: str = "rmse",
    depth: int | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Reference:
    """Return the reference of `rung` from at most `samples` per pixel in all, about `seconds` long.

    It ends earlier where the floor in `metric` is at most `enough`. `depth`: of `path`, the rung's own where not given.
    Without a time limit the result depends on the arguments alone.
    """
    start = clock()
    if not RUNGS[rung].sampled(sampling):
        exact = background(scene, rung)
        draw(scene, exact, rung, "numpy64")
        return Reference(rung, sampling, Image(exact), (exact, exact), clock() - start)
    pools, taken, count = (ImagePool(), ImagePool()), 0, 1
    largest = MAX_SAMPLES if seconds == math.inf else MAX_TIMED_SAMPLES
    found: Reference | None = None
    while found is None or (
        2 * taken < samples
        and clock() - start < seconds * taken / (taken + count)
        and not found.floor(metric) <= enough
    ):
        for pool, seed in zip(pools, SEEDS, strict=True):
            pool.add(_half(scene, rung, sampling, taken, seed, count, depth))
        taken += count
        count = min(taken, largest)  # 1, 1, 2, 4, ...: the least that must be done takes little time
        found = _pooled(rung, sampling, pools, clock() - start)
    return found


def _pooled(rung: str, sampling: str, pools: tuple[ImagePool, ImagePool], seconds: float) -> Reference:
    one, other = (pool.image for pool in pools)
    whole = ImagePool()
    whole.add(one)
    whole.add(other)
    return Reference(rung, sampling, whole.image, (one.mean, other.mean), seconds)


def _half(scene: Scene, rung: str, sampling: str, first: int, seed: int, count: int, depth: int | None) -> Image:
    """Return the mean of `count` samples per pixel, the `first` of them being that many after the seed's own first."""
    if RUNGS[rung].noisy:
        return twin.render(
            scene, rung, sampling=sampling, samples=count, batches=1, seed=seed + first, max_depth=depth, cache=False
        )
    engine = "drjit64" if _has_drjit() else "numpy64"
    start = np.random.default_rng(seed).random(2)
    total = np.zeros((scene.camera.height, scene.camera.width, 3))
    for i in range(first, first + count):
        x, y = (start + (i + 1) * R2) % 1 - 0.5
        image = background(scene, rung)
        draw(scene.with_camera(scene.camera.grid(float(x), float(y))), image, rung, engine)
        total += image
    return Image(total / count, samples=count)


def _has_drjit() -> bool:
    twin.activate()
    try:
        return ENGINES["drjit64"].float_type is not None
    except (ImportError, MachineError):
        return False
