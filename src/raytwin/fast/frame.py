"""The whole tracer, fast: tiles that see some object, in any engine; the same pixels as `tracer.trace`."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial
from typing import Any

import numpy as np

from raytwin.array_types import Float32, Int
from raytwin.errors import check_one_of
from raytwin.fast import bvh
from raytwin.fast.boxes import TRIMS
from raytwin.fast.engine import ENGINES, Engine, canvas, flush, only_where, pixel_grid, store, tile_grid, to_engine
from raytwin.fast.fast_world import (
    FastWorld,
    ObjectList,
    Objects,
    SunwardList,
    Table,
    kernel_lists,
    kernel_trees,
    same_list,
    sunward_list,
)
from raytwin.fast.newton_steps import newton_steps
from raytwin.images.image import Image, Surface
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Scene, to_camera_frame
from raytwin.scene.lens import without_ray
from raytwin.tracer.arrays import Vec, unit
from raytwin.tracer.hit import Stages, World
from raytwin.tracer.lights import Lighting, lighting
from raytwin.tracer.pixel_to_ray import to_board, undistort
from raytwin.tracer.render_image import EYE, STAGES
from raytwin.tracer.shading import RADIANCE
from raytwin.tracer.sphere import SOLVERS, intersect_sphere
from raytwin.tracer.world import surface_at

TILE_NUMPY, TILE_DRJIT = 128, 32
MAX_OBJECTS_PER_TILE = 64
"""Objects of a tile, on average, up to which a kernel tries one after the other for rays from the eye: neighbours try
the same ones, where in a tree each goes its own way."""
BOXED = ("intersect_sphere", "intersect_rectangle", "nearer", "sun_visible")
"""The stages on which it depends which objects a ray can be spared."""
Piece = tuple[Any, Any, Any, World]
"""u, v, place of the pixels; the objects that their rays may meet."""


def trace(
    scene: Scene,
    rung: str = "shadow",
    engine: str = "numpy64",
    solver: str = "robust",
    trim: str = "conic",
    stages: Stages = STAGES,
) -> Image:
    """Radiance and surface of what each pixel's centre sees: `Image` of the camera's size, without noise.

    `rung`: a row of `tracer.RADIANCE`; `engine`: of ENGINES; `solver`: of SOLVERS. `trim`, of TRIMS, skips what no
    object's box touches; `conic` gives the same as `none` to the last bit, unless a poor solver sees a sphere beyond
    its outline. Raises InputError for an unknown row, or a distortion that cannot be undone; MachineError for an engine
    that this machine lacks.
    """
    check_rows(rung, engine, solver, trim)
    mean, surface = background(scene, rung), Surface.empty(*scene.camera.image_size)
    draw(scene, mean, rung, engine, solver, trim, surface, stages)
    return Image(mean, surface=surface)


def background(scene: Scene, rung: str = "shadow") -> Float32[np.ndarray, "h w 3"]:
    """What the camera sees where it meets nothing, through the pixels' centres: (H, W, 3) float32, the sky's radiance,
    or 0 where a rung or the lens has none.
    """
    w, h = scene.camera.image_size
    out = np.empty((h, w, 3), np.float32)
    if RUNGS[rung].background and scene.environment is not None:
        view, step = EyeScene(scene, ENGINES["numpy64"]), max(1, (1 << 16) // w)
        with np.errstate(all="ignore"):  # where the lens has no ray
            for y in range(0, h, step):
                d = view.ray(*pixel_grid(view.engine, (0, y, w, min(y + step, h))))
                out[y : y + step] = np.stack(view.light.sky.radiance(d), axis=-1)
    else:
        row = np.tile(np.array(scene.sky_radiance if RUNGS[rung].background else (0, 0, 0), np.float32), (w, 1))
        if w * h < 1 << 20:
            out[:] = row
        else:  # one thread does not use all of the memory's speed
            with ThreadPoolExecutor(2) as pool:
                list(pool.map(lambda rows: np.copyto(rows, row), np.array_split(out, 2)))
    if (lost := without_ray(scene.camera)) is not None:
        out[lost] = 0
    return out


def draw(
    scene: Scene,
    out: Float32[np.ndarray, "h w 3"],
    rung: str = "shadow",
    engine: str = "numpy64",
    solver: str = "robust",
    trim: str = "conic",
    surface: Surface | None = None,
    stages: Stages = STAGES,
) -> None:
    """Write the radiance of every pixel that sees an object into `out` (H, W, 3) float32, and touch no other.

    `surface`, where given, is written alike. The rest is as in `trace`.
    """
    check_rows(rung, engine, solver, trim)
    how, boxes = ENGINES[engine], TRIMS[trim](scene.objects, scene.camera)
    view = EyeScene(scene, how, with_solver(stages, solver), every=trim == "none")
    layers = [out] if surface is None else [out, surface.ids, surface.depth, surface.normal]
    queued = [(layer, canvas(how, layer)) for layer in layers]
    lost = without_ray(scene.camera)
    before = [] if lost is None else [layer[lost] for layer in layers]

    def paint(u: Any, v: Any, place: Any, world: World) -> None:
        d = view.ray(u, v)
        t, ids = world.closest_hit(EYE, d)

        def shade() -> None:
            hit = surface_at(world, EYE, d, t, ids)
            values: list[tuple[Any, ...]] = [RADIANCE[rung](hit, view.light, world, view.camera)]
            if surface is not None:
                values += [(ids,), (t,), to_board(hit.normal, view.camera)]
            for (_, targets), value in zip(queued, values, strict=True):
                store(how, targets, place, value, ids >= 0)

        only_where(how, ids >= 0, shade)

    with np.errstate(all="ignore"):  # infinities and NaN of missed rays are selected away
        for piece in pieces(view, boxes):
            paint(*piece)
    flush(how, queued)
    for layer, values in zip(layers, before, strict=False):
        layer[lost] = values


def check_rows(rung: str, engine: str, solver: str, trim: str) -> None:
    """Raise InputError unless each is a row of its table."""
    tables = ("rung", rung, RADIANCE), ("engine", engine, ENGINES), ("solver", solver, SOLVERS), ("trim", trim, TRIMS)
    for what, name, table in tables:
        check_one_of(what, name, table)


def with_solver(stages: Stages, solver: str) -> Stages:
    """The stages with a row of SOLVERS; a stage that has been replaced already stays."""
    if stages.intersect_sphere is not intersect_sphere or solver == "robust":
        return stages
    return stages._replace(intersect_sphere=partial(intersect_sphere, solver=solver))


class EyeScene:
    """A scene as its camera sees it: `local` in the camera's frame, in float64; the rest in the engine's floats.

    `camera` has its rotation, which leads back to the board's frame. `every`: no object is left out of any test.
    """

    def __init__(self, scene: Scene, engine: Engine, stages: Stages = STAGES, every: bool = False) -> None:
        self.engine, self.stages = engine, stages
        # A replaced step may meet objects beyond their boxes, or ask for others than the nearest.
        replaced = any(getattr(stages, name) is not getattr(STAGES, name) for name in BOXED)
        self.every = every or replaced
        self.local = to_camera_frame(scene, engine.precision)
        self.camera: Camera = to_engine(scene.camera, engine)
        light: Lighting = to_engine(lighting(self.local), engine)
        self.light = light._replace(to_sun=unit(light.to_sun))  # in the engine's own floats
        self.undo = stages.undistort
        if self.undo is undistort:  # and not a student's, or a fault's
            self.undo = partial(undistort, steps=newton_steps(scene.camera, engine.precision))
        self.table = Table(self.local, engine)

    def ray(self, u: Any, v: Any) -> Vec:
        """The unit directions through pixels (u, v), in the camera's frame."""
        x, y, z = self.stages.back_project(u, v, self.camera, self.undo)
        return x, y, z

    def world(self, seen: Objects, casters: Objects) -> FastWorld:
        """What the eye's rays are tested against, and then the rays from there to the sun."""
        return FastWorld(self.table, self.stages, seen, casters)

    @cached_property
    def one_by_one(self) -> Objects:
        """All objects, one after the other."""
        return same_list(self.table, self.engine)

    @cached_property
    def everywhere(self) -> FastWorld:
        """With all objects, for rays from anywhere."""
        many = not self.engine.is_numpy and len(self.table.objects) > bvh.MAX_OBJECTS_WITHOUT_TREE and not self.every
        found = kernel_trees(self.table, self.engine) if many else self.one_by_one
        return self.world(found, found)

    def near(self, ids: list[int]) -> FastWorld:
        """NumPy's, for rays from the eye that can meet the objects `ids` alone."""
        only = ids[0] if len(ids) == 1 else None
        return self.world(
            ObjectList(self.table, ids), self.one_by_one if self.every else self._sunward._replace(only=only)
        )

    @cached_property
    def _sunward(self) -> SunwardList:
        return sunward_list(self.table, self.local.sun.to_light)


