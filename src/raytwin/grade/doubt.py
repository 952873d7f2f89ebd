"""Pixels in which right tracers differ: at a shadow's edge by where shadow rays start, at outlines by rounding.

A tracer that is right starts its shadow rays somewhere between 1e-6 and 1e-3 m off the surface, and may compute in
single precision. What that changes is no mistake.
"""

from functools import partial

import numpy as np

from raytwin.grade.catalogue import at, offset_by, put
from raytwin.grade.predict import RIGHT, Array, Bench, Change
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Scene

FEW = 0.02
"""Of the pixels: where more are off, it is not by such differences."""
ASIDE = 1e-3
"""Pixels: by which rays miss the centre in single precision."""
VISIBLE = 1e-6
"""Of the largest radiance."""


def _aside(u: Array, v: Array, camera: Camera, x: float, y: float) -> tuple[Array, Array]:
    return u + x, v + y


VARIATIONS: tuple[Change, ...] = (
    *(put(blocked=offset_by(eps, along_light)) for eps in (1e-3, 3e-4, 1e-4, 1e-5) for along_light in (False, True)),
    *(at(partial(_aside, x=x, y=y)) for x in (-ASIDE, ASIDE) for y in (-ASIDE, ASIDE)),
)  # fmt: skip


def doubtful(scene: Scene, rung: str, where: Array) -> Array:
    """Of pixels (N, 2), row and column: (N,) bool, whether right tracers differ there."""
    v, u = np.asarray(where, float).T
    bench = Bench(scene, u, v, RUNGS[rung].shadows)
    right = bench.radiance(RIGHT)
    limit = 1e-3 * max(float(right.max(initial=0.0)), 1e-300)
    found = np.zeros(len(u), bool)
    for change in VARIATIONS:
        found |= np.abs(bench.radiance(change(RIGHT)) - right).max(axis=-1) > limit
    return found


def forgiven(got: Array, right: Array, scene: Scene, rung: str) -> Array:
    """The picture with what is right in place of what right tracers differ in."""
    with np.errstate(invalid="ignore"):
        off = ~(np.abs(got - right).max(axis=-1) <= VISIBLE * np.abs(right).max()) & np.isfinite(got).all(axis=-1)
    where = np.argwhere(off)
    if not 0 < len(where) <= FEW * off.size:
        return got
    rows, columns = where[doubtful(scene, rung, where)].T
    made = got.copy()
    made[rows, columns] = right[rows, columns]
    return made
