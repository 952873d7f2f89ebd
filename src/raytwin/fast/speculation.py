"""High-resolution speculation: trace a coarse lattice, guess the pixels between by interpolation.

`paper` guesses everywhere, edges too. `careful` guesses only where nothing but smooth shading lies between four lattice
points: a block of n x n pixels is traced whole where its corners see different objects, or light that other objects
hide, where a neighbour's edge may cross it, or where the second differences say that interpolation errs too much. What
no lattice point sees is lost: an object, a shadow or a gap between shadows that is thinner than a block.

Bilinear interpolation over a step h errs by at most (|f_uu| + |f_vv|) h²/8. `careful` measures the second differences
on the lattice, and takes twice their value, for the growth of the curvature between two lattice points.
"""

import numpy as np

from raytwin.array_types import Int
from raytwin.errors import check_one_of
from raytwin.fast.boxes import trim_boxes
from raytwin.fast.engine import ENGINES
from raytwin.fast.frame import EyeScene, background, draw, paint, points
from raytwin.images.image import BACKGROUND, Surface
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.lens import has_no_ray, without_ray

WAYS = ("careful", "paper")


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
    view = EyeScene(scene, ENGINES[engine])
    boxes = trim_boxes(scene.objects, scene.camera.grid(size=(columns * n, rows * n)))
    across, down = (a.ravel() for a in np.meshgrid(np.arange(columns) * n, np.arange(rows) * n))
    careful = way == "careful"
    colour, ids, *surface = trace_points(view, boxes, across, down, rung, 4 if careful else 2)
    light = (surface[1] @ scene.sun.to_light > 0).astype(int) if careful else 0 * ids
    if careful and RUNGS[rung].shadows:
        light += light * (colour == trace_points(view, boxes, across, down, "lambert")[0]).all(axis=-1)
    bare = (ids == BACKGROUND) | has_no_ray(scene.camera, across, down)
    colour[bare], ids[bare] = out[np.minimum(down[bare], h - 1), np.minimum(across[bare], w - 1)], BACKGROUND
    colour, ids, light = (a.reshape(rows, columns, *a.shape[1:]) for a in (colour, ids, light))
    whole = doubtful(colour, ids, light, tolerance) & careful
    _interpolate(out, colour, ~whole & (corners(ids) != BACKGROUND).any(axis=0), n)
    y, x = np.nonzero(whole)
    inner = np.arange(n)
    u, v = np.broadcast_arrays(x[:, None, None] * n + inner, y[:, None, None] * n + inner[:, None])
    inside = (u < w) & (v < h)
    column, row = u[inside], v[inside]
    traced, ids = trace_points(view, boxes, column, row, rung)
    seen = ids != BACKGROUND
    out[row[seen], column[seen]] = traced[seen]
    if (lost := without_ray(scene.camera)) is not None:
        out[lost] = 0
    return out, (columns * rows + len(column)) / (w * h)


def trace_points(
    view: EyeScene, boxes: Int[np.ndarray, "n 4"], u: np.ndarray, v: np.ndarray, rung: str, number: int = 2
) -> list[np.ndarray]:
    """What the rays through pixels (u, v) (m,) meet, the first `number` of: radiance, ids, depth, normal (m, ...)."""
    surface = Surface.empty(len(u), 1)
    layers = [np.zeros((1, len(u), 3), np.float32), surface.ids, surface.depth, surface.normal][:number]
    if len(u):
        paint(view, points(view, boxes, u, v), rung, layers)
    return [layer[0] for layer in layers]


def doubtful(colour: np.ndarray, ids: np.ndarray, light: np.ndarray, tolerance: float) -> np.ndarray:
    """(rows - 1, columns - 1) bool: the blocks between lattice points that must be traced pixel by pixel.

    `light`: 2 where the sun shines, 1 where something hides it, 0 on a side that is turned away from it.
    """
    seen = corners(ids)
    edge = np.any([(a != a[0]).any(axis=0) for a in (seen, corners(light))], axis=0)
    # An edge may bulge into the next block between two of its corners: take the neighbours too.
    (rows, columns), padded = edge.shape, np.pad(edge, 1)
    grown = np.any([padded[y : y + rows, x : x + columns] for y in range(3) for x in range(3)], axis=0)
    bend = np.zeros(ids.shape, np.float32)
    bend[:, 1:-1] += np.abs(np.diff(colour, 2, axis=1)).max(axis=-1)
    bend[1:-1] += np.abs(np.diff(colour, 2, axis=0)).max(axis=-1)
    return np.asarray(grown | ((corners(bend).max(axis=0) / 4 > tolerance) & (seen[0] >= 0)))


def corners(a: np.ndarray) -> np.ndarray:
    """(4, rows - 1, columns - 1, ...): the four corners of each block."""
    return np.stack([a[:-1, :-1], a[:-1, 1:], a[1:, :-1], a[1:, 1:]])


def _interpolate(out: np.ndarray, colour: np.ndarray, blocks: np.ndarray, n: int) -> None:
    """Fill the blocks marked with the bilinear interpolation of their corners, n x n pixels each, row by row."""
    h, w = out.shape[:2]
    s = (np.arange(n, dtype=np.float32) / n)[:, None]
    for y in np.flatnonzero(blocks.any(axis=1)):
        x = np.flatnonzero(blocks[y])
        depth = min(n, h - y * n)
        for run in np.split(x, np.flatnonzero(np.diff(x) != 1) + 1):
            # Along the row, then down: a run of neighbouring blocks at once.
            first, end = run[0], min((run[-1] + 1) * n, w)
            upper, lower = (
                (c[:-1, None] + s * (c[1:, None] - c[:-1, None])).reshape(-1, 3)[: end - first * n]
                for c in colour[y : y + 2, first : run[-1] + 2]
            )
            block = upper + s[:depth, :, None] * (lower - upper)
            out[y * n : y * n + depth, first * n : end] = block
