"""All light of a scene, in parts: what the ledger of a picture on any light level is made from."""

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from raytwin.fast import ENGINES, PARTS, light_parts, trace
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

PIXELS, PIXELS_NUMPY, SAMPLES = 1 << 16, 1 << 13, 4
"""Of a larger frame every k-th pixel of every k-th row is used. Samples per pixel of each half."""
FEW_OBJECTS, MIN_PIXELS = 64, 1 << 12
"""From so many objects on, pixels get fewer as objects get more, down to so many: the time stays the same."""
SEEDS = 0xA11CE, 0xB0B
"""Seeds that no user's render has, so that no image is compared with its own samples."""
DEPTH_2_TIME = 0.7
"""Time at depth 2 over that at full depth, in scenes with balls on a floor."""
REMOVED_BY = {"shadow": ("shadow", 0), "occlusion": ("sky", 2), "bounce 1": ("path", 3), "bounce 2": ("path", 4)}
"""A part of the light -> the cheapest rung that has it, and to what depth; `path` to the whole depth for the others."""


class WholeLight:
    """The parts of the light at every `step`-th pixel, each over its own area: `halves`, part -> (h, w, 3) each.

    The halves are independent: products of one half's error with the other's have no noise in their mean. `engine`:
    the fastest here, of ENGINES.
    """

    def __init__(self, scene: Scene, engine: str, depth: int = 8) -> None:
        self.scene, self.engine, self.depth = scene, engine, depth
        w, h = scene.camera.image_size
        pixels = PIXELS_NUMPY if ENGINES[engine].is_numpy else PIXELS
        pixels = max(
            MIN_PIXELS,
            pixels * FEW_OBJECTS // max(FEW_OBJECTS, len(scene.objects)),
        )
        self.step = math.ceil(math.sqrt(w * h / pixels))
        self.thin = scene.with_camera(scene.camera.every(self.step))
        self.shape = (self.thin.camera.height, self.thin.camera.width, 3)
        self.halves: list[dict[str, np.ndarray]] = []
        for seed in SEEDS:
            began = time.perf_counter()
            half = light_parts(self.thin, engine, samples=SAMPLES, seed=seed, depth=depth, side=1 / self.step)
            self.walked = (time.perf_counter() - began) * len(SEEDS) * self.step**2  # the second: the first compiles
            self.halves.append({name: image.mean for name, image in half.items()})

    def seconds(self, part: str) -> float:
        """Estimate the seconds of a frame on the cheapest rung that has the part, with the samples of both halves.

        Sampled rungs cost what the walks here did: DEPTH_2_TIME of it at depth 2, and linearly more with depth. The
        others are timed in their second call.
        """
        rung, depth = REMOVED_BY.get(part, ("path", self.depth))
        if depth:
            return self.walked * (DEPTH_2_TIME + (1 - DEPTH_2_TIME) * (depth - 2) / max(self.depth - 2, 1))
        began = 0.0
        for _ in range(2):
            began = time.perf_counter()
            trace(self.thin, rung, self.engine)
        return (time.perf_counter() - began) * self.step**2

    def exact(self, rung: str) -> np.ndarray:
        """A rung that a formula gives, at each pixel's center, in float64."""
        row = ENGINES[self.engine]._replace(precision="float64")
        double = next(name for name, known in ENGINES.items() if known == row)
        return np.asarray(trace(self.thin, rung, double).mean)


def sampled_parts(scene: Scene, rung: str, engine: str, sampling: str) -> Callable[[int], Mapping[str, Any]]:
    """Return k -> the sampled parts of a light level at every k-th pixel, twice; for `light_decomposition.split`."""

    def parts(step: int) -> dict[str, Any]:
        row = RUNGS[rung]
        if not row.noisy:
            return {}
        thin, side = scene.with_camera(scene.camera.every(step)), 1 / step if sampling == "area" else 0.0
        samples = 8 if ENGINES[engine].is_numpy else 64
        one, other = (
            light_parts(thin, engine, samples=samples, seed=seed, depth=row.depth or 2, side=side) for seed in SEEDS
        )
        return {name: (one[name].mean, other[name].mean) for name in PARTS[1:] if not row.lacks(name)}

    return parts
