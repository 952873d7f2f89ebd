"""High-resolution speculation: trace a coarse lattice, guess the pixels between by interpolation.

`paper` guesses everywhere, edges too. `careful` guesses only where nothing but smooth shading lies between four lattice
points: a block of n x n pixels is traced whole where its corners see different objects, or light that other objects
hide, where a neighbour's edge may cross it, or where the second differences say that interpolation errs too much. What
no lattice point sees is lost: an object, a shadow or a gap between shadows that is thinner than a block.

The bound. Bilinear interpolation over a step h errs by at most (|f_uu| + |f_vv|) h²/8. On a sphere whose image has
the radius R pixels, seen nearly head on, L = a + b n·l with n = (x, y, √(1 - x² - y²)), x and y in radii; only n_z
curves, and n_z'' = -(1 - y²) / n_z³ along x, so that the error is at most b h²/(8 R²) (2 - x² - y²) / n_z³ of the
largest within the block. `careful` measures the second differences on the lattice instead of assuming all this, and
takes twice their value, for the growth of the curvature between two lattice points; `interpolation_bound` gives the
closed form.
"""

import numpy as np

from raytwin.errors import check_one_of
from raytwin.image import BACKGROUND
from raytwin.scene import Scene
from raytwin.scene.lens import without_ray
from raytwin.speed.frame import background, draw
from raytwin.speed.points import trace_points

WAYS = ("careful", "paper")


def interpolation_bound(amplitude: float, step: float, radius_px: float, rim: float) -> float:
    """b h²/(8 R²) (1 + n_z²) / n_z³: the error of bilinear interpolation on a Lambertian sphere out to `rim` radii.

    `amplitude` b: albedo/π E; `step` h and `radius_px` R: pixels; `rim` = √(x² + y²) < 1 of the block's farthest point.
    """
    nz = np.sqrt(1 - rim * rim)
    return float(amplitude * step**2 / (8 * radius_px**2) * (1 + nz**2) / nz**3)


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
