"""Pixels in which right tracers differ: at a shadow's edge by where shadow rays start, at outlines by rounding.

A tracer that is right starts its shadow rays somewhere between 1e-6 and 1e-3 m off the surface, and may compute in
single precision. What that changes is no mistake.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from raytwin.diagnose.catalogue import TESTS
from raytwin.diagnose.changes import at, offset_by
from raytwin.diagnose.predict import RIGHT, Array, Bench, Change, Steps, hidden
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Scene

FEW = 0.02
"""Share of the pixels: if more are off, such differences do not explain it."""
ASIDE = 1e-3
"""Pixels: by which rays miss the centre in single precision."""
VISIBLE = 1e-6
"""Share of the largest radiance that is visible."""


SEEN = 1e-3
"""Share of the scale: values that differ by less are the same."""


def _aside(u: Array, v: Array, camera: Camera, x: float, y: float) -> tuple[Array, Array]:
    return u + x, v + y


def _started(steps: Steps, test: Callable[..., Array]) -> Steps:
    """With another start of shadow rays; not where their test is the mistake."""
    return steps._replace(blocked=test) if steps.blocked in (hidden, *TESTS) else steps


VARIATIONS: tuple[Change, ...] = (
    *(partial(_started, test=offset_by(eps, way)) for eps in (1e-3, 3e-4, 1e-4, 1e-5) for way in (False, True)),
    *(at(partial(_aside, x=x, y=y)) for x in (-ASIDE, ASIDE) for y in (-ASIDE, ASIDE)),
)


def doubtful(predict: Callable[[Steps], Array], scale: float, steps: Steps = RIGHT) -> Array:
    """(N,) bool: whether tracers that have these steps, and are right otherwise, differ in a pixel.

    `predict`: steps -> (N, 3), NaN for nothing.
    """
    made = predict(steps)
    found = np.zeros(len(made), bool)
    for change in VARIATIONS:
        varied = change(steps)
        if varied is not steps:
            other = predict(varied)
            with np.errstate(invalid="ignore"):
                same = (np.abs(other - made) <= SEEN * scale) | (np.isnan(other) & np.isnan(made))
            found |= ~same.all(axis=-1)
    return found


def forgiven(got: Array, right: Array, scene: Scene, rung: str) -> Array:
    """The picture with what is right in place of what right tracers differ in."""
    with np.errstate(invalid="ignore"):
        off = ~(np.abs(got - right).max(axis=-1) <= VISIBLE * np.abs(right).max()) & np.isfinite(got).all(axis=-1)
    where = np.argwhere(off)
    if not 0 < len(where) <= FEW * off.size:
        return got
    v, u = where.T.astype(float)
    bench = Bench(scene, u, v, RUNGS[rung].shadows)
    scale = max(float(bench.radiance(RIGHT).max(initial=0.0)), 1e-300)
    rows, columns = where[doubtful(bench.radiance, scale)].T
    made = got.copy()
    made[rows, columns] = right[rows, columns]
    return made
