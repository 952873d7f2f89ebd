"""The whole tracer: for every pixel a ray, for every ray the nearest object, for every hit its radiance."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from raytwin.errors import InputError
from raytwin.image import BACKGROUND, Image, Surface
from raytwin.scene import Camera, Scene
from raytwin.tracer.camera import Inverse, back_project, invert_lens
from raytwin.tracer.engine import ENGINES, Engine, flush, lift, pixel_grid, store
from raytwin.tracer.hit import Hit, nearest
from raytwin.tracer.light import RUNGS
from raytwin.tracer.prepare import regions, seen_from_eye
from raytwin.tracer.sphere import SOLVERS
from raytwin.tracer.trim import TRIMS, Box


def trace(
    scene: Scene, rung: str = "shadow", engine: str = "numpy64", solver: str = "robust", trim: str = "conic"
) -> Image:
    """Radiance and surface of what each pixel's centre sees: `Image` of the camera's size, without noise.

    `rung`: a row of RUNGS; `engine`: a row of ENGINES; `solver`: a row of SOLVERS. `trim`, a row of TRIMS, skips what
    no object's box touches; `conic` gives the same as `none` to the last bit, unless a poor solver sees a sphere beyond
    its outline. Raises InputError for an unknown row, a camera yet to be calibrated, or a distortion that cannot be
    undone; MachineError for an engine that this machine lacks.
    """
    if not isinstance(scene.camera, Camera):
        raise InputError(f"scene {scene.name}: camera", "a calibrated camera", "photos to calibrate it from")
    w, h = scene.camera.image_size
    mean = background(scene, rung)
    surface = Surface(
        np.full((h, w), BACKGROUND, np.int32), np.zeros((h, w), np.float32), np.zeros((h, w, 3), np.float32)
    )
    draw(scene, mean, rung, engine, solver, trim, surface)
    return Image(mean, surface=surface)


def background(scene: Scene, rung: str = "shadow", out: np.ndarray | None = None) -> np.ndarray:
    """What the camera sees where it meets nothing: (H, W, 3) float32, the sky's radiance; on rung `surface`, 0.

    `out` is filled, where given, and returned.
    """
    w, h = scene.camera.image_size
    row = np.empty((w, 3), np.float32)
    row[:] = 0.0 if rung == "surface" else scene.sky.radiance
    if out is None:
        out = np.empty((h, w, 3), np.float32)
    if w * h < 1 << 20:
        out[:] = row
    else:  # one thread does not use all of the memory's speed
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda rows: np.copyto(rows, row), np.array_split(out, 2)))
    return out


def draw(
    scene: Scene,
    out: np.ndarray,
    rung: str = "shadow",
    engine: str = "numpy64",
    solver: str = "robust",
    trim: str = "conic",
    surface: Surface | None = None,
) -> None:
    """Write the radiance of every pixel that sees an object into `out` (H, W, 3) float32, and touch no other.

    `surface`, where given, is written alike. The rest is as in `trace`.
    """
    tables = ("rung", rung, RUNGS), ("engine", engine, ENGINES), ("solver", solver, SOLVERS), ("trim", trim, TRIMS)
    for what, name, table in tables:
        if name not in table:
            raise InputError(what, f"one of {', '.join(table)}", name)
    camera, how = scene.camera, ENGINES[engine]
    boxes = [TRIMS[trim](thing, camera) for thing in scene.objects]
    local = lift(seen_from_eye(scene), how)
    inverse = lift(invert_lens(camera, how.precision), how)
    queued: list = []
    for box, candidates in regions(boxes, camera.image_size, how):
        with np.errstate(all="ignore"):  # infinities and NaN of missed rays are selected away
            hit, radiance = trace_box(local, box, candidates, rung, how, solver, inverse)
        layers = [(out, radiance)]
        if surface is not None:
            layers += (surface.ids, (hit.ids,)), (surface.depth, (hit.t,)), (surface.normal, hit.normal)
        queued += [store(layer, box, values, hit.ids >= 0) for layer, values in layers]
    flush(how, queued)


def trace_box(
    scene: Scene,
    box: Box,
    candidates: Sequence[int],
    rung: str,
    engine: Engine,
    solver: str,
    inverse: Inverse | None = None,
) -> tuple[Hit, tuple]:
    """The hit and the radiance of each pixel of the box, with rays that start at the origin of `scene`'s frame.

    `inverse` undoes the distortion.
    """
    u, v = pixel_grid(engine, box)
    d = back_project(u, v, scene.camera, inverse)
    hit = nearest((0.0, 0.0, 0.0), d, [(i, scene.objects[i]) for i in candidates], solver)
    return hit, RUNGS[rung](hit, scene, solver)
