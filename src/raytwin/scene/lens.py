"""The one inverse of a lens, outside the subject; over which part of the frame it exists, and at which pixel not.

    x' = x g + 2 p1 x y + p2 (r² + 2 x²)      g = 1 + k1 r² + k2 r⁴ + k3 r⁶,  r² = x² + y²
    y' = y g + p1 (r² + 2 y²) + 2 p2 x y      (Brown 1966; in OpenCV's order k1, k2, p1, p2, k3)

takes an ideal point (x, y) to the distorted one, u = fx x' + cx, v = fy y' + cy. Far enough out every such polynomial
folds back or diverges. A fold is where the Jacobian's determinant is 0: there two directions share a pixel. So a pixel
has a ray where Newton's method, from the distorted point, comes to an ideal point that distorts back to it, and the
determinant stays positive on the straight line to there from the middle.

A fit folds where no photo constrains the lens, in a corner. Renderers leave such pixels black, as if they met nothing
(`without_ray`), and say so once; a lens that loses more than MAX_SHARE_WITHOUT_RAYS of the frame is refused
(`check_lens`).
"""

import warnings
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from raytwin.array_types import Bool, Float
from raytwin.errors import InputError
from raytwin.scene.camera import Camera

LEAST_DETERMINANT = 1e-3
"""Determinant below which a lens counts as folded: a pixel there sees 1000 times the solid angle of the middle's."""

NEWTON_STEPS = 20
"""Steps of Newton's method: each doubles the correct digits; a strong lens needs half a dozen before that begins."""

LAST_STEP, LARGEST_ERROR = 1e-9, 1e-9
"""Newton's method ends after a shorter step: the next would be rounding. A point that distorts back to within the
second, relative to its size, is found. Both in focal lengths."""

CELLS = 48
"""Cells along each side of the frame, at whose corners the lens is inverted: a cell has rays where its four corners do.
The part with rays is round, so a cell whose corners lie within it lies within it whole. A smooth fold that comes in
between two corners on the frame's border comes in by (side / 96)² / (2 · its radius of curvature)."""

MAX_SHARE_WITHOUT_RAYS = 0.5
"""The largest share of the frame that may be without rays."""

ALONG = np.linspace(0, 1, 49)[1:, None]
"""Places on the line from the middle to an ideal point at which the determinant is computed."""


class Undone(NamedTuple):
    """Where a distortion can be inverted, at the corners of CELLS x CELLS cells, row by row.

    `pixels` (n, 2): the places; `ideal` (n, 2): their ideal points, normalised; `found` (n,): whether those are right.
    """

    pixels: Float[np.ndarray, "n 2"]
    ideal: Float[np.ndarray, "n 2"]
    found: Bool[np.ndarray, " n"]

    @property
    def fault(self) -> str:
        """Return which pixel has no ray, of several the one farthest from the middle; empty where all have one."""
        if self.found.all():
            return ""
        away = np.hypot(*(self.pixels - self.pixels.mean(axis=0)).T)
        u, v = self.pixels[np.argmax(np.where(self.found, 0, away))]
        return f"pixel ({u:.1f}, {v:.1f}): two directions share it, or Newton's method does not come to the one"


def undone(K: Any, dist: Sequence[float], image_size: tuple[int, int]) -> Undone:
    """Return where `dist` (any prefix of k1, k2, p1, p2, k3) can be inverted in a frame of (width, height)."""
    numbers = (*map(float, dist), *(0.0,) * (5 - len(dist)))
    (fx, _, cx), (_, fy, cy), _ = np.asarray(K, float).tolist()
    return _undone(fx, fy, cx, cy, numbers, tuple(image_size))


@lru_cache(maxsize=64)
def _undone(fx: float, fy: float, cx: float, cy: float, dist: tuple[float, ...], image_size: tuple[int, int]) -> Undone:
    u, v = (a.ravel() for a in np.meshgrid(*(np.linspace(-0.5, side - 0.5, CELLS + 1) for side in image_size)))
    x, y, found = inverse((u - cx) / fx, (v - cy) / fy, dist)
    return Undone(np.stack([u, v], axis=1), np.stack([x, y], axis=1), found)


def check_lens(camera: Camera) -> None:
    """Raise InputError, a pixel named, unless the camera's distortion can be undone over most of the frame."""
    lost = without_ray(camera)
    if lost is not None and lost.mean() > MAX_SHARE_WITHOUT_RAYS:
        fault = undone(camera.K, camera.dist, camera.image_size).fault
        found = f"{list(camera.dist)}, which cannot at {fault}, nor over {100 * lost.mean():.0f} % of it"
        raise InputError("camera.dist", "a distortion that can be undone over most of the image", found)


class Folds(UserWarning):
    """A lens that cannot be undone over a part of the frame, whose pixels are left black."""


