"""High-resolution speculation: trace a coarse lattice, guess the pixels between by interpolation.

`paper` guesses everywhere, edges too. `careful` guesses only where nothing but smooth shading lies between four lattice
points: a block of n x n pixels is traced whole where its corners see different objects, or light that other objects
hide, where a neighbour's edge may cross it, or where the second differences say that interpolation errs too much. What
no lattice point sees is lost: an object, a shadow or a gap between shadows that is thinner than a block.

Bilinear interpolation over a step h errs by at most (|f_uu| + |f_vv|) h²/8. `careful` measures the second differences
on the lattice, and takes twice their value, for the growth of the curvature between two lattice points.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from raytwin.array_types import Bool, Float32, Int32
from raytwin.errors import check_one_of
from raytwin.fast.boxes import trim_boxes
from raytwin.fast.engine import ENGINES, evaluate, from_numpy, to_numpy
from raytwin.fast.fast_world import FastWorld, Ray
from raytwin.fast.frame import EyeScene, background, draw
from raytwin.images.image import BACKGROUND
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, Shape
from raytwin.scene.lens import has_no_ray, without_ray
from raytwin.tracer.arrays import Vec, dot, integers, select
from raytwin.tracer.hit import Hit
from raytwin.tracer.pixel_to_ray import to_board
from raytwin.tracer.render_image import EYE
from raytwin.tracer.shading import RADIANCE
from raytwin.tracer.world import first_hit, hides

WAYS = ("careful", "paper")
CHUNK = 1 << 14
"""Points that NumPy traces at a time: they stay in the cache."""


LIT, AWAY = -1, -2
"""Values of `blocker`: nothing hides the sun; the surface is turned away from it, or there is no surface."""


class Points(NamedTuple):
    """Per ray (m,): `colour` (m, 3), `ids`, `blocker`: id of an object that hides the sun there, LIT or AWAY; `point`
    (m, 3): from the eye, board's axes."""

    colour: Float32[np.ndarray, "m 3"]
    ids: Int32[np.ndarray, " m"]
    blocker: Int32[np.ndarray, " m"]
    point: Float32[np.ndarray, "m 3"] | None

    @property
    def lit(self) -> Bool[np.ndarray, " m"]:
        """(m,): the sun reaches it."""
        return np.asarray(self.blocker == LIT)


def trace_points(
    scene: Scene, u: np.ndarray, v: np.ndarray, rung: str, engine: str, light: bool = True, point: bool = False
) -> Points:
    """What the rays through pixels (u, v) (m,) see; `blocker` is found where `light` asks for it, `point` likewise."""
    view, m = EyeScene(scene, ENGINES[engine]), len(u)
    colour, ids, blocker = np.empty((m, 3), np.float32), np.empty(m, np.int32), np.full(m, AWAY, np.int32)
    place = np.empty((m, 3), np.float32) if point else None
    shaded = RUNGS[rung].shadows
    for part, world in _parts(view, u, v):
        with np.errstate(all="ignore"):
            hit = first_hit(world, EYE, view.ray(*(from_numpy(view.engine, a[part]) for a in (u, v))))
            layers = [(colour[part], RADIANCE[rung](hit, view.light, world, view.camera)), (ids[part], (hit.ids,))]
            if light:
                facing = (hit.ids >= 0) & (dot(hit.normal, view.light.to_sun) > 0)
                blocked_by = _blocker(hit, view.light.to_sun, world) if shaded else integers(hit.t, LIT)
                layers.append((blocker[part], (select(facing, blocked_by, AWAY),)))
            if place is not None:
                layers.append((place[part], to_board(hit.point, view.camera)))
        evaluate(view.engine, [values for _, values in layers])
        for out, values in layers:
            columns = out.reshape(len(out), -1)
            for c, value in enumerate(values):
                columns[:, c] = to_numpy(value, (len(out),))
    lost = has_no_ray(scene.camera, u, v)
    colour[lost], ids[lost], blocker[lost] = 0, BACKGROUND, AWAY
    return Points(colour, ids, blocker, place)


def _blocker(hit: Hit, to_sun: Vec, world: FastWorld) -> Any:
    """The id of the last object in the world's order that hides the sun, by the test of `World.blocked`; else LIT."""

    def block(state: Any, ray: Any, index: Any, thing: Shape) -> Any:
        return (select(hides(ray.start, ray.d, thing, index, world.stages), index, state[0]),)

    none = (select(hit.inside, hit.ids, LIT),)
    return world.casters.fold(Ray(hit.point, to_sun, hit), none, block)[0]


def _parts(view: EyeScene, u: np.ndarray, v: np.ndarray) -> Iterator[tuple[slice, FastWorld]]:
    """The points in portions, each with the objects that it may see; any object may shade these."""
    if len(u) and view.engine.is_numpy:
        camera = view.local.camera  # the lattice's last points may lie beyond its frame
        size = max(camera.width, int(u.max()) + 2), max(camera.height, int(v.max()) + 2)
        x0, y0, x1, y1 = trim_boxes(view.local.objects, camera.grid(size=size)).T
        for start in range(0, len(u), CHUNK):
            part = slice(start, start + CHUNK)
            x, y = u[part], v[part]
            near = (x0 - 1 < x.max()) & (x.min() < x1) & (y0 - 1 < y.max()) & (y.min() < y1)
            yield part, view.near(np.flatnonzero(near).tolist())
    elif len(u):
        yield slice(None), view.everywhere


