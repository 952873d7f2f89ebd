"""A scene while it is looked at: every k-th pixel of every k-th row first, each with its own area; all where needed.

So edges and textures count as much among the pixels that are looked at as in the whole frame.
"""

import math
import time
from dataclasses import replace

import numpy as np

from raytwin.analysis.recommend.bounds import Bounds
from raytwin.analysis.recommend.converged import Truth, converge
from raytwin.scene import Scene
from raytwin.speed import ENGINES, light_parts, walk

DEEP, BOUNCES = 16, 4
"""The whole light's depth, counted as a rung's; the bounces that are told apart, the last with all that follow."""

PIXELS, PIXELS_NUMPY = 1 << 15, 1 << 12
"""So many are looked at first."""

FIRST = 8, 2
"""Samples of each half to begin with: of a few pixels, of the whole frame."""

MOST_WALKS, MOST_WALKS_NUMPY = 1 << 27, 1 << 21
"""A half of the truth has no more in all, and what is verified an eighth."""


class Look:
    """What is known of a scene: `low`, the whole light at every `step`-th pixel; `full`, of the whole frame."""

    def __init__(self, scene: Scene, tolerance: float, metric: str, engine: str) -> None:
        self.scene, self.tolerance, self.metric, self.engine = scene, tolerance, metric, engine
        self.slow = ENGINES[engine].is_numpy
        self.bounds = Bounds(scene)
        w, h = scene.camera.image_size
        self.step = math.ceil(math.sqrt(w * h / (PIXELS_NUMPY if self.slow else PIXELS)))
        self.thin = scene.with_camera(scene.camera.every(self.step))
        self.pixels = self.thin.camera.width * self.thin.camera.height
        self.most = MOST_WALKS_NUMPY if self.slow else MOST_WALKS
        self.low = converge(self.parts, metric, tolerance / 3, self.pixels, FIRST[0], self.most)
        self.low = replace(self.low, sampled=self.step > 1)
        self._full: Truth | None = None
        self.sample_seconds = 0.0

    def parts(self, samples: int, seed: int, scene: Scene | None = None) -> dict[str, np.ndarray]:
        found = light_parts(
            scene or self.thin, self.engine, samples=samples, seed=seed, depth=DEEP, side=1 / self.step, bounces=BOUNCES
        )
        return {name: image.mean for name, image in found.items()}

    def bound(self, largest: float) -> float | None:
        return self.bounds.of_metric(self.metric, largest)

    @property
    def full(self) -> Truth:
        """The truth at full size, made when it is first asked for."""
        if self._full is None:
            w, h = self.scene.camera.image_size
            self._full = converge(self._whole, self.metric, self.tolerance / 3, w * h, FIRST[1], self.most)
        return self._full

    def _whole(self, samples: int, seed: int) -> dict[str, np.ndarray]:
        began = time.perf_counter()
        image = walk(self.scene, "path", self.engine, samples=samples, seed=seed, depth=DEEP, surface=False)
        self.sample_seconds = (time.perf_counter() - began) / samples  # the last is the warmest
        return {"whole": image.mean}

    @property
    def frame(self) -> int:
        """Pixels in all."""
        return self.scene.camera.width * self.scene.camera.height