@lru_cache(maxsize=8)
def without_ray(camera: Camera) -> Bool[np.ndarray, "h w"] | None:
    """Return (H, W) bool, read-only: the pixels that no ray belongs to; None if every pixel has a ray."""
    if not any(camera.dist):
        return None
    corner = ~undone(camera.K, camera.dist, camera.image_size).found.reshape(CELLS + 1, CELLS + 1)
    cell = corner[:-1, :-1] | corner[:-1, 1:] | corner[1:, :-1] | corner[1:, 1:]
    column, row = (CELLS * (2 * np.arange(side) + 1) // (2 * side) for side in camera.image_size)
    lost: np.ndarray = cell[row[:, None], column]
    lost.flags.writeable = False
    if 0 < lost.mean() <= MAX_SHARE_WITHOUT_RAYS:
        text = f"no ray belongs to {lost.sum()} of {lost.size} pixels ({100 * lost.mean():.2g} %): left black"
        warnings.warn(f"camera.dist: {list(camera.dist)} cannot be undone there, and {text}", Folds, stacklevel=2)
    return lost if lost.any() else None


def has_no_ray(camera: Camera, u: Any, v: Any) -> Bool[np.ndarray, "..."]:
    """Return which places (u, v) lie in a pixel that no ray belongs to, or beyond the frame next to one."""
    u, v = np.broadcast_arrays(u, v)
    if (lost := without_ray(camera)) is None:
        return np.zeros(u.shape, bool)
    column, row = (np.clip(np.rint(a).astype(int), 0, n - 1) for a, n in ((u, camera.width), (v, camera.height)))
    return np.asarray(lost[row, column])


def inverse(
    xd: Float[np.ndarray, " n"], yd: Float[np.ndarray, " n"], dist: Sequence[float]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Return the ideal points (x, y) of the distorted (xd, yd), all (n,), and where they are the inverse: see above."""
    x, y = newton(xd, yd, dist)
    with np.errstate(all="ignore"):
        back = distort(x, y, dist)
        found = np.hypot(back[0] - xd, back[1] - yd) <= LARGEST_ERROR * (1 + np.hypot(xd, yd))
        area = determinant(ALONG * x, ALONG * y, dist)
        # Between its neighbours a least value may lie lower: at the vertex of the parabola through the three.
        before, here, after = area[:-2], area[1:-1], area[2:]
        curve = before - 2 * here + after
        vertex = here - (before - after) ** 2 / (8 * np.where(curve > 0, curve, np.inf))
        vertex[(here > before) | (here > after)] = np.inf
        return x, y, found & (area.min(axis=0) >= LEAST_DETERMINANT) & (vertex.min(axis=0) >= LEAST_DETERMINANT)


def distort(x: Any, y: Any, dist: Sequence[Any]) -> tuple[Any, Any]:
    """Return (x', y') of the ideal (x, y); `dist`: k1, k2, p1, p2, k3."""
    k1, k2, p1, p2, k3 = dist
    rr = x * x + y * y
    g = 1 + rr * (k1 + rr * (k2 + rr * k3))
    return x * g + 2 * p1 * x * y + p2 * (rr + 2 * x * x), y * g + p1 * (rr + 2 * y * y) + 2 * p2 * x * y


def jacobian(x: Any, y: Any, dist: Sequence[Any]) -> tuple[Any, Any, Any]:
    """Return ∂x'/∂x, ∂x'/∂y = ∂y'/∂x, ∂y'/∂y."""
    k1, k2, p1, p2, k3 = dist
    rr = x * x + y * y
    g = 1 + rr * (k1 + rr * (k2 + rr * k3))
    slope = 2 * (k1 + rr * (2 * k2 + rr * 3 * k3))  # dg = slope (x dx + y dy)
    xx, yy = g + x * x * slope + 2 * p1 * y + 6 * p2 * x, g + y * y * slope + 6 * p1 * y + 2 * p2 * x
    return xx, x * y * slope + 2 * p1 * x + 2 * p2 * y, yy


def determinant(x: Any, y: Any, dist: Sequence[float]) -> Any:
    """Return how much larger a small area is distorted than ideal: 0 at a fold, and 1 in the middle."""
    xx, xy, yy = jacobian(x, y, dist)
    return xx * yy - xy * xy


def newton(
    xd: Float[np.ndarray, "*n"], yd: Float[np.ndarray, "*n"], dist: Sequence[float]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Return the (x, y) with distort(x, y) = (xd, yd), by Newton's method; correct where `undone` says so."""
    x, y = xd, yd
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            dx, dy = newton_step(x, y, xd, yd, dist)
            x, y = x + dx, y + dy
            if not (np.abs(dx) + np.abs(dy) > LAST_STEP).any():
                break
    return x, y


def newton_step(x: Any, y: Any, xd: Any, yd: Any, dist: Sequence[Any]) -> tuple[Any, Any]:
    """Return how far Newton's method goes from (x, y) for distort to give (xd, yd): J⁻¹ e."""
    fx, fy = distort(x, y, dist)
    ex, ey, (a, b, c) = xd - fx, yd - fy, jacobian(x, y, dist)
    scale = 1 / (a * c - b * b)
    return (c * ex - b * ey) * scale, (a * ey - b * ex) * scale
