"""A camera that sees no object: whatever a comparison found, it found of the sky alone."""

import numpy as np

from raytwin.compare import Comparison
from raytwin.compare.finding import notes
from raytwin.images.image import Image
from raytwin.scene import MitsubaScene, Scene, Shape

TO_CHECK = (
    "R_cam_board and t_cam_board must take the board's frame to OpenCV's camera (x right, y down, z forward). OpenGL, "
    "NeRF and Blender have y and z the other way, and their matrices take the camera's frame to the world"
)
"""What is wrong with most such poses."""


def judged_in_view(comparison: Comparison, reference: Image, scene: Scene | MitsubaScene) -> Comparison:
    """The comparison; undecided where it passed although no pixel's center sees any of the scene's objects."""
    surface = reference.surface
    if surface is None or (surface.depth > 0).any() or not scene.names:
        return comparison
    said = "the camera sees no object, so that only the sky is compared"
    if isinstance(scene, Scene):
        said += f": {_where(scene)}. {TO_CHECK}"
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
