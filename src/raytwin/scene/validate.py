"""Check that floats can represent a scene: lengths do not overflow, rounding does not mix up surfaces.

All scenes here are seen from the eye, which is the origin.
"""

import math

import numpy as np

from raytwin.errors import InputError
from raytwin.scene.scene import Scene
from raytwin.scene.shapes import Rectangle

LENGTHS = {"float32": (1e-12, 1e12), "float64": (1e-100, 1e100), "twin": (1e-12, 1e12)}
"""Metres: a rectangle's test takes products of three lengths, which floats can represent between these."""

ROUNDING = {"float32": 2e-6, "float64": 1e-13, "twin": 5e-8}
"""As shares of the distance from the eye: surfaces nearer to each other than this are in one place.

The twin is Mitsuba's float32 with float64 in the pixels in doubt: it separates sheets at 1e-7, and errs in 0.3 % of
the pixels at 1e-8 (`planes-fight` of tests/measure/refusal_experiments.py).
"""


def check_lengths(local: Scene, precision: str) -> None:
    """Raise InputError for a length whose products these floats cannot represent."""
    least, most = LENGTHS[precision]
    for i, thing in enumerate(local.objects):
        for size in (*thing.sizes, max(math.hypot(*thing.center), thing.sizes[0])):
            if not least <= size <= most:
                where = f"objects[{i}] of scene {local.name}"
                raise InputError(where, f"lengths of {least:g} to {most:g} m for {precision}", f"{size:g}")


def check_places(local: Scene, precision: str) -> None:
    """Raise InputError where rounding decides what is seen or shaded: rectangles in one place, an eye in one."""
    ids = [i for i, thing in enumerate(local.objects) if isinstance(thing, Rectangle)]
    flat, rounding = local.planes, ROUNDING[precision]
    center, normal = (np.array(a).reshape(-1, 3) for a in ([t.center for t in flat], [t.normal for t in flat]))
    far = rounding * np.array([math.hypot(*t.center) + math.hypot(*t.half_u) + math.hypot(*t.half_v) for t in flat])
    for k in np.flatnonzero(np.abs((normal * center).sum(axis=1)) <= far).tolist():
        if all(abs(np.dot(flat[k].center, half)) <= np.dot(half, half) for half in (flat[k].half_u, flat[k].half_v)):
            raise InputError(
                f"camera of scene {local.name}", "an eye off every surface", f"one within objects[{ids[k]}]"
            )
    for k in range(1, len(flat)):
        level = np.abs((center[:k] - center[k]) @ normal[k]) <= np.maximum(far[:k], far[k])
        level &= np.linalg.norm(np.cross(normal[:k], normal[k]), axis=1) <= rounding
        for other in np.flatnonzero(level).tolist():
            if _overlap(flat[k], flat[other]):
                found = f"one in the place of objects[{ids[other]}] (raise one of them a little)"
                raise InputError(f"objects[{ids[k]}] of scene {local.name}", "a surface apart from all others", found)


def _overlap(a: Rectangle, b: Rectangle) -> bool:
    """Whether two coplanar rectangles share more than an edge: no direction of an edge separates them."""
    apart, halves = np.subtract(a.center, b.center), (a.half_u, a.half_v, b.half_u, b.half_v)
    return all(
        abs(np.dot(apart, axis)) < (1 - 1e-6) * sum(abs(np.dot(half, axis)) for half in halves) for axis in halves
    )
