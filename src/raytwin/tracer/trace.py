"""The whole tracer: for every pixel a ray, for every ray the nearest object, for every hit its radiance."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.image import BACKGROUND, Image, Surface
from raytwin.scene import Scene
from raytwin.tracer.camera import camera_ray, invert_lens, to_board
from raytwin.tracer.engine import ENGINES, Engine, canvas, flush, lift, only_where, pixel_grid, store, tile_grid
from raytwin.tracer.hit import describe, first
from raytwin.tracer.light import RUNGS
from raytwin.tracer.objects import Listed, Table, Walked, walk
from raytwin.tracer.prepare import plan, seen_from_eye
from raytwin.tracer.sphere import SOLVERS
from raytwin.tracer.trim import TRIMS


def trace(
    scene: Scene, rung: str = "shadow", engine: str = "numpy64", solver: str = "robust", trim: str = "conic"
) -> Image:
    """Radiance and surface of what each pixel's centre sees: `Image` of the camera's size, without noise.

    `rung`: a row of RUNGS; `engine`: a row of ENGINES; `solver`: a row of SOLVERS. `trim`, a row of TRIMS, skips what
    no object's box touches; `conic` gives the same as `none` to the last bit, unless a poor solver sees a sphere beyond
    its outline. Raises InputError for an unknown row, or a distortion that cannot be undone; MachineError for an
    engine that this machine lacks.
    """
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
    boxes = TRIMS[trim](scene.objects, camera)
    view = View(scene, how)
    layers = [out] if surface is None else [out, surface.ids, surface.depth, surface.normal]
    queued = [(layer, canvas(how, layer)) for layer in layers]

    def paint(u: Any, v: Any, place: Any, seen: Objects, casters: Objects) -> None:
        d = camera_ray(u, v, view.scene.camera, view.inverse)
        t, ids = first(EYE, d, seen, solver)

        def shade() -> None:
            hit = describe(EYE, d, t, ids, view.table)
            values = [RUNGS[rung](hit, view.scene, casters, solver)]
            if surface is not None:
                values += (ids,), (t,), to_board(hit.normal, view.scene.camera)
            for (_, targets), value in zip(queued, values, strict=True):
                store(how, targets, place, value, ids >= 0)

        only_where(how, ids >= 0, shade)

    with np.errstate(all="ignore"):  # infinities and NaN of missed rays are selected away
        for piece in (tiles if how.is_numpy else kernel)(view, boxes, rung == "shadow"):
            paint(*piece)
    flush(how, queued)


EYE = (0.0, 0.0, 0.0)
TILE_NUMPY, TILE_DRJIT = 128, 32

Objects = Listed | Walked


class View:
    """A scene seen from its eye: `local` in the camera's frame, in float64; the rest in the engine's floats.

    `scene` keeps its own camera, whose rotation leads back to the board's frame; its sun is in the camera's.
    """

    def __init__(self, scene: Scene, engine: Engine) -> None:
        self.engine, self.local = engine, seen_from_eye(scene)
        self.scene = lift(msgspec.structs.replace(scene, lights=self.local.lights, objects=()), engine)
        self.inverse = lift(invert_lens(scene.camera, engine.precision), engine)
        self.table = Table(self.local, engine)


def tiles(view: View, boxes: np.ndarray, shadows: bool) -> Iterator[tuple]:
    """(u, v, place, seen, casters) of one tile after the other, whose arrays stay in the processor's cache."""
    work = plan(view.local, boxes, view.local.camera.image_size, TILE_NUMPY, shadows)
    for tile in work.tiles.tolist():
        ids = work.seen.at(tile)
        corner = np.array((tile % work.columns, tile // work.columns)) * work.side
        x0, y0 = np.maximum(boxes[ids, :2].min(axis=0), corner).tolist()
        x1, y1 = np.minimum(boxes[ids, 2:].max(axis=0), corner + work.side).tolist()
        u, v = pixel_grid(view.engine, (x0, y0, x1, y1))
        place = slice(y0, y1), slice(x0, x1)
        yield u, v, place, Listed(view.table, ids), Listed(view.table, work.casters.at(tile))


def kernel(view: View, boxes: np.ndarray, shadows: bool) -> Iterator[tuple]:
    """The same for Dr.Jit: all tiles at once."""
    w, h = view.local.camera.image_size
    work = plan(view.local, boxes, (w, h), TILE_DRJIT, shadows)
    if len(work.tiles):
        u, v, place, number = tile_grid(view.engine, work.tiles, work.side, work.columns, (w, h))
        seen, casters = (walk(view.table, view.engine, a, work.tiles, number) for a in (work.seen, work.casters))
        kind = view.engine.float_type
        yield kind(u), kind(v), place, seen, casters
