"""Can this lens be undone? Over which part of the frame, and at which pixel not: the one answer that all ask for.

    x' = x g + 2 p1 x y + p2 (r² + 2 x²)      g = 1 + k1 r² + k2 r⁴ + k3 r⁶,  r² = x² + y²
    y' = y g + p1 (r² + 2 y²) + 2 p2 x y      (Brown 1966; in OpenCV's order k1, k2, p1, p2, k3)

takes an ideal point (x, y) to the distorted one, u = fx x' + cx, v = fy y' + cy. Far enough out every such polynomial
folds back or diverges, so an inverse is valid only along a way from the middle. The way to a distorted q is the curve
x(s) with distort(x(s)) = s q and x(0) = 0. It goes on while the Jacobian's determinant is positive; where that is 0
lies a fold, at which two directions share a pixel. Seen from the principal point no pixel hides behind another, so if
the way reaches every pixel of the border, it reaches all, and the inverse is smooth over the whole frame.

Second, whoever undoes a lens here does it by Newton's method from the distorted point: it must come to the way's end.

A fit folds where no photo constrains the lens, in a corner. Renderers leave such pixels black, as if they met nothing
(`without_ray`), and say so once; a lens that loses more than MOST of the frame is refused (`check_lens`).
"""

import warnings
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from raytwin.array_types import Bool, Float
from raytwin.errors import InputError
from raytwin.scene.camera import Camera

Places = Float[np.ndarray, " n"]
"""A coordinate, or a share, of each of n places."""

LEAST = 1e-3
"""The least determinant that counts as undone: there a pixel sees a thousand times the solid angle of the middle's."""

STEPS = 20
"""Newton's steps: each doubles the number of right digits; a strong lens needs half a dozen before that begins."""

SETTLED = 1e-9
"""After a step of Newton's shorter than this the next would be rounding."""

SIDE = 65
"""Places tested on each side of the border, corners included. A smooth fold that comes in between two of them comes in
by (side / 128)² / (2 · its radius of curvature): less than the half pixel from the border to a pixel's centre."""

CELLS = 128
"""Cells along each side by which pixels without a ray are found: a cell has rays where all four of its corners do. The
part that can be undone is round, so a cell whose corners lie within it lies within it whole."""

MOST = 0.5
"""The largest share of the frame that may be without rays."""

LONGEST, SHORTEST = 1 / 16, 1e-6
"""Steps along a way, as a share of it."""


class Undone(NamedTuple):
    """Over which part of the frame a distortion can be undone; all arrays are by place, border and inside.

    `pixels` (n, 2): the places. `share` (n,): how much of the way from the principal point to each can be undone, 1 for
    all of it. `ideal` (n, 2): where that ends, normalised. `found` (n,): Newton's method comes there.
    """

    pixels: Float[np.ndarray, "n 2"]
    share: Float[np.ndarray, " n"]
    ideal: Float[np.ndarray, "n 2"]
    found: Bool[np.ndarray, " n"]

    @property
    def fault(self) -> str:
        """Which pixel cannot be undone, and why; empty where all can."""
        if (self.share == 1).all() and self.found.all():
            return ""
        worst = int(self.share.argmin() if (self.share < 1).any() else self.found.argmin())
        why = "two directions share it" if self.share[worst] < 1 else "Newton's method does not come there"
        u, v = self.pixels[worst]
        return f"pixel ({u:.1f}, {v:.1f}): {why}"


def undone(K: Any, dist: Sequence[float], image_size: tuple[int, int]) -> Undone:
    """Where the distortion `dist` (any prefix of k1, k2, p1, p2, k3) can be undone in a frame of (width, height)."""
    numbers = (*map(float, dist), *(0.0,) * (5 - len(dist)))
    (fx, _, cx), (_, fy, cy), _ = np.asarray(K, float).tolist()
    return _undone(fx, fy, cx, cy, numbers, tuple(image_size))


def check_lens(camera: Camera) -> None:
    """Raise InputError, a pixel named, unless the camera's distortion can be undone over most of the frame."""
    lost = without_ray(camera)
    if lost is not None and lost.mean() > MOST:
        fault = undone(camera.K, camera.dist, camera.image_size).fault
        found = f"{list(camera.dist)}, which cannot at {fault}, nor over {100 * lost.mean():.0f} % of it"
        raise InputError("camera.dist", "a distortion that can be undone over most of the image", found)


