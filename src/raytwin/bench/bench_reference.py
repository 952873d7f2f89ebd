"""The converged reference of a light level, with its noise floor.

RUNG-center of lambert and shadow is what one ray through each pixel's centre sees, by the tracer in float64. All else
is sampled, by many samples of the twin.
"""

import time

import numpy as np

from raytwin import twin
from raytwin.image import Image
from raytwin.image_pool import ImagePool
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.speed import background, draw

SEED = 10_001
"""The first seed of a reference: no method that is timed uses one so high."""


def converged(scene: Scene, rung: str, sampling: str, samples: int, seconds: float) -> tuple[Image, float]:
    """Return the reference and its floor: the RMSE that a perfect method would have against it.

    At most `samples` per pixel are taken, and about `seconds` of time, but two samples at least.
    """
    if not RUNGS[rung].sampled(sampling):
        exact = background(scene, rung)
        draw(scene, exact, rung, "numpy64")
        # Rounding to float32 is off by up to half a step either way, evenly.
        return Image(exact), float(np.sqrt(np.mean(np.square(np.spacing(exact), dtype=float)) / 12))
    pool, count, start = ImagePool(), 2, time.perf_counter()
    while pool.samples == 0 or (count > 0 and (time.perf_counter() - start) * (1 + count / pool.samples) < seconds):
        pool.add(twin.render(scene, rung, sampling=sampling, samples=count, seed=SEED + pool.samples))
        count = min(pool.samples, samples - pool.samples)
    image = pool.image
    assert image.variance is not None
    return image, float(np.sqrt(np.mean(image.variance, dtype=float)))
