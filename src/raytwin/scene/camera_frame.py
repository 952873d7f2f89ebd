"""The same scene in the camera's frame."""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from raytwin.scene.lights import Environment, Light, Sun
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

    def facing(light: Light) -> Light:
        if isinstance(light, Sun):
            return replace(light, to_light=turned(light.to_light)[0])
        if isinstance(light, Environment):
            return replace(light, R_map_board=tuple(turned(light.R_map_board)))
        return light

    centers = turned(np.array([thing.center for thing in scene.objects]).reshape(-1, 3) - eye)
    objects = tuple(thing.turned(R, c) for thing, c in zip(scene.objects, centers, strict=True))
    camera = replace(
        scene.camera, R_cam_board=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), t_cam_board=(0.0, 0.0, 0.0)
    )
    lights = tuple(facing(light) for light in scene.lights)
    local = replace(scene, camera=camera, objects=objects, lights=lights)
    check_lengths(local, precision)
    check_places(local, precision)
    return local
