"""The whole tracer, fast: tiles that see some object, in any engine; the same pixels as `tracer.trace`."""

from collections.abc import Iterable, Iterator
from functools import lru_cache, partial
from typing import Any

import numpy as np

from raytwin.array_types import Float32, Int
from raytwin.errors import check_one_of
from raytwin.fast.boxes import TRIMS
from raytwin.fast.engine import ENGINES, Canvas, Engine, from_numpy, pixel_grid, tile_pixels, to_engine
from raytwin.fast.fast_world import FastWorld, Objects
from raytwin.images.image import Image, Surface
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Scene, to_camera_frame
from raytwin.scene.lens import NEWTON_STEPS, check_lens, distort, undone, without_ray
from raytwin.tracer.arrays import Vec, unit
from raytwin.tracer.hit import Stages
from raytwin.tracer.lights import Lighting, lighting
from raytwin.tracer.pixel_to_ray import to_board, undistort
from raytwin.tracer.render_image import EYE, STAGES
from raytwin.tracer.shading import RADIANCE
from raytwin.tracer.sphere import SOLVERS, intersect_sphere
from raytwin.tracer.world import surface_at

TILE_NUMPY, TILE_DRJIT = 128, 32
POINTS_AT_ONCE = 1 << 14
"""Points that NumPy traces together: they stay in the processor's cache, as a tile of TILE_NUMPY² pixels does."""
STAGES_OF_BOXES = ("intersect_sphere", "intersect_rectangle", "nearer", "sun_visible")
"""Where one of these is replaced, every ray tests every object: boxes no longer say what it can meet."""
SAME_ROOT_WITHIN = 1e-4
"""Solutions farther apart than this, in normalised coordinates, are different roots; rounding moves them far less."""
Piece = tuple[Any, Any, Any, FastWorld]
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
    if not RUNGS[rung].background:
        out[:] = 0
    elif scene.environment is None:
        out[:] = np.tile(np.array(scene.sky_radiance, np.float32), (w, 1))
    else:
        view = EyeScene(scene, ENGINES["numpy64"])
        with np.errstate(all="ignore"):  # where the lens has no ray
            for u, v, place, _ in pieces(view, np.array([(0, 0, w, h)])):
                out[place] = np.stack(view.light.sky.radiance(view.ray(u, v)), axis=-1)
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
    if stages.intersect_sphere is intersect_sphere and solver != "robust":  # a stage that was replaced stays
        stages = stages._replace(intersect_sphere=partial(intersect_sphere, solver=solver))
    view = EyeScene(scene, ENGINES[engine], stages, every=trim == "none")
    layers = [out] if surface is None else [out, surface.ids, surface.depth, surface.normal]
    lost = without_ray(scene.camera)
    before = [] if lost is None else [layer[lost] for layer in layers]
    paint(view, pieces(view, TRIMS[trim](scene.objects, scene.camera)), rung, layers)
    for layer, values in zip(layers, before, strict=False):
        layer[lost] = values


def paint(view: "EyeScene", found: Iterable[Piece], rung: str, layers: list[np.ndarray]) -> None:
    """Write what each pixel of the pieces sees into as many layers as are given: radiance, ids, depth, normal."""
    canvas = Canvas(view.engine, layers)

    def one(u: Any, v: Any, place: Any, world: FastWorld) -> None:
        d = view.ray(u, v)
        t, ids = world.closest_hit(EYE, d)

        def shade() -> None:
            hit = surface_at(world, EYE, d, t, ids)
            radiance = RADIANCE[rung](hit, view.light, world, view.camera)
            normal = to_board(hit.normal, view.camera) if len(layers) == 4 else ()
            canvas.store(place, [radiance, (ids,), (t,), normal][: len(layers)], ids >= 0)

        if view.engine.is_numpy:
            shade()
        else:  # all other rays cost nothing
            import drjit

            drjit.if_stmt((), ids >= 0, shade, lambda: None)

    with np.errstate(all="ignore"):  # infinities and NaN of missed rays are selected away
        for piece in found:
            one(*piece)
    canvas.flush()


def check_rows(rung: str, engine: str, solver: str, trim: str) -> None:
    """Raise InputError unless each is a row of its table."""
    tables = ("rung", rung, RADIANCE), ("engine", engine, ENGINES), ("solver", solver, SOLVERS), ("trim", trim, TRIMS)
    for what, name, table in tables:
        check_one_of(what, name, table)


