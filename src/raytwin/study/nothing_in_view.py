"""A camera that sees no object: whatever a comparison found, it found of the sky alone."""

import msgspec
import numpy as np

from raytwin import twin
from raytwin.compare import Comparison
from raytwin.compare.finding import notes
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.scene import MitsubaScene, Scene, Shape

LONGER_SIDE = 64
"""Pixels of the pictures in which other poses are tried."""

AXES = {
    (1, -1, -1): "its y and z axes flipped, as OpenGL, NeRF and Blender have them",
    (-1, -1, 1): "its x and y axes flipped, as Mitsuba has them",
    (-1, 1, -1): "its x and z axes flipped",
    (1, 1, 1): "",
}
"""How a camera's axes may have been meant, the likeliest first: their signs beside OpenCV's, and in words."""


def judged_in_view(comparison: Comparison, reference: Image, scene: Scene | MitsubaScene) -> Comparison:
    """The comparison; undecided where it passed although no pixel's center sees any of the scene's objects.

    A reason then says where they are, and which other reading of the camera's pose brings them into view.
    """
    surface = reference.surface
    if surface is None or (surface.depth > 0).any() or not scene.names:
        return comparison
    said = "the camera sees no object, so that only the sky is compared"
    if isinstance(scene, Scene):
        said += f": {_where(scene)}{_meant(scene)}"
    if not comparison.passed:
        return comparison.saying(said)
    return comparison.judged("undecided", *notes([f"undecided: {said}"]), *comparison.findings)


def _where(scene: Scene) -> str:
    """How many objects are behind the camera, and how many beside what it sees."""
    axes, depth = np.asarray(scene.camera.R_cam_board), scene.camera.t_cam_board[2]

    def reach(thing: Shape) -> float:
        return float(axes[2] @ thing.center + depth + thing.extent(axes)[2])

    behind = sum(reach(thing) <= 0 for thing in scene.objects)
    parts = [(behind, "behind it"), (len(scene.objects) - behind, "outside the frame")]
    return " and ".join(f"{n} object{'s are' if n > 1 else ' is'} {place}" for n, place in parts if n)


def _meant(scene: Scene) -> str:
    """The likeliest other reading of the camera's pose that brings objects into view; empty where none does."""
    ratio = min(1.0, LONGER_SIDE / max(scene.camera.image_size))
    camera = scene.camera.resized(*(max(1, round(side * ratio)) for side in scene.camera.image_size))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.R_cam_board, camera.t_cam_board
    for inverted in (False, True):
        for signs, words in AXES.items():
            tried = np.diag((*signs, 1.0)) @ (np.linalg.inv(pose) if inverted else pose)
            R, t = tuple(map(tuple, tried[:3, :3].tolist())), tuple(tried[:3, 3].tolist())
            moved = scene.with_camera(msgspec.structs.replace(camera, R_cam_board=R, t_cam_board=t))
            try:
                surface = twin.render(moved, "surface").surface
            except InputError:  # a camera inside an object, for one
                continue
            if surface is not None and surface.mask.any():
                changes = " and ".join(filter(None, ["its matrix inverted" if inverted else "", words]))
                return f". Objects come into view of a camera with {changes}"
    return ""
