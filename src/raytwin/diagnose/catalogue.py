"""The catalogue of mistakes: what is made wrong in tracers, as data, a row each, with the sentence that helps.

A fault has one or more `ways` to be made, each a change of the tracer's `Steps` (see `predict`), and all called by the
same sentence. To add a fault, add a row; to add a way, add it to its row. Factors that are not known beforehand are
rows of `fitted`.
"""

from collections.abc import Sequence
from itertools import islice, product
from typing import Any

import numpy as np

from raytwin.diagnose.camera_faults import CAMERAS
from raytwin.diagnose.changes import (
    CAMERA,
    NORMALS,
    SHADOW,
    Fault,
    chain,
    in_shadow_test,
    offset_by,
    others_hide,
    row,
)
from raytwin.diagnose.geometry_faults import SOLVERS
from raytwin.diagnose.light_faults import LIGHTS
from raytwin.diagnose.order_faults import ORDERS
from raytwin.diagnose.picture_faults import OUTPUTS, SAMPLINGS
from raytwin.diagnose.predict import Array, Pipeline, SceneDict, as_dict, replaced, slip, touches
from raytwin.diagnose.shadow_faults import SHADOWS
from raytwin.diagnose.surface_faults import NORMALS_, PLANES_BY_ORIGIN, by_origin, flat_normals
from raytwin.scene import Camera, Scene

ACNE = row("acne", SHADOW,
    "speckles: rounding puts the start of shadow rays now above, now below the surface, so that it shades itself; "
    "start them a little off it, or leave its own object out",
    (), slip("sun_visible", ("return visible", "return visible & False")))  # fmt: skip
"""Which points are dark is chance: told by pixels that are all as lit or as dark as can be, and mixed."""

CHANCES = (
    *(row("plane-normal-by-origin", NORMALS, PLANES_BY_ORIGIN,
          *flat_normals(*(by_origin(k, flat) for flat in ("1", "-1")))) for k in (1, -1)),
    ACNE,
)  # fmt: skip
"""Faults of which rounding decides, pixel by pixel, what is seen: one of their ways."""

CACHED = (
    "a picture is drawn with the rays of another scene of the same size: what is kept between calls has to be found "
    "by all that it depends on, K and dist too, not by width and height alone"
)


def cached(first: Sequence[Camera], cameras: Sequence[Camera]) -> tuple[Fault, ...]:
    """Rays that are kept by the picture's size: with what one of the first gives all cameras of its size are used."""
    by_size: dict[tuple[int, int], list[Camera]] = {}
    for one in dict.fromkeys(first):
        if any(other.image_size == one.image_size and other != one for other in cameras):
            by_size.setdefault(one.image_size, []).append(one)
    each = list(islice(product(*by_size.values()), 8 if by_size else 0))
    ways = [
        _with_other_rays({one.image_size: one for one in some}, what)
        for some in each
        for what in ("lens", "axes", "pose")
    ]
    return (row("rays-kept", CAMERA, CACHED, *ways),) if ways else ()


def _with_other_rays(by_size: dict[tuple[int, int], Camera], what: str) -> Pipeline:
    """With the kept camera's lens; its axes too, from the own eye; or its whole pose."""

    def camera(scene: SceneDict) -> SceneDict:
        if (kept := by_size.get((scene["width"], scene["height"]))) is None:
            return scene
        other = as_dict(Scene("", kept), False)
        made = scene | {name: other[name] for name in ("K", "dist")}
        if what != "lens":
            own = scene if what == "axes" else other
            t = other["R_cam_board"] @ (own["R_cam_board"].T @ own["t_cam_board"])
            made |= {"R_cam_board": other["R_cam_board"], "t_cam_board": t}
        return made

    return (("camera", camera),)


FACTS = frozenset({"nothing-met", "empty"})
"""Faults that say what is seen, whatever has brought it about: of others that would, too, nothing is said."""

FAULTS: tuple[Fault, ...] = (
    *CAMERAS, *SOLVERS, *ORDERS, *NORMALS_, *LIGHTS, *SHADOWS, *SAMPLINGS, *OUTPUTS,
)  # fmt: skip
"""Every mistake there is, by stage."""


def _faced(normals: Array, points: Array, which: Array, eye: Array, things: Any) -> Array:
    return np.where(np.sum(normals * (points - eye), axis=-1, keepdims=True) > 0, -normals, normals)


def _made_unit(normals: Array, *_: Any) -> Array:
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return normals / np.where(length > 0, length, 1)


def _normals(f: Any) -> Pipeline:
    return replaced(normals_at=lambda right: lambda *args: f(right(*args), *args))


FACED, MADE_UNIT = _normals(_faced), _normals(_made_unit)
"""Normals of spheres, too, are turned to the eye; normals are made unit."""
COARSE = (others_hide, offset_by(1e-4), offset_by(1e-4, True))
SHADOW_TESTS = (*COARSE, *(offset_by(eps, way) for eps in (1e-6, 1e-5, 1e-3) for way in (False, True)))
"""Ways to test for shadows that are all right: the own object left out, or a start a little off the surface."""
MEETING = ("intersect_sphere", "intersect_plane")


def equivalent_forms(pipeline: Pipeline) -> tuple[Pipeline, ...]:
    """The same tracer with what may be done in either way without harm, but shows where something else is wrong.

    Normals turned to the eye, or made unit; how shadows are tested; functions of their own for shadow rays.
    """
    tests = ((), *COARSE) if not touches(pipeline, "sun_visible") else ((),)
    normals = ((), FACED, MADE_UNIT, chain(MADE_UNIT, FACED))
    made = [chain(pipeline, normal, test) for test in tests for normal in normals if normal or test]
    if meeting := tuple(step for step in pipeline if step[0] in MEETING):
        rest = tuple(step for step in pipeline if step[0] not in MEETING)
        made += [chain(pipeline, in_shadow_test(())), chain(rest, in_shadow_test(meeting))]
    return tuple(made)
