"""The converged truth of each rung, the noise that it still has, and the verdict of the same rung's twin.

RUNG-center   what one ray through each pixel's centre sees: lambert and shadow by the tracer in float64; its noise is
              float32's rounding
RUNG-area     the mean over the pixel: lambert and shadow by many rays of the tracer in float64
sky, path     many samples of the twin

What is sampled comes in two halves, whose difference tells the noise of their mean.
"""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from raytwin import twin
from raytwin.analysis.beside_twin import compare_with_twin
from raytwin.bench.bench_record import ERRORS, Converged
from raytwin.compare import METRICS, Comparison
from raytwin.image import Image
from raytwin.image_pool import ImagePool
from raytwin.renderers.renderer import Renderer
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, Tolerance
from raytwin.speed import ENGINES, background, draw
from raytwin.workflows.settings import CompareSettings

WHOLE = "path-area"
"""The truth with all light, with which every method can be compared, whatever part of it the method computes."""

BATCH = 16
"""Most samples per pixel between two looks at the clock."""
SEEDS = (10_001, 20_001)


Half = Callable[[Scene, str, str, int, int, int], Image]
"""(scene, rung, sampling, first sample, seed, count) -> the mean of so many samples per pixel."""


def truth_of(method: Renderer) -> str:
    """The name of the truth that the method's own errors are against."""
    return f"{method.rung}-{method.sampling}"


def converge(
    scene: Scene, name: str, samples: int, seconds: float, clock: Callable = time.perf_counter
) -> tuple[Image, Converged]:
    """Return the truth called `name`, from at most `samples` per pixel and about `seconds` of time."""
    start = clock()
    rung, sampling = name.split("-")
    w, h = scene.camera.image_size
    if not RUNGS[rung].sampled(sampling):
        exact = background(scene, rung)
        draw(scene, exact, rung, "numpy64")
        return Image(exact), Converged(name, w, h, 1, clock() - start, rounding(exact))
    half: Half = _rendered if RUNGS[rung].noisy else _traced
    halves, whole, taken, count = (ImagePool(), ImagePool()), ImagePool(), 0, 1
    while taken == 0 or (2 * taken < samples and clock() - start < seconds * taken / (taken + count)):
        for pool, seed in zip(halves, SEEDS, strict=True):
            pool.add(half(scene, rung, sampling, taken, seed, count))
        taken += count
        count = min(taken, BATCH)  # 1, 1, 2, 4, 8, then BATCH: the least that must be done takes little time
    a, b = (pool.image for pool in halves)
    whole.add(a)
    whole.add(b)
    image = whole.image
    # The halves differ by twice the noise of their mean.
    apart = measure(image.mean + (a.mean - b.mean) / 2, image.mean)
    return image, Converged(name, w, h, 2 * taken, clock() - start, apart)


def twin_of(scene: Scene, name: str, truth: Image) -> Image:
    """Return the twin that a verdict is against: `truth`, called `name`, where it is the twin's, else a render."""
    rung, sampling = name.split("-")
    if RUNGS[rung].noisy:
        return truth
    return twin.render(
        scene, rung, sampling=sampling, samples=CompareSettings(rung=rung, sampling=sampling).twin_samples
    )


def judge(method: Renderer, image: Image, reference: Image, scene: Scene, tolerance: Tolerance) -> Comparison:
    """Compare a method's image with the twin's, as `raytwin compare` does at the method's own light level."""
    if method.noisy and image.variance is None:
        image = replace(image, batches=1)  # or one sample would count as free of noise
    return compare_with_twin(image, reference, scene, tolerance)


def rounding(image: np.ndarray) -> dict[str, float | None]:
    """ERRORS of half a unit in the last place either way: what storing an exact truth as float32 may have cost."""
    exact = image.astype(np.float64)
    rounded = exact + np.spacing(image) * (np.random.default_rng(0).random(image.shape) - 0.5)
    return measure(rounded, exact)


def _traced(scene: Scene, rung: str, sampling: str, first: int, seed: int, count: int) -> Image:
    """Return the mean of `count` images, rays spread over the pixel by the R2 sequence (Roberts 2018), moved."""
    engine = "drjit64" if _llvm() else "numpy64"
    start = np.random.default_rng(seed).random(2)
    total = np.zeros((scene.camera.height, scene.camera.width, 3))
    for i in range(first, first + count):
        x, y = (start + (i + 1) * np.array([0.7548776662466927, 0.5698402909980532])) % 1 - 0.5
        image = background(scene, rung)
        draw(scene.with_camera(scene.camera.grid(float(x), float(y))), image, rung, engine)
        total += image
    return Image(total / count, samples=count)


def _rendered(scene: Scene, rung: str, sampling: str, first: int, seed: int, count: int) -> Image:
    return twin.render(scene, rung, sampling=sampling, samples=count, batches=1, seed=seed + first)


def _llvm() -> bool:
    twin.activate()
    try:
        return ENGINES["drjit64"].float_type is not None
    except Exception:
        return False


def measure(image: np.ndarray, truth: np.ndarray) -> dict[str, float | None]:
    """ERRORS of the image."""
    return {name: METRICS[name].function(image, truth) for name in ERRORS}