def speculate(
    scene: Scene, n: int, rung: str = "shadow", engine: str = "numpy32", way: str = "careful", tolerance: float = 5e-4
) -> tuple[np.ndarray, float]:
    """Radiance (H, W, 3) float32 from a lattice of every n-th pixel, and the share of all pixels that was traced.

    `tolerance`: the largest interpolation error allowed in a block, in units of radiance. n = 1 traces every pixel.
    Raises InputError for a `way` that is not in WAYS.
    """
    check_one_of("way", way, WAYS)
    w, h = scene.camera.image_size
    out = background(scene, rung)
    if n == 1:
        draw(scene, out, rung, engine, trim="none")
        return out, 1.0
    # Blocks that cover the frame, and so a lattice that ends beyond it.
    columns, rows = -(-w // n) + 1, -(-h // n) + 1
    across, down = np.meshgrid(np.arange(columns) * n, np.arange(rows) * n)
    lattice = trace_points(scene, across.ravel(), down.ravel(), rung, engine)
    colour = lattice.colour.reshape(rows, columns, 3)
    ids, blocker = lattice.ids.reshape(rows, columns), lattice.blocker.reshape(rows, columns)
    whole = np.zeros((rows - 1, columns - 1), bool)
    if way == "careful":
        whole = doubtful(colour, ids, blocker, tolerance)
    guessed = ~whole & (_blocks(ids != BACKGROUND).any(axis=0) if way == "paper" else ids[:-1, :-1] != BACKGROUND)
    bare = ids == BACKGROUND
    colour[bare] = out[np.minimum(down[bare], h - 1), np.minimum(across[bare], w - 1)]
    _interpolate(out, colour, guessed, n)
    y, x = np.nonzero(whole)
    inner = np.arange(n)
    u: np.ndarray = (x[:, None, None] * n + inner[None, None, :] + 0 * inner[None, :, None]).ravel()
    v: np.ndarray = (y[:, None, None] * n + inner[None, :, None] + 0 * inner[None, None, :]).ravel()
    inside = (u < w) & (v < h)
    column, row = u[inside], v[inside]
    traced = trace_points(scene, column, row, rung, engine, light=False)
    seen = traced.ids != BACKGROUND
    out[row[seen], column[seen]] = traced.colour[seen]
    if (lost := without_ray(scene.camera)) is not None:
        out[lost] = 0
    return out, (columns * rows + len(column)) / (w * h)


def doubtful(colour: np.ndarray, ids: np.ndarray, blocker: np.ndarray, tolerance: float) -> np.ndarray:
    """(rows - 1, columns - 1) bool: the blocks between lattice points that must be traced pixel by pixel."""
    # Which object hides the sun counts too: between the shadows of two, light may come through.
    seen = _blocks(ids)
    edge = np.asarray(sum((a != a[0]).any(axis=0) for a in (seen, _blocks(blocker))) > 0)
    # An edge may bulge into the next block between two of its corners: take the neighbours too.
    padded = np.pad(edge, 1)
    grown = sum(
        padded[1 + dy : 1 + dy + edge.shape[0], 1 + dx : 1 + dx + edge.shape[1]]
        for dy in (-1, 0, 1)
        for dx in (-1, 0, 1)
    )
    bend = np.zeros(ids.shape, np.float32)
    bend[:, 1:-1] += np.abs(np.diff(colour, 2, axis=1)).max(axis=-1)
    bend[1:-1] += np.abs(np.diff(colour, 2, axis=0)).max(axis=-1)
    curved = (_blocks(bend).max(axis=0) / 4 > tolerance) & (seen[0] >= 0)
    return np.asarray((grown > 0) | curved)


def _blocks(a: np.ndarray) -> np.ndarray:
    """(4, rows - 1, columns - 1, ...): the four corners of each block."""
    return np.stack([a[:-1, :-1], a[:-1, 1:], a[1:, :-1], a[1:, 1:]])


def _interpolate(out: np.ndarray, colour: np.ndarray, blocks: np.ndarray, n: int) -> None:
    """Fill the blocks marked with the bilinear interpolation of their corners, n x n pixels each, row by row."""
    h, w = out.shape[:2]
    s = (np.arange(n, dtype=np.float32) / n)[:, None]
    for y in np.flatnonzero(blocks.any(axis=1)):
        x = np.flatnonzero(blocks[y])
        top, bottom = colour[y], colour[y + 1]
        depth = min(n, h - y * n)
        for first, last in zip(*_runs(x), strict=True):
            # Along the row, then down: a run of neighbouring blocks at once.
            t = top[first : last + 2]
            b = bottom[first : last + 2]
            upper = (t[:-1, None] + s * (t[1:, None] - t[:-1, None])).reshape(-1, 3)
            lower = (b[:-1, None] + s * (b[1:, None] - b[:-1, None])).reshape(-1, 3)
            end = min((last + 1) * n, w) - first * n
            block = upper[None, :end] + s[:depth, :, None] * (lower - upper)[None, :end]
            out[y * n : y * n + depth, first * n : first * n + end] = block


def _runs(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last of each run of consecutive integers in sorted x."""
    breaks = np.flatnonzero(np.diff(x) != 1)
    return x[np.r_[0, breaks + 1]], x[np.r_[breaks, len(x) - 1]]