def spans(boxes: Int[np.ndarray, "n 4"], side: int) -> list[tuple[slice, slice]]:
    """The rows and columns of square tiles of `side` pixels that each box touches."""
    ends = np.concatenate([boxes[:, :2] // side, -(-boxes[:, 2:] // side)], axis=1).tolist()
    return [(slice(y0, y1), slice(x0, x1)) for x0, y0, x1, y1 in ends]


def touched(boxes: Int[np.ndarray, "n 4"], side: int, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Which tile each object's box touches, and the object's id: in the order of both. Tiles are counted row by row."""
    number = np.arange(-(-size[1] // side) * -(-size[0] // side)).reshape(-(-size[1] // side), -1)
    found = [number[span].ravel() for span in spans(boxes, side)]
    ids = np.repeat(np.arange(len(boxes)), [len(part) for part in found])
    tile = np.concatenate([number[:0, 0], *found])
    order = np.argsort(tile, kind="stable")
    return tile[order], ids[order]


def pieces(view: EyeScene, boxes: Int[np.ndarray, "n 4"]) -> Iterator[Piece]:
    """(u, v, place, world) of the pixels in the boxes."""
    return (tiles if view.engine.is_numpy else kernel)(view, boxes)


def tiles(view: EyeScene, boxes: Int[np.ndarray, "n 4"]) -> Iterator[Piece]:
    """(u, v, place, world) of one tile after the other, whose arrays stay in the processor's cache."""
    size = view.local.camera.image_size
    tile, thing = touched(boxes, TILE_NUMPY, size)
    busy, start = np.unique(tile, return_index=True)
    rows, columns = np.divmod(busy, -(-size[0] // TILE_NUMPY))
    for x, y, ids in zip(columns * TILE_NUMPY, rows * TILE_NUMPY, np.split(thing, start[1:]), strict=False):
        x0, y0 = np.maximum(boxes[ids, :2].min(axis=0), (x, y)).tolist()
        x1, y1 = np.minimum(boxes[ids, 2:].max(axis=0), (x + TILE_NUMPY, y + TILE_NUMPY)).tolist()
        u, v = pixel_grid(view.engine, (x0, y0, x1, y1))
        yield u, v, (slice(y0, y1), slice(x0, x1)), view.near(ids.tolist())


def kernel(view: EyeScene, boxes: Int[np.ndarray, "n 4"]) -> Iterator[Piece]:
    """The same for Dr.Jit: all tiles at once."""
    size = view.local.camera.image_size
    found = np.zeros((-(-size[1] // TILE_DRJIT), -(-size[0] // TILE_DRJIT)), bool)
    pairs = 0
    for span in spans(boxes, TILE_DRJIT):
        found[span] = True
        pairs += found[span].size
    if len(busy := np.flatnonzero(found)):
        u, v, place, number = tile_grid(view.engine, busy, TILE_DRJIT, found.shape[1], size)
        kind, world = view.engine.float_type, view.everywhere
        if not view.table.few and pairs <= MAX_OBJECTS_PER_TILE * len(busy):
            tile, ids = touched(boxes, TILE_DRJIT, size)
            lists = kernel_lists(view.table, view.engine, np.searchsorted(busy, tile), ids, number)
            world = view.world(lists, world.casters)
        yield kind(u), kind(v), place, world
