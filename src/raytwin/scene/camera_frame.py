"""The same scene in the camera's frame, if floats can represent it there: the eye is the origin."""

import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.scene.camera import UNTURNED
from raytwin.scene.lights import Sky
from raytwin.scene.record_base import Vector
from raytwin.scene.scene import Scene

LIMITS = {"float32": (1e-12, 1e12, 2e-6), "float64": (1e-100, 1e100, 1e-13), "twin": (1e-12, 1e12, 5e-8)}
"""precision -> the shortest and the longest length, metres, whose products of three floats represent; and the share of
their distance from the eye within which surfaces are in one place. Mitsuba errs in 0.3 % of the pixels at 1e-8.
"""


def to_camera_frame(scene: Scene, precision: str = "float64") -> Scene:
    """Return the scene in the camera's frame, in float64: the eye is the origin, and rays need no rotation.

    Coordinates are then as small as the distances that matter, and float32 does not lose the digits of far scenes.
    Raises InputError where floats of `precision`, of LIMITS, cannot represent the scene, or mix up its surfaces.
    """
    R, eye = np.asarray(scene.camera.R_cam_board), np.asarray(scene.camera.eye)
    replace = msgspec.structs.replace

    def turned(vectors: Any) -> Sequence[Vector]:
        return [(x, y, z) for x, y, z in (np.reshape(vectors, (-1, 3)) @ R.T).tolist()]

    centers = turned(np.array([thing.center for thing in scene.objects]).reshape(-1, 3) - eye)
    objects: Any = tuple(thing.turned(R, c) for thing, c in zip(scene.objects, centers, strict=True))
    camera = replace(scene.camera, R_cam_board=UNTURNED, t_cam_board=(0.0, 0.0, 0.0))
    sun, sky, placed = replace(scene.sun, to_light=turned(scene.sun.to_light)[0]), scene.sky, len(scene.spheres)
    if (around := scene.environment) is not None:
        sky = Sky(texels=replace(around, R_map_board=tuple(turned(around.R_map_board))))
    local = replace(scene, camera=camera, spheres=objects[:placed], planes=objects[placed:], sun=sun, sky=sky)
    _check_lengths(local, precision)
    _check_places(local, LIMITS[precision][2])
    return local


def _check_lengths(local: Scene, precision: str) -> None:
    shortest, longest, _ = LIMITS[precision]
    for i, thing in enumerate(local.objects):
        least, most = min(thing.sizes), max(*thing.sizes, math.hypot(*thing.center))
        if not (least >= shortest and most <= longest):
            where, found = f"objects[{i}] of scene {local.name}", least if least < shortest else most
            raise InputError(where, f"lengths of {shortest:g} to {longest:g} m for {precision}", f"{found:g}")


def _check_places(local: Scene, rounding: float) -> None:
    """Raise InputError where rounding decides what is seen: two rectangles in one place, or an eye within one."""
    flat, first = local.planes, len(local.spheres)
    center, normal = (np.array(a).reshape(-1, 3) for a in ([t.center for t in flat], [t.normal for t in flat]))
    far = rounding * np.array([math.hypot(*t.center) + sum(t.sizes) for t in flat])
    for k in np.flatnonzero(np.abs((normal * center).sum(axis=1)) <= far).tolist():
        if _overlap(center[k], flat[k].half_u, flat[k].half_v):
            found = f"one within objects[{first + k}]"
            raise InputError(f"camera of scene {local.name}", "an eye off every surface", found)
    for k in range(1, len(flat)):
        level = np.abs((center[:k] - center[k]) @ normal[k]) <= np.maximum(far[:k], far[k])
        level &= np.linalg.norm(np.cross(normal[:k], normal[k]), axis=1) <= rounding
        for other in np.flatnonzero(level).tolist():
            edges = *(flat[k].half_u, flat[k].half_v), *(flat[other].half_u, flat[other].half_v)
            if _overlap(center[k] - center[other], *edges):
                found = f"one in the place of objects[{first + other}] (raise one of them a little)"
                where = f"objects[{first + k}] of scene {local.name}"
                raise InputError(where, "a surface apart from all others", found)


def _overlap(apart: np.ndarray, *edges: Vector) -> bool:
    """Return whether coplanar rectangles with these half-edges, whose centres are `apart`, share more than an edge:
    no direction of an edge separates them. One without edges is a point."""
    reach = [sum(abs(np.dot(edge, axis)) for edge in edges) for axis in edges]
    return all(abs(np.dot(apart, axis)) < (1 - 1e-6) * r for axis, r in zip(edges, reach, strict=True))
