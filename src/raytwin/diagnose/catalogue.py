"""The catalogue of mistakes: what is made wrong in tracers, as data, a row each, with the sentence that helps.

A fault has one or more `ways` to be made, each a change of the tracer's `Steps` (see `predict`), and all called by the
same sentence. To add a fault, add a row; to add a way, add it to its row. Factors that are not known beforehand are
rows of `fitted`.
"""

from collections.abc import Sequence
from functools import partial
from itertools import islice, product
from typing import Any

import msgspec
import numpy as np

from raytwin.diagnose.camera_faults import CAMERAS
from raytwin.diagnose.changes import (
    CAMERA,
    NORMALS,
    SHADOW,
    Casters,
    Fault,
    both,
    made_unit,
    normals,
    offset_by,
    placed,
    row,
    seen,
    shadows,
    three,
)
from raytwin.diagnose.geometry_faults import SOLVERS
from raytwin.diagnose.light_faults import LIGHTS
from raytwin.diagnose.order_faults import ORDERS
from raytwin.diagnose.picture_faults import OUTPUTS, SAMPLINGS
from raytwin.diagnose.predict import RIGHT, Array, Change, Hits, Steps, hidden, others_hide
from raytwin.diagnose.shadow_faults import SHADOWS, all_dark
from raytwin.diagnose.surface_faults import NORMALS_, PLANES_BY_ORIGIN, turned_by_origin, turned_to_eye
from raytwin.scene import Camera

ACNE = row("acne", SHADOW,
    "speckles: rounding puts the start of shadow rays now above, now below the surface, so that it shades itself; "
    "start them a little off it, or leave its own object out", lambda s: s, shadows(all_dark))  # fmt: skip
"""Which points are dark is chance: told by pixels that are all as lit or as dark as can be, and mixed."""

CHANCES = (
    *(row("plane-normal-by-origin", NORMALS, PLANES_BY_ORIGIN,
          *(normals(partial(turned_by_origin, sign=k, flat=flat)) for flat in (1, -1))) for k in (1, -1)),
    ACNE,
)  # fmt: skip
"""Faults of which rounding decides, pixel by pixel, what is seen: one of their ways."""

CACHED = (
    "a picture is drawn with the rays of another scene of the same size: what is kept between calls has to be found "
    "by all that it depends on, K and dist too, not by width and height alone"
)


def _kept(own: Camera, kept: dict[Any, Camera]) -> Camera:
    return kept.get(own.image_size, own)


def cached(first: Sequence[Camera], cameras: Sequence[Camera]) -> tuple[Fault, ...]:
    """Rays that are kept by the picture's size: with what one of the first gives all cameras of its size are used."""
    by_size: dict[tuple[int, int], list[Camera]] = {}
    for one in dict.fromkeys(first):
        if any(other.image_size == one.image_size and other != one for other in cameras):
            by_size.setdefault(one.image_size, []).append(one)

    def turned(own: Camera, kept: dict[Any, Camera]) -> Camera:
        """With the kept one's axes, from its own eye."""
        R = _kept(own, kept).R_cam_board
        return msgspec.structs.replace(own, R_cam_board=R, t_cam_board=three(-np.asarray(R) @ np.array(own.eye)))

    ways: list[Change] = []
    for one_each in islice(product(*by_size.values()), 8 if by_size else 0):
        kept = {one.image_size: one for one in one_each}
        inner = seen(partial(_kept, kept=kept))
        eyes = (partial(turned, kept=kept), partial(_kept, kept=kept))
        ways += [inner, *(both(inner, placed(eye)) for eye in eyes)]
    return (row("rays-kept", CAMERA, CACHED, *ways),) if ways else ()


FACTS = frozenset({"nothing-met", "empty"})
"""Faults that say what is seen, whatever has brought it about: of others that would, too, nothing is said."""

FAULTS: tuple[Fault, ...] = (
    *CAMERAS, *SOLVERS, *ORDERS, *NORMALS_, *LIGHTS, *SHADOWS, *SAMPLINGS, *OUTPUTS,
)  # fmt: skip
"""Every mistake there is, by stage."""


def faced(s: Steps) -> Steps:
    """Normals of spheres, too, are turned to the eye."""
    return normals(lambda n, p, rays, thing: turned_to_eye(n, rays))(s)


def tested(f: Any) -> Change:
    """Another shadow test, where that is not the mistake itself."""
    return lambda s: s._replace(blocked=f) if s.blocked is hidden else s


COARSE = (others_hide, offset_by(1e-4), offset_by(1e-4, True))
TESTS = (*COARSE, *(offset_by(eps, way) for eps in (1e-6, 1e-5, 1e-3) for way in (False, True)))
"""Ways to test for shadows that are all right: the own object left out, or a start a little off the surface."""


def seen_alone(s: Steps) -> Steps:
    """What rays meet is wrong for the eye's rays; another function, which is right, tests shadow rays."""
    return _apart(s, s, RIGHT)


def in_shadow_alone(s: Steps) -> Steps:
    """The other way round."""
    return _apart(s, RIGHT, s)


def _apart(s: Steps, eye: Steps, shadow: Steps) -> Steps:
    if (s.sphere, s.rectangle) == (RIGHT.sphere, RIGHT.rectangle):
        return s

    def blocked(hits: Hits, to: Array, things: Casters, steps: Steps) -> Array:
        return s.blocked(hits, to, things, steps._replace(sphere=shadow.sphere, rectangle=shadow.rectangle))

    return s._replace(sphere=eye.sphere, rectangle=eye.rectangle, blocked=blocked)


HABITS: tuple[Change, ...] = (
    *(
        both(*normal, *test)
        for test in ((), *((tested(one),) for one in COARSE))
        for normal in ((), (faced,), (normals(made_unit),), (normals(made_unit), faced))
        if normal or test
    ),
    seen_alone,
    in_shadow_alone,
)
"""What may be done in one way or another without harm, but shows where something else is wrong: normals turned to the
eye, or made unit; how shadows are tested; functions of their own for shadow rays."""
