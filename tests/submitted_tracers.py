"""A student's tracer, right in every stage, in plain NumPy; mistakes in it, as replacements of its text; and functions
that other processes call: they import nothing of raytwin."""

import os
from pathlib import Path

RIGHT = """
import numpy as np

def back_project(K, dist, width, height):
    u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    xd, yd = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    k1, k2, p1, p2, k3 = dist
    x, y = xd.copy(), yd.copy()
    for _ in range(60):
        rr = x * x + y * y
        radial = 1 + rr * (k1 + rr * (k2 + rr * k3))
        dx, dy = 2 * p1 * x * y + p2 * (rr + 2 * x * x), p1 * (rr + 2 * y * y) + 2 * p2 * x * y
        x, y = (xd - dx) / radial, (yd - dy) / radial
    d = np.stack([x, y, np.ones_like(x)], -1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)

def intersect_sphere(origins, directions, center, radius):
    f = origins - center
    a, b, c = (directions**2).sum(-1), (f * directions).sum(-1), (f * f).sum(-1) - radius**2
    disc = b * b - a * c
    with np.errstate(all="ignore"):
        s = np.sqrt(disc)
        near, far = (-b - s) / a, (-b + s) / a
        return np.where(disc < 0, np.inf, np.where(near > 0, near, np.where(far > 0, far, np.inf)))

def intersect_plane(o, d, plane):
    n = np.cross(plane["half_u"], plane["half_v"])
    with np.errstate(all="ignore"):
        t = ((plane["center"] - o) @ n) / (d @ n)
        q = o + t[:, None] * d - plane["center"]
        u, v = plane["half_u"], plane["half_v"]
        inside = (np.abs(q @ u) <= u @ u) & (np.abs(q @ v) <= v @ v) & (t > 0)
    return np.where(inside, t, np.inf)

def shade(points, normals, albedo, to_light, irradiance, sky):
    cosine = np.maximum(0, (normals * to_light).sum(-1))[:, None]
    return albedo / np.pi * irradiance * cosine + albedo * sky

def distances(scene, o, d):
    ts = [intersect_sphere(o, d, s["center"], s["radius"]) for s in scene["spheres"]]
    return np.array(ts + [intersect_plane(o, d, p) for p in scene["planes"]])

def render(scene):
    R, t = scene["R_cam_board"], scene["t_cam_board"]
    d = back_project(scene["K"], scene["dist"], scene["width"], scene["height"]).reshape(-1, 3) @ R
    o = np.broadcast_to(-R.T @ t, d.shape)
    ts = distances(scene, o, d)
    which, t = ts.argmin(0), ts.min(0)
    out = np.tile(scene["sky"]["radiance"], (len(d), 1))
    light = scene["sun"]["to_light"]
    for i, thing in enumerate(scene["spheres"] + scene["planes"]):
        m = (which == i) & np.isfinite(t)
        p = o[m] + t[m][:, None] * d[m]
        if "radius" in thing:
            n = (p - thing["center"]) / thing["radius"]
        else:
            n = np.cross(thing["half_u"], thing["half_v"])
            n = np.broadcast_to(n / np.linalg.norm(n), p.shape)
        n = np.where(((n * d[m]).sum(-1) > 0)[:, None], -n, n)
        irradiance = np.tile(scene["sun"]["irradiance"], (len(p), 1))
        if scene["rung"] == "shadow":
            blocked = distances(scene, p, np.broadcast_to(light, p.shape))
            blocked[i] = np.inf
            irradiance[np.isfinite(blocked).any(0)] = 0
        out[m] = shade(p, n, thing["albedo"], light, irradiance, scene["sky"]["radiance"])
    return out.reshape(scene["height"], scene["width"], 3)
"""

WRONG = {
    "no shadows": ('if scene["rung"] == "shadow"', "if False"),
    "pi": ("albedo / np.pi *", "albedo *"),
    "gamma": ("return out.reshape", "out = np.clip(out, 0, 1) ** (1 / 2.2); return out.reshape"),
    "nan": ("return out.reshape", "out[0] = np.nan; return out.reshape"),
    "shape": ('return out.reshape(scene["height"], scene["width"], 3)', "return out"),
    "raises": ("return out.reshape", "raise ValueError('<b>no</b>'); return out.reshape"),
    "hangs": ("return out.reshape", "import time\n    while True: time.sleep(1)\n    return out.reshape"),
    "exits": ("return out.reshape", "import os; os._exit(3)\n    return out.reshape"),
    "cached": (
        "def render(scene):",
        "CACHE = {}\ndef render(scene):\n    return CACHE.setdefault(len(scene), paint(scene))\ndef paint(scene):",
    ),
}  # fmt: skip
"""Name -> (old, new)."""


def tracer(mistake: str = "") -> str:
    if not mistake:
        return RIGHT
    old, new = WRONG[mistake]
    assert old in RIGHT
    return RIGHT.replace(old, new)


def square(x: int) -> int:
    if x < 0:
        raise ValueError(x)
    return x * x


def die_once(flag: str) -> str:
    """Ends its process, but the first time only."""
    path = Path(flag)
    if path.exists():
        return "alive"
    path.touch()
    os._exit(9)
