"""The same scene from another place."""

import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.scene.record import Vector
from raytwin.scene.scene import Scene
from raytwin.scene.shapes import Shape, Sphere


def seen_from_eye(scene: Scene, precision: str = "float64") -> Scene:
    """The scene in the camera's frame, in float64: the eye is the origin, and rays need no turning.

    Coordinates are then as small as the distances that matter, and float32 keeps the digits of far scenes. Raises
    InputError where a length is none whose products the floats of `precision` hold.
    """
    R, eye = np.asarray(scene.camera.R_cam_board), np.asarray(scene.camera.eye)
    replace = msgspec.structs.replace

    def turned(vectors: Any) -> Sequence[Vector]:
        return [(x, y, z) for x, y, z in (np.reshape(vectors, (-1, 3)) @ R.T).tolist()]

    def moved(thing: Shape, center: Vector) -> Shape:
        if isinstance(thing, Sphere):
            return replace(thing, center=center)
        half_u, half_v = turned([thing.half_u, thing.half_v])
        return replace(thing, center=center, half_u=half_u, half_v=half_v)

    centers = turned(np.array([thing.center for thing in scene.objects]).reshape(-1, 3) - eye)
    objects = tuple(moved(thing, c) for thing, c in zip(scene.objects, centers, strict=True))
    camera = replace(
        scene.camera, R_cam_board=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), t_cam_board=(0.0, 0.0, 0.0)
    )
    sun = replace(scene.sun, to_light=turned(scene.sun.to_light)[0])
    local = replace(scene, camera=camera, objects=objects, lights=(sun, scene.sky))
    _check_lengths(local, precision)
    return local


LENGTHS = {"float32": (1e-12, 1e12), "float64": (1e-100, 1e100)}
"""Metres: a rectangle's test takes products of three lengths, and floats hold them between these."""


def _check_lengths(local: Scene, precision: str) -> None:
    least, most = LENGTHS[precision]
    for i, thing in enumerate(local.objects):
        sizes = (thing.radius,) if isinstance(thing, Sphere) else (math.hypot(*thing.half_u), math.hypot(*thing.half_v))
        for size in (*sizes, max(math.hypot(*thing.center), sizes[0])):
            if not least <= size <= most:
                where = f"objects[{i}] of scene {local.name}"
                raise InputError(where, f"lengths of {least:g} to {most:g} m for {precision}", f"{size:g}")
