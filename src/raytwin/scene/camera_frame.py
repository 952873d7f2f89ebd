"""The same scene in the camera's frame."""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from raytwin.scene.camera import UNTURNED
from raytwin.scene.lights import Sky
from raytwin.scene.record_base import Vector
from raytwin.scene.scene import Scene
from raytwin.scene.validate import check_lengths, check_places


def to_camera_frame(scene: Scene, precision: str = "float64") -> Scene:
    """Return the scene in the camera's frame, in float64: the eye is the origin, and rays need no rotation.

    Coordinates are then as small as the distances that matter, and float32 does not lose the digits of far scenes.
    Raises InputError where floats of `precision` cannot represent the scene: see `scene.validate`.
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
    check_lengths(local, precision)
    check_places(local, precision)
    return local
