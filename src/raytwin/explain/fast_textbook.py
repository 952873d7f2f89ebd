"""Other forms of the textbook's functions, equal to rounding: they replace those that no slip is in."""

from typing import Any

import numpy as np

from raytwin import tracer
from raytwin.scene.lens import newton_step

Array = np.ndarray


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
    """All objects at once. A sphere's normal is turned only where the eye is inside it: most students never turn it."""
    none, table = (np.zeros(3), np.inf, np.zeros(3)), []
    for thing in things:
        if "radius" in thing:
            table.append((thing["center"], thing["radius"], np.zeros(3)))
        else:
            n = np.cross(thing["half_u"], thing["half_v"])
            table.append((np.zeros(3), np.inf, n / np.linalg.norm(n)))
    centers, radii, flats = (np.array(column)[which] for column in zip(*table, none, strict=True))
    f = points - centers
    n = np.where(np.isfinite(radii)[:, None], f / radii[:, None], flats)
    turns = np.isinf(radii) | (np.linalg.norm(eye - centers, axis=-1) <= radii)
    away = turns & ~(np.sum(n * (eye - points), axis=-1) > 0)
    return np.where(away[:, None], -n, n)