class EyeScene:
    """A scene as its camera sees it: `local` in the camera's frame, in float64; the rest in the engine's floats.

    `camera` has its rotation, which leads back to the board's frame. `every`: no object is left out of any test.
    """

    def __init__(self, scene: Scene, engine: Engine, stages: Stages = STAGES, every: bool = False) -> None:
        self.engine, self.stages = engine, stages
        self.local = to_camera_frame(scene, engine.precision)
        self.camera: Camera = to_engine(scene.camera, engine)
        light: Lighting = to_engine(lighting(self.local), engine)
        self.light = light._replace(to_sun=unit(light.to_sun))  # in the engine's own floats
        self.undo = stages.undistort
        if self.undo is undistort:  # and not a student's, or a fault's
            self.undo = partial(undistort, steps=newton_steps(scene.camera, engine.precision))
        # A replaced step may meet objects beyond their boxes, or ask for others than the nearest.
        replaced = any(getattr(stages, name) is not getattr(STAGES, name) for name in STAGES_OF_BOXES)
        self.objects = Objects(self.local, engine, every or replaced)

    def ray(self, u: Any, v: Any) -> Vec:
        """The unit directions through pixels (u, v), in the camera's frame."""
        x, y, z = self.stages.back_project(u, v, self.camera, self.undo)
        return x, y, z

    def world(self, seen: Int[np.ndarray, " n"] | None = None) -> FastWorld:
        """What rays are tested against; those of the eye against the objects `seen` alone, where they are given."""
        if seen is None or self.objects.every:
            seen = np.arange(self.objects.number)
        return FastWorld(self.objects, self.stages, seen.tolist())


@lru_cache(maxsize=64)
def newton_steps(camera: Camera, precision: str = "float64") -> int:
    """Return the fewest steps of `undistort` that come back to rounding from all over the frame; 0 for a pinhole.

    Raises InputError where `check_lens` does.
    """
    dist = camera.coefficients
    if not any(dist):
        return 0
    check_lens(camera)
    known = undone(camera.K, camera.dist, camera.image_size)
    xd, yd = ((known.pixels[known.found] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)).T
    enough = 2e-14 if precision == "float64" else 2e-8
    with np.errstate(all="ignore"):
        for steps in range(NEWTON_STEPS):
            ended = undistort(xd, yd, dist, steps)
            apart = np.hypot(*(ended - known.ideal[known.found].T)).max()  # large at a root beyond a fold
            if np.hypot(*np.subtract(distort(*ended, dist), (xd, yd))).max() < enough and apart < SAME_ROOT_WITHIN:
                return steps
    return NEWTON_STEPS


def pieces(view: EyeScene, boxes: Int[np.ndarray, "n 4"]) -> Iterator[Piece]:
    """The pixels in the boxes: on NumPy one tile after the other, whose arrays stay in the processor's cache."""
    w, h = view.local.camera.image_size
    if not view.engine.is_numpy:
        found = np.zeros((-(-h // TILE_DRJIT), -(-w // TILE_DRJIT)), bool)
        for x0, y0, x1, y1 in np.concatenate([boxes[:, :2] // TILE_DRJIT, -(-boxes[:, 2:] // TILE_DRJIT)], 1).tolist():
            found[y0:y1, x0:x1] = True
        if found.any():
            u, v, place = tile_pixels(view.engine, np.argwhere(found), TILE_DRJIT, (w, h))
            kind = view.engine.float_type
            yield kind(u), kind(v), place, view.world()
        return
    for y in range(0, h, TILE_NUMPY):
        for x in range(0, w, TILE_NUMPY):
            tile = np.array((x, y, x + TILE_NUMPY, y + TILE_NUMPY))
            if len(ids := touching(boxes, tile)):
                x0, y0 = np.maximum(boxes[ids, :2].min(axis=0), tile[:2]).tolist()
                x1, y1 = np.minimum(boxes[ids, 2:].max(axis=0), tile[2:]).tolist()
                u, v = pixel_grid(view.engine, (x0, y0, x1, y1))
                yield u, v, (slice(y0, y1), slice(x0, x1)), view.world(ids)


def points(view: EyeScene, boxes: Int[np.ndarray, "n 4"], u: np.ndarray, v: np.ndarray) -> Iterator[Piece]:
    """Any pixels (u, v) (m,) in their order, as those of a frame of m x 1."""
    if not view.engine.is_numpy:
        import drjit

        place = drjit.arange(drjit.uint32_array_t(view.engine.float_type), len(u))
        yield from_numpy(view.engine, u), from_numpy(view.engine, v), place, view.world()
        return
    for start in range(0, len(u), POINTS_AT_ONCE):
        part = slice(start, start + POINTS_AT_ONCE)
        x, y = u[part], v[part]
        ids = touching(boxes, np.array((x.min(), y.min(), x.max() + 1, y.max() + 1)))
        yield *(from_numpy(view.engine, a)[None] for a in (x, y)), (slice(1), part), view.world(ids)


def touching(boxes: Int[np.ndarray, "n 4"], box: Int[np.ndarray, " 4"]) -> Int[np.ndarray, " m"]:
    """The objects whose boxes have a pixel in common with `box`, in their order; an empty box has none."""
    x0, y0, x1, y1 = boxes.T
    return np.flatnonzero(
        (np.maximum(x0, box[0]) < np.minimum(x1, box[2])) & (np.maximum(y0, box[1]) < np.minimum(y1, box[3]))
    )