class Folds(UserWarning):
    """A lens that cannot be undone over a part of the frame, whose pixels are left black."""


def without_ray(camera: Camera) -> Bool[np.ndarray, "h w"] | None:
    """Return (H, W) bool, read-only: the pixels that no ray belongs to; None if every pixel has a ray."""
    if not any(camera.dist) or not undone(camera.K, camera.dist, camera.image_size).fault:
        return None
    lost = _without_ray(camera.fx, camera.fy, camera.cx, camera.cy, camera.coefficients, camera.image_size)
    return lost if lost.any() else None


def has_no_ray(camera: Camera, u: Any, v: Any) -> Bool[np.ndarray, "..."]:
    """Return which places (u, v) lie in a pixel that no ray belongs to, or beyond the frame next to one."""
    u, v = np.broadcast_arrays(u, v)
    if (lost := without_ray(camera)) is None:
        return np.zeros(u.shape, bool)
    column, row = (np.clip(np.rint(a).astype(int), 0, n - 1) for a, n in ((u, camera.width), (v, camera.height)))
    return np.asarray(lost[row, column])


@lru_cache(maxsize=8)
def _without_ray(
    fx: float, fy: float, cx: float, cy: float, dist: tuple[float, ...], image_size: tuple[int, int]
) -> Bool[np.ndarray, "h w"]:
    us, vs = (np.linspace(-0.5, side - 0.5, CELLS + 1) for side in image_size)
    xd, yd = (a.ravel() for a in np.meshgrid((us - cx) / fx, (vs - cy) / fy))
    bad = ~_comes_back(xd, yd, dist)[0].reshape(CELLS + 1, CELLS + 1)
    bad = bad[:-1, :-1] | bad[:-1, 1:] | bad[1:, :-1] | bad[1:, 1:]
    column, row = (CELLS * (2 * np.arange(side) + 1) // (2 * side) for side in image_size)
    lost: np.ndarray = bad[row[:, None], column]
    lost.flags.writeable = False
    if lost.sum() > 0 and lost.mean() <= MOST:
        text = f"no ray belongs to {lost.sum()} of {lost.size} pixels ({100 * lost.mean():.2g} %): left black"
        warnings.warn(f"camera.dist: {list(dist)} cannot be undone there, and {text}", Folds, stacklevel=2)
    return lost


def _comes_back(
    xd: Places, yd: Places, dist: tuple[float, ...]
) -> tuple[Bool[np.ndarray, " n"], Places, Places, Places, Bool[np.ndarray, " n"]]:
    """Whether the way to each (xd, yd) (n,) can be gone and Newton's method comes to its end; and `Undone`'s fields."""
    share, x, y = follow(xd, yd, dist) if any(dist) else (np.ones(len(xd)), xd, yd)
    ended = newton(xd, yd, dist)
    found = np.hypot(ended[0] - x, ended[1] - y) <= 1e-9 * (1 + np.hypot(x, y))
    return (share == 1) & found, share, x, y, found


@lru_cache(maxsize=64)
def _undone(fx: float, fy: float, cx: float, cy: float, dist: tuple[float, ...], image_size: tuple[int, int]) -> Undone:
    us, vs = (np.linspace(-0.5, side - 0.5, SIDE) for side in image_size)
    u, v = (a.ravel() for a in np.meshgrid(us[::2], vs[::2]))
    sides = (us, vs[0] + 0 * us), (us, vs[-1] + 0 * us), (us[0] + 0 * vs, vs), (us[-1] + 0 * vs, vs)
    u, v = (np.concatenate(a) for a in zip(*sides, (u, v), strict=True))
    xd, yd = (u - cx) / fx, (v - cy) / fy
    _, share, x, y, found = _comes_back(xd, yd, dist)
    return Undone(np.stack([u, v], axis=1), share, np.stack([x, y], axis=1), found)


def distort(x: Any, y: Any, dist: Sequence[Any]) -> tuple[Any, Any]:
    """(x', y') of the ideal (x, y); `dist`: k1, k2, p1, p2, k3."""
    k1, k2, p1, p2, k3 = dist
    rr = x * x + y * y
    g = 1 + rr * (k1 + rr * (k2 + rr * k3))
    return x * g + 2 * p1 * x * y + p2 * (rr + 2 * x * x), y * g + p1 * (rr + 2 * y * y) + 2 * p2 * x * y


def jacobian(x: Any, y: Any, dist: Sequence[Any]) -> tuple[Any, Any, Any]:
    """∂x'/∂x, ∂x'/∂y = ∂y'/∂x, ∂y'/∂y."""
    k1, k2, p1, p2, k3 = dist
    rr = x * x + y * y
    g = 1 + rr * (k1 + rr * (k2 + rr * k3))
    slope = 2 * (k1 + rr * (2 * k2 + rr * 3 * k3))  # dg = slope (x dx + y dy)
    xx, yy = g + x * x * slope + 2 * p1 * y + 6 * p2 * x, g + y * y * slope + 6 * p1 * y + 2 * p2 * x
    return xx, x * y * slope + 2 * p1 * x + 2 * p2 * y, yy


def determinant(x: Any, y: Any, dist: Sequence[float]) -> Any:
    """How much larger a small area is distorted than ideal: 0 at a fold, and 1 in the middle."""
    xx, xy, yy = jacobian(x, y, dist)
    return xx * yy - xy * xy


def newton(
    xd: Float[np.ndarray, "*n"], yd: Float[np.ndarray, "*n"], dist: Sequence[float]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """The (x, y) with distort(x, y) = (xd, yd), by Newton's method from (xd, yd); right where `undone` says so."""
    x, y = xd, yd
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            dx, dy = newton_step(x, y, xd, yd, dist)
            x, y = x + dx, y + dy
            if not (np.abs(dx) + np.abs(dy) > SETTLED).any():
                break
    return x, y


def follow(xd: Places, yd: Places, dist: Sequence[float]) -> tuple[Places, Places, Places]:
    """Follow the way to each (xd, yd) (n,) by short steps: the share of it that can be gone, and the (x, y) there.

    A step goes along the tangent, then by Newton's method. If Newton's method bends it by more than a quarter, does
    not converge or crosses a fold, the step is halved, so that none jumps to a solution beyond a fold.
    """
    x, y, s = np.zeros((3, len(xd)))
    step = np.full(len(xd), LONGEST)
    with np.errstate(all="ignore"):
        while (going := np.flatnonzero((s < 1) & (step > SHORTEST))).size:
            x0, y0, qx, qy, to = x[going], y[going], xd[going], yd[going], np.minimum(s + step, 1.0)[going]
            ahead = to - s[going]
            tx, ty = _solve(x0, y0, ahead * qx, ahead * qy, dist)
            x1, y1 = x0 + tx, y0 + ty
            for _ in range(4):
                dx, dy = newton_step(x1, y1, to * qx, to * qy, dist)
                x1, y1 = x1 + dx, y1 + dy
            rests = np.hypot(dx, dy) <= 1e-12 * (1 + np.hypot(x1, y1))
            bent = np.hypot(x1 - x0 - tx, y1 - y0 - ty) > 0.25 * np.hypot(tx, ty) + 1e-15
            sound = np.minimum(determinant((x0 + x1) / 2, (y0 + y1) / 2, dist), determinant(x1, y1, dist)) >= LEAST
            good = rests & ~bent & sound
            here = going[good]
            x[here], y[here], s[here] = x1[good], y1[good], to[good]
            step[going] = np.minimum(step[going] * np.where(good, 2.0, 0.5), LONGEST)
    return s, x, y


def newton_step(x: Any, y: Any, xd: Any, yd: Any, dist: Sequence[Any]) -> tuple[Any, Any]:
    """How far Newton's method goes from (x, y) for distort to give (xd, yd)."""
    fx, fy = distort(x, y, dist)
    return _solve(x, y, xd - fx, yd - fy, dist)


def _solve(x: Any, y: Any, ex: Any, ey: Any, dist: Sequence[Any]) -> tuple[Any, Any]:
    """J⁻¹ e, J at (x, y)."""
    a, b, c = jacobian(x, y, dist)
    scale = 1 / (a * c - b * b)
    return (c * ex - b * ey) * scale, (a * ey - b * ex) * scale
