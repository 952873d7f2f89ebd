"""How far rounding may put a highlight off: the sharper Phong's lobe, the more it makes of a normal's last digits."""

import numpy as np

from raytwin.array_types import Float32
from raytwin.image import Surface
from raytwin.scene import Scene, Sphere
from raytwin.twin.outlines import rays
from raytwin.twin.phong import highlights


def highlight_rounding(scene: Scene, surface: Surface) -> Float32[np.ndarray, "h w 3"]:
    """By how much float32 may put the sun's highlight off at each pixel: |∂L/∂(r·v)| times the error of r·v.

    A normal n = (p - c) / radius errs by about an ulp of p, |δn| = 2^-23 (1 + depth / radius), and r·v by 4 |δn| at
    most. A sharp lobe makes n / (r·v) times as much of it, where Lambert's law makes 1.
    """
    out = np.zeros((*surface.ids.shape, 3), np.float32)
    seen = np.flatnonzero(highlights(scene)[surface.ids.ravel(), :3].any(axis=1)) if scene.glossy else np.empty(0, int)
    if not seen.size:
        return out
    ids, normal = surface.ids.ravel()[seen], surface.normal.reshape(-1, 3)[seen]
    to, d = np.asarray(scene.sun.to_light), rays(scene, seen) @ np.asarray(scene.camera.R_cam_board)
    radius = np.array([thing.radius if isinstance(thing, Sphere) else np.inf for thing in scene.objects])[ids]
    error = 4 * 2.0**-23 * (1 + surface.depth.ravel()[seen] / radius)
    facing = np.maximum(normal @ to, 0)
    along = np.clip(2 * (normal @ to) * -(normal * d).sum(axis=1) + d @ to, 1e-3, 1)
    rows = highlights(scene)[ids]
    steep = (rows[:, 3] + 2) / (2 * np.pi) * rows[:, 3] * along ** (rows[:, 3] - 1) * facing * error
    out.reshape(-1, 3)[seen] = steep[:, None] * rows[:, :3] * np.asarray(scene.sun.irradiance)
    return out
