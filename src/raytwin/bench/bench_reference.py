"""The converged truth of each rung, and the noise that it still has.

RUNG-center   what one ray through each pixel's centre sees: the tracer in float64; its noise is float32's rounding
RUNG-area     the mean over the pixel: lambert and shadow by many rays of the tracer in float64, sky and path by
              many samples of the twin; in two halves, whose difference tells the noise of their mean
"""

import time
from collections.abc import Callable

import numpy as np

from raytwin import twin
from raytwin.bench.bench_record import ERRORS, Converged
from raytwin.compare import METRICS
from raytwin.renderers.renderer import Renderer
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.speed import ENGINES, background, draw

WHOLE = "path-area"
"""The truth with all light, with which every method can be compared, whatever part of it the method computes."""

BATCH = 16
"""Most samples per pixel between two looks at the clock."""
SEEDS = (10_001, 20_001)


def truth_of(method: Renderer) -> str:
    """The name of the truth that the method's own errors are against."""
    return f"{method.rung}-{method.sampling}"


def converge(
    scene: Scene, name: str, samples: int, seconds: float, clock: Callable = time.perf_counter
) -> tuple[np.ndarray, Converged]:
    """The truth called `name` as (H, W, 3) float32, from at most `samples` a pixel and about `seconds` of time."""
    start = clock()
    rung, sampling = name.split("-")
    w, h = scene.camera.image_size
    if sampling == "center":
        image = background(scene, rung)
        draw(scene, image, rung, "numpy64")
        return image, Converged(name, w, h, 1, clock() - start, rounding(image))
    half = _rendered if RUNGS[rung].noisy else _traced
    sums, taken, count = [np.zeros((h, w, 3)), np.zeros((h, w, 3))], 0, 1
    while taken == 0 or (2 * taken < samples and clock() - start < seconds * taken / (taken + count)):
        for k in (0, 1):
            sums[k] += half(scene, rung, taken, SEEDS[k], count)
        taken += count
        count = min(taken, BATCH)  # 1, 1, 2, 4, 8, then BATCH: the least that must be done takes little time
    a, b = ((s / taken).astype(np.float32) for s in sums)
    image = ((sums[0] + sums[1]) / (2 * taken)).astype(np.float32)
    # The halves differ by twice the noise of their mean.
    apart = measure(image + (a - b) / 2, image)
    return image, Converged(name, w, h, 2 * taken, clock() - start, apart)


def rounding(image: np.ndarray) -> dict[str, float | None]:
    """ERRORS of half a unit in the last place either way: what storing an exact truth as float32 may have cost."""
    exact = image.astype(np.float64)
    rounded = exact + np.spacing(image) * (np.random.default_rng(0).random(image.shape) - 0.5)
    return measure(rounded, exact)


def _traced(scene: Scene, rung: str, first: int, seed: int, count: int) -> np.ndarray:
    """Return the sum of `count` images, rays spread over the pixel by the R2 sequence (Roberts 2018), moved."""
    engine = "drjit64" if _llvm() else "numpy64"
    start = np.random.default_rng(seed).random(2)
    total = np.zeros((scene.camera.height, scene.camera.width, 3))
    for i in range(first, first + count):
        x, y = (start + (i + 1) * np.array([0.7548776662466927, 0.5698402909980532])) % 1 - 0.5
        image = background(scene, rung)
        draw(scene.with_camera(scene.camera.grid(float(x), float(y))), image, rung, engine)
        total += image
    return total


def _rendered(scene: Scene, rung: str, first: int, seed: int, count: int) -> np.ndarray:
    image = twin.render(scene, rung, sampling="area", samples=count, batches=1, seed=seed + first)
    return image.mean.astype(np.float64) * count


def _llvm() -> bool:
    twin.activate()
    try:
        return ENGINES["drjit64"].float_type is not None
    except Exception:
        return False


def measure(image: np.ndarray, truth: np.ndarray) -> dict[str, float | None]:
    """ERRORS of the image."""
    return {name: METRICS[name].function(image, truth) for name in ERRORS}
