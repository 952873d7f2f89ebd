"""What happens once an image, before any ray: the scene is moved to the eye, and the work is cut up."""

from collections.abc import Sequence

import msgspec
import numpy as np

from raytwin.scene import Scene
from raytwin.tracer.engine import Engine
from raytwin.tracer.trim import EMPTY, Box

TILE = 128
"""NumPy works tile by tile: a tile's arrays (64 KiB in float32) stay in the processor's cache."""


def seen_from_eye(scene: Scene) -> Scene:
    """The scene moved so that the eye is the origin, in float64.

    Coordinates are then as small as the distances that matter, and float32 keeps the digits of far scenes.
    """
    eye = np.asarray(scene.camera.eye)

    def moved(things):
        return tuple(msgspec.structs.replace(t, center=tuple((np.asarray(t.center) - eye).tolist())) for t in things)

    return msgspec.structs.replace(scene, spheres=moved(scene.spheres), planes=moved(scene.planes))


def regions(boxes: Sequence[Box], size: tuple[int, int], engine: Engine) -> list[tuple[Box, list[int]]]:
    """Disjoint boxes that together cover `boxes`, each with the indices of those that touch it.

    NumPy gets tiles. Dr.Jit, where a launch costs more than a pixel, gets the boxes themselves, touching ones merged.
    """
    if not engine.is_numpy:
        return _merged(boxes)
    w, h = size
    work = []
    for y in range(0, h, TILE):
        for x in range(0, w, TILE):
            tile = (x, y, min(x + TILE, w), min(y + TILE, h))
            if touching := [i for i, box in enumerate(boxes) if _touch(tile, box)]:
                x0, y0, x1, y1 = zip(*(boxes[i] for i in touching), strict=True)
                part = max(x, min(x0)), max(y, min(y0)), min(tile[2], max(x1)), min(tile[3], max(y1))
                work.append((part, touching))
    return work


def _merged(boxes: Sequence[Box]) -> list[tuple[Box, list[int]]]:
    """The boxes, those that touch replaced by the box round them, and so again with what that one touches."""
    groups: list[tuple[Box, list[int]]] = []
    for i, box in enumerate(boxes):
        if box == EMPTY:
            continue
        members = [i]
        while touching := next((g for g in groups if _touch(box, g[0])), None):
            groups.remove(touching)
            b = touching[0]
            box = min(box[0], b[0]), min(box[1], b[1]), max(box[2], b[2]), max(box[3], b[3])
            members += touching[1]
        groups.append((box, sorted(members)))
    return groups


def _touch(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
