"""All light of a scene, in parts: what ledgers of pictures on any rung, and fitted splits, are made from.

Results are cached between runs, keyed by a hash of the scene, the tracer's source and the engine, so that changed code
never finds old ones. A damaged cache file is recomputed.
"""

import hashlib
import math
import time
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import raytwin
from raytwin import files
from raytwin.image import BACKGROUND
from raytwin.rungs import RUNGS
from raytwin.scene import Rectangle, Scene, Shape
from raytwin.speed import ENGINES, PARTS, light_parts, trace, walk

PIXELS, PIXELS_NUMPY, SAMPLES = 1 << 18, 1 << 13, 8
"""A larger frame's light is that of every k-th pixel of every k-th row; twice so many samples each."""
SEEDS = 0xA11CE, 0xB0B
"""Seeds that no user's render has, so that no image is compared with its own samples."""
SMALL = 96
"""Pixels across, when objects are taken away one by one to see what they had to do with a part."""
CACHE = files.Cache("light", ".npz", 1 << 29)
ROOT = Path(raytwin.__file__).parent
MADE_BY = *(ROOT / room for room in ("arrays.py", "scene", "lights", "tracer", "speed")), Path(__file__)
"""Files whose source code is part of the cache key."""
REMOVED_BY = {"shadow": ("shadow", 0), "occlusion": ("sky", 2), "bounce 1": ("path", 3), "bounce 2": ("path", 4)}
"""A part of the light -> the cheapest rung that has it, and to what depth; `path` to the whole depth for the others."""

Arrays = Mapping[str, np.ndarray]


class WholeLight:
    """At every `step`-th pixel, each with its own area.

    Two independent halves of the samples: products of one half's error with the other's have no noise in their mean.
    `engine`: the fastest here, of ENGINES. `seconds`: part -> what a whole frame of the rung that has it takes, where
    light is followed with as many samples. `keep`: between runs.
    """

    def __init__(self, scene: Scene, engine: str, depth: int = 8, keep: bool = False) -> None:
        self.scene, self.engine, self.depth, self.keep = scene, engine, depth, keep
        w, h = scene.camera.image_size
        self.step = math.ceil(math.sqrt(w * h / (PIXELS_NUMPY if ENGINES[engine].is_numpy else PIXELS)))
        self.thin = scene.with_camera(scene.camera.every(self.step))
        self.shape = (self.thin.camera.height, self.thin.camera.width, 3)
        names = {(k, part): f"{k} {part}" for k in range(len(SEEDS)) for part in PARTS}
        found = self._stored("halves", self._sampled)
        self.seconds = dict(zip(PARTS[1:], found["seconds"].tolist(), strict=True))
        self.halves = [{part: found[names[k, part]] for part in PARTS} for k in range(len(SEEDS))]

    @cached_property
    def partners(self) -> Arrays:
        """part -> (n, n): by how much it changes on object i (row) when object j is taken away: sum of |change|."""
        n = len(self.scene.objects)
        if not 2 <= n <= 8:
            return {}
        return self._stored("partners", self._taken_away)

    def exact(self, rung: str) -> np.ndarray:
        """A rung that a formula gives, at each pixel's centre, in float64."""
        row = ENGINES[self.engine]._replace(precision="float64")
        double = next(name for name, known in ENGINES.items() if known == row)
        return self._stored(rung, lambda: {"mean": trace(self.thin, rung, double).mean})["mean"]

    def _stored(self, what: str, make: Callable[[], Arrays]) -> Arrays:
        if not self.keep:
            return make()
        code, scene = files.made_by(MADE_BY, ("numpy", "drjit")), self.scene
        about = (code, what, self.engine, self.depth, scene.camera, scene.objects, scene.lights)
        key = hashlib.sha256(msgspec.json.encode((*about, PIXELS, PIXELS_NUMPY), enc_hook=files.plain)).hexdigest()[:32]
        found: Arrays | None = CACHE.load_arrays(key)
        if found is None:
            found = make()
            CACHE.store_arrays(key, found)
        return found

    def _sampled(self) -> Arrays:
        halves = [
            light_parts(self.thin, self.engine, samples=SAMPLES, seed=seed, depth=self.depth, side=1 / self.step)
            for seed in SEEDS
        ]
        found = {f"{k} {part}": image.mean for k, half in enumerate(halves) for part, image in half.items()}
        seconds = [self._seconds(*REMOVED_BY.get(part, ("path", self.depth))) for part in PARTS[1:]]
        return found | {"seconds": np.array(seconds, np.float32)}

    def _seconds(self, rung: str, depth: int) -> float:
        """Return a frame's seconds, scaled from the probed pixels and a few samples; timed in a second call."""
        few, side, began = 4, 1 / self.step, 0.0
        for _ in range(2):
            began = time.perf_counter()
            if depth:
                walk(self.thin, rung, self.engine, samples=few, depth=depth, side=side, surface=False)
            else:
                trace(self.thin, rung, self.engine)
        times = SAMPLES * len(SEEDS) / few if depth else 1.0
        return (time.perf_counter() - began) * times * self.step**2

    def _taken_away(self) -> Arrays:
        """On a small frame, from the same random numbers, so that what does not depend on j does not change."""
        n, scene = len(self.scene.objects), self.scene
        w, h = scene.camera.image_size
        small = scene.with_camera(scene.camera.resized(SMALL, max(1, round(SMALL * h / w))))
        ids = _ids(small, self.engine)
        before = light_parts(small, self.engine, samples=16, depth=self.depth)
        found = {part: np.zeros((n, n), np.float32) for part in PARTS[1:]}
        for j in range(n):
            without = msgspec.structs.replace(
                small, objects=tuple(gone(thing) if i == j else thing for i, thing in enumerate(small.objects))
            )
            after = light_parts(without, self.engine, samples=16, depth=self.depth)
            use = (ids == _ids(without, self.engine)) & (ids > BACKGROUND) & (ids != j)
            for part, changes in found.items():
                change = np.abs(after[part].mean - before[part].mean).sum(axis=-1)
                changes[:, j] = np.bincount(ids[use], change[use], minlength=n)
        return found


def _ids(scene: Scene, engine: str) -> np.ndarray:
    surface = trace(scene, "surface", engine).surface
    assert surface is not None  # the tracer always has one
    return surface.ids


def gone(thing: Shape) -> Shape:
    """The same kind of object, too small and too far below to be met."""
    far: Any = (0.0, 0.0, -1e6)
    if isinstance(thing, Rectangle):
        return msgspec.structs.replace(thing, center=far, half_u=(1e-9, 0.0, 0.0), half_v=(0.0, 1e-9, 0.0))
    return msgspec.structs.replace(thing, center=far, radius=1e-9)


# ------------------------------------------------------------------------------------------------ of any picture


def sampled_parts(scene: Scene, rung: str, engine: str, sampling: str) -> Callable[[int], dict[str, Any]]:
    """Return k -> the sampled parts of a light level at every k-th pixel, twice; for `light_decomposition.split`."""

    def parts(step: int) -> dict[str, Any]:
        row = RUNGS[rung]
        if not row.noisy:
            return {}
        thin, side = scene.with_camera(scene.camera.every(step)), 1 / step if sampling == "area" else 0.0
        samples = 64 if not ENGINES[engine].is_numpy else SAMPLES
        one, other = (
            light_parts(thin, engine, samples=samples, seed=seed, depth=row.depth or 2, side=side) for seed in SEEDS
        )
        return {name: (one[name].mean, other[name].mean) for name in PARTS[1:] if not row.lacks(name)}

    return parts
