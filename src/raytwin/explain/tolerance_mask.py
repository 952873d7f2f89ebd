"""Pixels in which correct tracers differ: at a shadow's edge by where shadow rays start, at outlines by rounding.

A tracer that is correct starts its shadow rays somewhere between 1e-6 and 1e-3 m off the surface, and may compute in
single precision. What that changes is no mistake.
"""

from collections.abc import Callable

import numpy as np

from raytwin.explain.catalogue import SHADOW_TESTS
from raytwin.explain.changes import moved, offset_by
from raytwin.explain.predict import NO_MISTAKE, Array, Pipeline, Predictor
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

MAX_SHARE_OFF = 0.02
"""Share of the pixels: if more are off, such differences do not explain it."""
ASIDE_PIXELS = 1e-3
"""Pixels: by which rays miss the centre in single precision."""
VISIBLE = 1e-6
"""Share of the largest radiance that is visible."""


SAME_WITHIN = 1e-3
"""Share of the scale: values that differ by less are the same."""


STARTS = tuple(offset_by(eps, way) for eps in (1e-3, 3e-4, 1e-4, 1e-5) for way in (False, True))
"""Where shadow rays may start."""
ASIDES = tuple(moved(x, y) for x in (-ASIDE_PIXELS, ASIDE_PIXELS) for y in (-ASIDE_PIXELS, ASIDE_PIXELS))


def varied(pipeline: Pipeline) -> tuple[Pipeline, ...]:
    """The same tracer in other correct ways: with other starts of shadow rays where their test is no mistake, too."""
    tested = tuple(step for step in pipeline if step[0] == "sun_visible")
    rest = tuple(step for step in pipeline if step not in tested)
    starts = STARTS if tested in ((), *SHADOW_TESTS) else ()
    return (*((*rest, *start) for start in starts), *((*pipeline, *aside) for aside in ASIDES))


def doubtful(predict: Callable[[Pipeline], Array], scale: float, steps: Pipeline = NO_MISTAKE) -> Array:
    """(N,) bool: whether tracers that have these steps, and are correct otherwise, differ in a pixel.

    `predict`: steps -> (N, 3), NaN for nothing.
    """
    made = predict(steps)
    found = np.zeros(len(made), bool)
    for other in map(predict, varied(steps)):
        with np.errstate(invalid="ignore"):
            same = (np.abs(other - made) <= SAME_WITHIN * scale) | (np.isnan(other) & np.isnan(made))
        found |= ~same.all(axis=-1)
    return found


def forgiven(got: Array, right: Array, scene: Scene, rung: str) -> Array:
    """The picture with what is correct in place of what correct tracers differ in."""
    with np.errstate(invalid="ignore"):
        off = ~(np.abs(got - right).max(axis=-1) <= VISIBLE * np.abs(right).max()) & np.isfinite(got).all(axis=-1)
    where = np.argwhere(off)
    if not 0 < len(where) <= MAX_SHARE_OFF * off.size:
        return got
    v, u = where.T.astype(float)
    bench = Predictor(scene, u, v, RUNGS[rung].shadows)
    scale = max(float(bench.radiance(NO_MISTAKE).max(initial=0.0)), 1e-300)
    rows, columns = where[doubtful(bench.radiance, scale)].T
    made = got.copy()
    made[rows, columns] = right[rows, columns]
    return made
