"""Predictions for scenes that all submissions share: computed once per mistake, compared with every submission."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from raytwin.diagnose.pixel_sample import PixelSample, outlines
from raytwin.diagnose.predict import Array, Pipeline, Predictor
from raytwin.scene import Scene

PIXELS, EDGES = 250, 150
"""Pixels that are looked at: of all, and of those beside an outline."""


class Shown(NamedTuple):
    """(W, N, 3) `made`: what W mistakes show at the pixels `at` (N,) of a picture, which `weight` (N,)."""

    at: Array
    weight: Array
    made: Array


def costs(sight: PixelSample, ways: tuple[Pipeline, ...]) -> Array:
    """(W,): of each mistake the cost of what it leaves of this view."""
    bench = sight.bench
    assert isinstance(bench, Predictor)
    at = bench.scene, sight.step, bench.shadows, sight.view.points, bench.brightest
    index, weight, made = _shown(*at, ways)
    made = np.clip(made, 0, 1) if sight.view.clipped else made
    half = np.zeros(sight.view.shown.shape) if sight.view.half is None else sight.view.half
    shown, slack = (x.reshape(-1, 3)[index] for x in (sight.view.shown, half))
    part = replace(sight, shown=shown, slack=slack, weight=weight)
    return part.costs(part.off(made))


@lru_cache(maxsize=4)
def _shown(scene: Scene, step: int, shadows: bool, points: bool, brightest: float, ways: tuple[Pipeline, ...]) -> Shown:
    width, height = (-(-n // step) for n in scene.camera.image_size)
    v, u = step * np.indices((height, width), float).reshape(2, -1)
    edge = outlines(Predictor(scene, u, v).seen().ids.reshape(height, width)).ravel()
    rng, index, weight = np.random.default_rng(0), [], []
    for there, most in ((np.flatnonzero(~edge), PIXELS), (np.flatnonzero(edge), EDGES)):
        n = min(most, there.size)
        index.append(np.sort(rng.choice(there, n, replace=False)))
        weight.append(np.full(n, there.size / max(n, 1) / edge.size))
    chosen = np.concatenate(index)
    bench = Predictor(scene, u[chosen], v[chosen], shadows, brightest)
    made = np.empty((len(ways), chosen.size, 3))
    with np.errstate(all="ignore"):
        for k, way in enumerate(ways):
            try:
                made[k] = bench.points(way) if points else bench.picture(way)
            except Exception:  # a slip may ask for what this scene does not have
                made[k] = np.nan
    return Shown(chosen, np.concatenate(weight), made)
