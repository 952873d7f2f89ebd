"""Fast twins of the textbook's functions, equal to rounding: they replace those that no slip is in."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from raytwin import tracer
from raytwin.scene.lens import newton_step

Array = np.ndarray


def _sum(a: Any, axis: Any = None, keepdims: bool = False) -> Any:
    if axis == -1 and a.ndim > 1 and a.shape[-1] == 3:
        made = a[..., 0] + a[..., 1] + a[..., 2]
        return made[..., None] if keepdims else made
    return np.sum(a, axis=axis, keepdims=keepdims)


def _norm(a: Any, axis: Any = None, keepdims: bool = False) -> Any:
    if axis == -1 and np.ndim(a) > 1:
        return np.sqrt(_sum(np.square(a), -1, keepdims))
    return np.linalg.norm(a, axis=axis, keepdims=keepdims)


def _cross(a: Any, b: Any) -> Any:
    if np.shape(a) != (3,) or np.shape(b) != (3,):
        return np.cross(a, b)
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


LINALG = SimpleNamespace(**{**vars(np.linalg), "norm": _norm})
FAST = SimpleNamespace(**{**vars(np), "sum": _sum, "cross": _cross, "linalg": LINALG})
"""NumPy, quicker for vectors of three."""


def undistort(xd: Array, yd: Array, dist: Array) -> tuple[Array, Array]:
    """The tracer's own way back through the lens, ended where nothing moves any more."""
    if not np.any(dist):
        return xd, yd
    x, y = tracer.undistort(xd, yd, dist.tolist(), steps=4)
    for _ in range(12):
        dx, dy = newton_step(x, y, xd, yd, dist.tolist())
        x, y = x + dx, y + dy
        if max(np.abs(dx).max(initial=0.0), np.abs(dy).max(initial=0.0)) < 1e-8:  # the error is that, squared
            break
    return x, y


def intersect_all(space: dict[str, Any], origins: Array, directions: Array, things: Any) -> Array:
    """t (objects, N); the text works on spheres in a further axis as well, unless a slip in it does not."""
    t = np.full((max(1, len(things)), len(origins)), np.inf)
    balls = [k for k, thing in enumerate(things) if "radius" in thing]
    if balls:
        solve = space["intersect_sphere"]
        centers, radii = (np.array([things[k][name] for k in balls])[:, None] for name in ("center", "radius"))
        try:
            found = np.asarray(solve(origins, directions, centers, radii), float)
        except (ValueError, IndexError):
            found = np.empty(0)
        if found.shape != (len(balls), len(origins)):
            found = np.stack([solve(origins, directions, things[k]["center"], things[k]["radius"]) for k in balls])
        t[balls] = found
    for k, thing in enumerate(things):
        if "radius" not in thing:
            t[k] = space["intersect_plane"](origins, directions, thing["center"], thing["half_u"], thing["half_v"])
    t[np.isnan(t)] = np.inf
    return t


def normals_at(points: Array, which: Array, eye: Array, things: Any) -> Array:
    """All at once; seen from outside a sphere's normal needs no turning, and most leave it out."""
    none, table = (np.zeros(3), np.inf, np.zeros(3)), []
    for thing in things:
        if "radius" in thing:
            table.append((thing["center"], thing["radius"], np.zeros(3)))
        else:
            n = _cross(thing["half_u"], thing["half_v"])
            table.append((np.zeros(3), np.inf, n / np.linalg.norm(n)))
    centers, radii, flats = (np.array(column)[which] for column in zip(*table, none, strict=True))
    f = points - centers
    n = np.where(np.isfinite(radii)[:, None], f / radii[:, None], flats)
    turns = np.isinf(radii) | (_norm(eye - centers, -1) <= radii)
    away = turns & ~(_sum(n * (eye - points), -1) > 0)
    return np.where(away[:, None], -n, n)
