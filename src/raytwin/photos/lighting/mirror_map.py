"""What a mirror ball shows, as a map of the light from all around.

A map is bilinear between texels' centres (`scene.Environment`), so fitting its texels is a linear least squares
problem: each pixel is weighted by its solid angle, and smoothness fills the texels that no pixel shows. The sun's spot
is left out. Clipped pixels beside it are lamps: a map of their own, of which the photo tells the shape alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from raytwin.photos.lighting.linear_photo import LinearPhoto
from raytwin.photos.lighting.mirror_ball import SPOT_AROUND, Ball, SunSpot, pixels_of, reflect

SMOOTH = 1e-3
"""Weight of differences between neighbouring texels, relative to a texel's own; it fills texels that no pixel shows."""


@dataclass(frozen=True, eq=False)
class Mirrored:
    """What a mirror ball's pixels in the photos of index `photo` (n,) show: `to_light` (n, 3), `radiance` (n, 3),
    `steradians` (n,), `clipped` (n,): at least so bright, `sun` (n,): those of the sun's spot."""

    photo: np.ndarray
    to_light: np.ndarray
    radiance: np.ndarray
    steradians: np.ndarray
    clipped: np.ndarray
    sun: np.ndarray


def mirrored(
    photos: list[LinearPhoto], ball: Ball, reflectance: np.ndarray, suns: Sequence[SunSpot | None]
) -> Mirrored:
    """All that the ball shows; `sun` marks each photo's spot, and the pixels about it that its glare lights."""
    parts = []
    for k, (photo, spot) in enumerate(zip(photos, suns, strict=True)):
        uv = pixels_of(photo, ball)
        out, right, down = (reflect(photo, ball, uv + np.array(s))[1] for s in ((0, 0), (0.1, 0), (0, 0.1)))
        steradians = np.linalg.norm(np.cross(right - out, down - out), axis=1) * 100
        clipped = photo.burnt[uv[:, 1], uv[:, 0]]
        near = np.linalg.norm(uv - spot[0], axis=1) < spot[1] / 2 + SPOT_AROUND - 1 if spot else np.zeros(len(uv), bool)
        radiance = np.maximum(photo.light[uv[:, 1], uv[:, 0]], 0) / reflectance
        parts.append((np.full(len(uv), k), out, radiance, steradians, clipped, near))
    return Mirrored(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def bilinear(directions: np.ndarray, rows: int) -> sparse.csr_matrix:
    """(n, 2 rows²): the weights of a map's texels in its radiance along directions (n, 3), as `Environment` has it."""
    w, (x, y, z) = 2 * rows, directions.T
    across = (0.5 + np.arctan2(x, y) / (2 * np.pi)) * w - 0.5
    down = np.clip(np.arctan2(np.hypot(x, y), z) / np.pi * rows - 0.5, 0, rows - 1)
    i, j = np.floor(across).astype(int), np.minimum(np.floor(down).astype(int), rows - 2)
    a, b = across - i, down - j
    n = np.arange(len(directions))
    parts = [
        sparse.csr_matrix((wa * wb, (n, (j + dj) * w + (i + di) % w)), (len(n), rows * w))
        for di, wa in ((0, 1 - a), (1, a)) for dj, wb in ((0, 1 - b), (1, b))
    ]  # fmt: skip
    return sum(parts[1:], parts[0])


def fit_map(seen: list[Mirrored], rows: int) -> tuple[np.ndarray, np.ndarray]:
    """(rows, 2 rows, 3) each: the map whose radiance is nearest to what all pixels show, weighed by steradian, without
    lamps, and that of the clipped lamps alone.

    Of several photos further passes give little weight to what the first leaves far off: the photographer, and whatever
    else is in one photo's way alone.
    """
    d, value, weight, clipped = (
        np.concatenate([getattr(s, name)[~s.sun] for s in seen])
        for name in ("to_light", "radiance", "steradians", "clipped")
    )
    A, w = bilinear(d, rows), 2 * rows
    # The sum of squared differences of neighbours: its matrix is a ring's Laplacian across, and a line's down.
    across = sparse.diags([2.0, -1, -1, -1, -1], [0, 1, -1, w - 1, 1 - w], shape=(w, w))
    down = sparse.diags([np.r_[1, 2 * np.ones(rows - 2), 1], -1, -1], [0, 1, -1], shape=(rows, rows))
    smooth = SMOOTH * 2 * np.pi**2 / (w * rows) * sparse.kronsum(across, down)
    both, trust = np.c_[value * ~clipped[:, None], value * clipped[:, None]], np.ones(len(d))
    for _ in range(3 if len(np.unique(np.concatenate([s.photo for s in seen]))) > 1 else 1):
        weighed = A.T @ sparse.diags(weight * trust)
        texels = spsolve((weighed @ A + smooth + 1e-12 * sparse.eye(w * rows)).tocsc(), weighed @ both)
        off = np.linalg.norm((A @ texels - both).reshape(-1, 2, 3).sum(axis=1), axis=1)
        trust = 1 / (1 + (off / max(3 * np.median(off), 1e-6)) ** 2)
    dim, lamps = np.maximum(texels, 0).reshape(rows, w, 2, 3).transpose(2, 0, 1, 3).astype(np.float32)
    return dim, lamps
