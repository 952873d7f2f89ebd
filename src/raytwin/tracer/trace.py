"""The whole tracer: for every pixel a ray, for every ray the nearest object, for every hit its radiance."""

from collections.abc import Sequence

import msgspec
import numpy as np

from raytwin.image import BACKGROUND, Image, Surface
from raytwin.scene import Camera, Scene
from raytwin.tracer.arrays import ENGINES, Engine, parameters, pixel_grid, to_numpy
from raytwin.tracer.camera import back_project
from raytwin.tracer.hit import Hit, nearest
from raytwin.tracer.light import RUNGS
from raytwin.tracer.trim import EMPTY, Box, trim_box

TILE = 128
"""NumPy works tile by tile: a tile's arrays (64 KiB in float32) stay in the processor's cache."""


def trace(
    scene: Scene, rung: str = "shadow", engine: str = "numpy64", solver: str = "robust", trim: bool = True
) -> Image:
    """Radiance and surface of what each pixel's centre sees: `Image` of the camera's size, without noise.

    `scene.camera` is a Camera. `rung`: a row of RUNGS; `engine`: a row of ENGINES; `solver`: a row of SOLVERS. `trim`
    skips what no object's box touches; the result is the same to the last bit.
    """
    camera, how = scene.camera, ENGINES[engine]
    w, h = camera.image_size
    mean = np.empty((h, w, 3), np.float32)
    mean[:] = (0, 0, 0) if rung == "surface" else scene.sky.radiance
    ids, depth = np.full((h, w), BACKGROUND, np.int32), np.zeros((h, w), np.float32)
    normal = np.zeros((h, w, 3), np.float32)
    local = seen_from_eye(scene)
    lifted, lens = lift(local, how), lift_camera(camera, how)
    boxes = [trim_box(thing, camera) if trim else (0, 0, w, h) for thing in scene.objects]
    for box, candidates in regions(boxes, camera.image_size, how):
        x0, y0, x1, y1 = box
        here = np.s_[y0:y1, x0:x1]
        shape = (y1 - y0, x1 - x0)
        with np.errstate(all="ignore"):  # infinities and NaN of missed rays are selected away
            hit, colour = trace_box(lifted, lens, box, candidates, rung, how, solver)
        found = to_numpy(hit.ids, shape)
        seen = found >= 0
        ids[here] = found
        np.copyto(depth[here], to_numpy(hit.t, shape), where=seen)
        for c in range(3):
            np.copyto(mean[here][..., c], to_numpy(colour[c], shape), where=seen)
            np.copyto(normal[here][..., c], to_numpy(hit.normal[c], shape), where=seen)
    return Image(mean, surface=Surface(ids, depth, normal))


def trace_box(
    scene: Scene, camera: Camera, box: Box, candidates: Sequence[int], rung: str, engine: Engine, solver: str
) -> tuple[Hit, tuple]:
    """The hit and the radiance of each pixel of the box, with rays that start at the origin of `scene`'s frame."""
    u, v = pixel_grid(engine, box)
    d = back_project(u, v, camera)
    hit = nearest((0.0, 0.0, 0.0), d, [(i, scene.objects[i]) for i in candidates], solver)
    return hit, RUNGS[rung](hit, scene, solver)


def seen_from_eye(scene: Scene) -> Scene:
    """The scene moved so that the eye is the origin, in float64.

    Coordinates are then as small as the distances that matter, and float32 keeps the digits of far scenes.
    """
    eye = np.asarray(scene.camera.eye)

    def moved(things):
        return tuple(msgspec.structs.replace(t, center=tuple((np.asarray(t.center) - eye).tolist())) for t in things)

    sun = msgspec.structs.replace(scene.sun, to_light=scene.sun.direction)
    return msgspec.structs.replace(scene, spheres=moved(scene.spheres), planes=moved(scene.planes), sun=sun)


def lift(scene: Scene, engine: Engine) -> Scene:
    """The scene with its numbers as the engine's parameters."""

    def lifted(record):
        names = record.__struct_fields__
        values = {n: getattr(record, n) for n in names}
        numbers = {n: parameters(engine, v) for n, v in values.items() if isinstance(v, tuple | float)}
        return msgspec.structs.replace(record, **numbers)

    return msgspec.structs.replace(
        scene,
        spheres=tuple(map(lifted, scene.spheres)),
        planes=tuple(map(lifted, scene.planes)),
        sun=lifted(scene.sun),
        sky=lifted(scene.sky),
    )


def lift_camera(camera: Camera, engine: Engine) -> Camera:
    """The camera with its numbers as the engine's parameters; without a distortion it keeps none."""
    numbers = {n: parameters(engine, getattr(camera, n)) for n in ("K", "R_cam_board", "dist")}
    return msgspec.structs.replace(camera, **numbers)


def regions(boxes: Sequence[Box], size: tuple[int, int], engine: Engine) -> list[tuple[Box, list[int]]]:
    """Disjoint boxes that together cover `boxes`, each with the indices of those that touch it.

    NumPy gets tiles. Dr.Jit, where a launch costs more than a pixel, gets the boxes themselves, touching ones merged.
    """
    if not engine.is_numpy:
        return _merged(boxes)
    w, h = size
    tiles = [(x, y, min(x + TILE, w), min(y + TILE, h)) for y in range(0, h, TILE) for x in range(0, w, TILE)]
    work = []
    for tile in tiles:
        if touching := [i for i, box in enumerate(boxes) if _touch(tile, box)]:
            # Shrink to what the boxes need of the tile.
            xs0, ys0, xs1, ys1 = zip(*(boxes[i] for i in touching), strict=True)
            box = max(tile[0], min(xs0)), max(tile[1], min(ys0)), min(tile[2], max(xs1)), min(tile[3], max(ys1))
            work.append((box, touching))
    return work


def _merged(boxes: Sequence[Box]) -> list[tuple[Box, list[int]]]:
    groups = [(box, [i]) for i, box in enumerate(boxes) if box != EMPTY]
    done = []
    while groups:
        box, members = groups.pop()
        for other, (b, m) in enumerate(groups):
            if _touch(box, b):
                union = min(box[0], b[0]), min(box[1], b[1]), max(box[2], b[2]), max(box[3], b[3])
                groups[other] = union, sorted(members + m)
                break
        else:
            done.append((box, members))
    return done


def _touch(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
