"""A camera that sees no object: whatever a comparison found, it found of the sky alone."""

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from raytwin import files, twin
from raytwin.compare import Comparison
from raytwin.compare.finding import notes
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.scene import MitsubaScene, Rectangle, Scene

LONGER_SIDE = 64
"""Pixels of the pictures in which other poses are tried."""

SEEN = ". Objects come into view of a camera with"

Axes = dict[tuple[int, int, int], str]
"""How a camera's axes may have been meant, the likeliest first: their signs, and in words."""

OPENCV: Axes = {
    (1, -1, -1): "its y and z axes flipped, as OpenGL, NeRF and Blender have them",
    (-1, -1, 1): "its x and y axes flipped, as Mitsuba has them",
    (-1, 1, -1): "its x and z axes flipped",
    (1, 1, 1): "",
}
"""The axes of raytwin's own scenes are OpenCV's: x right, y down, z forward."""
MITSUBA: Axes = {
    (-1, 1, -1): "its x and z axes flipped, as OpenGL, NeRF and Blender have them",
    (-1, -1, 1): "its x and y axes flipped, as OpenCV has them",
    (1, -1, -1): "its y and z axes flipped",
    (1, 1, 1): "",
}
"""Mitsuba's axes: x left, y up, z forward."""


def judged_in_view(comparison: Comparison, reference: Image, scene: Scene | MitsubaScene) -> Comparison:
    """The comparison; undecided where it passed although no pixel's center sees any of the scene's objects.

    A reason then says where they are, and which other reading of the camera's pose brings them into view.
    """
    surface = reference.surface
    if surface is None or (surface.depth > 0).any():
        return comparison
    axes = MITSUBA if isinstance(scene, MitsubaScene) else OPENCV
    pose, reach, sees = _view_of_file(scene) if isinstance(scene, MitsubaScene) else _view(scene)
    if not len(reach):
        return comparison
    said = f"the camera sees no object, so that only the sky is compared: {_where(reach)}"
    for inverted in (False, True):
        for signs, words in axes.items():
            tried = (np.linalg.inv(pose) if inverted else pose) @ np.diag((*signs, 1.0))
            if SEEN not in said and sees(tried):
                changes = " and ".join(filter(None, ["its matrix inverted" if inverted else "", words]))
                said += f"{SEEN} {changes}"
    if not comparison.passed:
        return comparison.saying(said)
    return comparison.judged("undecided", *notes([f"undecided: {said}"]), *comparison.findings)


def _where(reach: np.ndarray) -> str:
    """Where objects are that reach so far in front of the camera."""
    behind = int((reach <= 0).sum())
    parts = [(behind, "behind it"), (len(reach) - behind, "outside the frame")]
    return " and ".join(f"{n} object{'s are' if n > 1 else ' is'} {place}" for n, place in parts if n)


def _smaller(size: tuple[int, int]) -> tuple[int, int]:
    ratio = min(1.0, LONGER_SIDE / max(size))
    return max(1, round(size[0] * ratio)), max(1, round(size[1] * ratio))


View = tuple[np.ndarray, np.ndarray, Callable[[np.ndarray], bool]]
"""The camera's pose, camera to world (4, 4); how far each object reaches in front of it; whether one is seen from
another pose."""


def _view(scene: Scene) -> View:
    camera = scene.camera.resized(*_smaller(scene.camera.image_size))
    to_camera = np.eye(4)
    to_camera[:3, :3], to_camera[:3, 3] = camera.R_cam_board, camera.t_cam_board
    forward = to_camera[2, :3]

    def reach(thing: Any) -> float:
        sides = (thing.half_u, thing.half_v) if isinstance(thing, Rectangle) else (thing.radius * forward,)
        return float(forward @ thing.center + to_camera[2, 3] + sum(abs(forward @ side) for side in sides))

    def sees(pose: np.ndarray) -> bool:
        inverse = np.linalg.inv(pose)
        R, t = (tuple(map(tuple, inverse[:3, :3].tolist())), tuple(inverse[:3, 3].tolist()))
        moved = msgspec.structs.replace(camera, R_cam_board=R, t_cam_board=t)
        try:
            surface = twin.render(scene.with_camera(moved), "surface").surface
        except InputError:  # a camera inside an object, for one
            return False
        return surface is not None and bool(surface.mask.any())

    return np.linalg.inv(to_camera), np.array([reach(thing) for thing in scene.objects]), sees


def _view_of_file(scene: MitsubaScene) -> View:
    small = files.with_film(scene, *_smaller(scene.image_size))
    pose, reach = twin.mitsuba_reach(scene)

    def sees(pose: np.ndarray) -> bool:
        try:
            return bool((twin.mitsuba_surface(files.with_pose(small, pose.ravel().tolist())).depth > 0).any())
        except InputError:  # a pose that Mitsuba's sensor does not take
            return False

    return pose, reach, sees
