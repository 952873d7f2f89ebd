"""Starter files as students fill them in, correct ones and slips in their text, written before repairs were tried on them.

They share no code with the textbook. Of each slip: the function whose test shows it, what stands there and what the
student wrote; the line to be named is the one that the slip is on.
"""

# ruff: noqa: E501 (a slip a line)

from dataclasses import dataclass

PLAIN = """
import numpy as np


def undo_lens(xd, yd, dist):
    k1, k2, p1, p2, k3 = dist
    x = xd.copy()
    y = yd.copy()
    for i in range(50):
        r2 = x**2 + y**2
        rad = 1 + k1*r2 + k2*r2**2 + k3*r2**3
        tx = 2*p1*x*y + p2*(r2 + 2*x**2)
        ty = p1*(r2 + 2*y**2) + 2*p2*x*y
        x = (xd - tx) / rad
        y = (yd - ty) / rad
    return x, y


def back_project(K, dist, width, height):
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    xd = (u - K[0, 2]) / K[0, 0]
    yd = (v - K[1, 2]) / K[1, 1]
    x, y = undo_lens(xd, yd, dist)
    d = np.stack([x, y, np.ones_like(x)], axis=-1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def estimate_pose(K, dist, object_points, image_points):
    import cv2
    ok, rvec, tvec = cv2.solvePnP(object_points, image_points, K, dist)
    R, _ = cv2.Rodrigues(rvec)
    return R, tvec[:, 0]


def intersect_sphere(origins, directions, center, radius):
    oc = origins - center
    a = (directions * directions).sum(axis=1)
    b = 2 * (oc * directions).sum(axis=1)
    c = (oc * oc).sum(axis=1) - radius**2
    disc = b**2 - 4*a*c
    hit = disc >= 0
    root = np.sqrt(np.where(hit, disc, 0))
    t1 = (-b - root) / (2*a)
    t2 = (-b + root) / (2*a)
    t = np.where(t1 > 1e-9, t1, t2)
    t = np.where(hit & (t > 1e-9), t, np.inf)
    return t


def shade(points, normals, albedo, to_light, irradiance, sky):
    ndotl = np.maximum(normals @ to_light, 0)
    sun = albedo / np.pi * irradiance * ndotl[:, None]
    return sun + albedo * sky


def intersect_plane(origins, directions, center, half_u, half_v):
    n = np.cross(half_u, half_v)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((center - origins) @ n) / (directions @ n)
        q = origins + t[:, None] * directions - center
        inside = (np.abs(q @ half_u) <= half_u @ half_u) & (np.abs(q @ half_v) <= half_v @ half_v)
    return np.where(inside & (t > 1e-9), t, np.inf)


def camera_rays(scene):
    rays = back_project(scene["K"], scene["dist"], scene["width"], scene["height"]).reshape(-1, 3)
    R, tvec = scene["R_cam_board"], scene["t_cam_board"]
    eye = -R.T @ tvec
    d = rays @ R
    return np.broadcast_to(eye, d.shape), d


def hit_points(scene):
    o, d = camera_rays(scene)
    best = np.full(len(d), np.inf)
    for s in scene["spheres"]:
        t = intersect_sphere(o, d, s["center"], s["radius"])
        best = np.minimum(best, t)
    p = o + best[:, None] * d
    p[np.isinf(best)] = np.nan
    return p.reshape(scene["height"], scene["width"], 3)


def in_shadow(p, light, scene, skip):
    dark = np.zeros(len(p), bool)
    l = np.broadcast_to(light, p.shape)
    for k, s in enumerate(scene["spheres"]):
        dark |= np.isfinite(intersect_sphere(p, l, s["center"], s["radius"]))
    for k, q in enumerate(scene["planes"]):
        dark |= np.isfinite(intersect_plane(p, l, q["center"], q["half_u"], q["half_v"])) & (skip != k + len(scene["spheres"]))
    return dark


def render(scene):
    o, d = camera_rays(scene)
    light, E, sky = scene["sun"]["to_light"], scene["sun"]["irradiance"], scene["sky"]["radiance"]
    best = np.full(len(d), np.inf)
    which = np.full(len(d), -1)
    normal = np.zeros_like(d)
    albedo = np.zeros_like(d)
    k = 0
    for s in scene["spheres"]:
        t = intersect_sphere(o, d, s["center"], s["radius"])
        m = t < best
        best[m] = t[m]
        which[m] = k
        p = o[m] + t[m][:, None] * d[m]
        normal[m] = (p - s["center"]) / s["radius"] * np.sign(np.linalg.norm(o[m] - s["center"], axis=1) - s["radius"])[:, None]
        albedo[m] = s["albedo"]
        k += 1
    for q in scene["planes"]:
        t = intersect_plane(o, d, q["center"], q["half_u"], q["half_v"])
        m = t < best
        best[m] = t[m]
        which[m] = k
        n = np.cross(q["half_u"], q["half_v"])
        n = n / np.linalg.norm(n)
        normal[m] = np.where((d[m] @ n > 0)[:, None], -n, n)
        albedo[m] = q["albedo"]
        k += 1
    hit = which >= 0
    p = o[hit] + best[hit][:, None] * d[hit]
    out = np.tile(sky, (len(d), 1))
    out[hit] = shade(p, normal[hit], albedo[hit], light, E, sky)
    if scene["rung"] == "shadow":
        dark = in_shadow(p + 1e-6 * normal[hit], light, scene, which[hit])
        black = shade(p, normal[hit], albedo[hit], light, 0 * E, sky)
        out[hit] = np.where(dark[:, None], black, out[hit])
    return out.reshape(scene["height"], scene["width"], 3)
"""

LOOPS = """
import math

import numpy as np


def back_project(K, dist, width, height):
    rays = np.zeros((height, width, 3))
    k1, k2, p1, p2, k3 = [float(k) for k in dist]
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    for row in range(height):
        for col in range(width):
            x0 = (col - cx) / fx
            y0 = (row - cy) / fy
            x, y = x0, y0
            for step in range(40):
                r2 = x * x + y * y
                scale = 1 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2
                ex = x * scale + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - x0
                ey = y * scale + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - y0
                x -= ex
                y -= ey
            length = math.sqrt(x * x + y * y + 1)
            rays[row, col] = [x / length, y / length, 1 / length]
    return rays


def hit_one(o, d, c, r):
    f = o - c
    a = d.dot(d)
    half = f.dot(d)
    q = f.dot(f) - r * r
    disc = half * half - a * q
    if disc < 0:
        return math.inf
    s = math.sqrt(disc)
    near = (-half - s) / a
    far = (-half + s) / a
    if near > 1e-9:
        return near
    if far > 1e-9:
        return far
    return math.inf


def intersect_sphere(origins, directions, center, radius):
    result = []
    for o, d in zip(origins, directions):
        result.append(hit_one(o, d, center, radius))
    return np.array(result)


def shade(points, normals, albedo, to_light, irradiance, sky):
    colours = []
    albedo = np.broadcast_to(albedo, (len(points), 3))
    for i in range(len(points)):
        cosine = max(0.0, normals[i].dot(to_light))
        direct = albedo[i] / math.pi * irradiance * cosine
        ambient = albedo[i] * sky
        colours.append(direct + ambient)
    return np.array(colours)
"""


def _geometric() -> str:
    """PLAIN, its sphere solved by the foot of the centre, its rays not made unit."""
    start, rest = PLAIN.split("def intersect_sphere")
    _, rest = rest.split("def shade")
    start = start.replace(
        "return d / np.linalg.norm(d, axis=-1, keepdims=True)",
        "n = np.sqrt(np.einsum('ijk,ijk->ij', d, d))\n    return d / n[..., np.newaxis]",
    )
    return start + GEOMETRIC + "def shade" + rest


GEOMETRIC = """def intersect_sphere(origins, directions, center, radius):
    length = np.linalg.norm(directions, axis=1)
    unit = directions / length[:, None]
    L = center - origins
    tca = np.sum(L * unit, axis=1)
    d2 = np.sum(L * L, axis=1) - tca * tca
    r2 = radius * radius
    thc = np.sqrt(np.maximum(r2 - d2, 0))
    t0 = tca - thc
    t1 = tca + thc
    t = np.where(t0 > 0, t0, t1) / length
    t[(d2 > r2) | (t <= 0)] = np.inf
    return t


"""
FOOT = _geometric()


@dataclass(frozen=True)
class Slip:
    """`old` in `text` becomes `new`; `shows`: the first function whose test fails."""

    label: str
    shows: str
    text: str
    old: str
    new: str

    @property
    def source(self) -> str:
        assert self.text.count(self.old) == 1, (self.label, self.text.count(self.old))
        return self.text.replace(self.old, self.new)

    @property
    def line(self) -> int:
        """The first line that differs."""
        pairs = zip(self.text.split("\n"), [*self.source.split("\n"), *[""] * 9], strict=False)
        return next(k for k, (a, b) in enumerate(pairs, 1) if a != b)


SLIPS = (
    Slip("norm without axis", "back_project", PLAIN, "np.linalg.norm(d, axis=-1, keepdims=True)", "np.linalg.norm(d)"),
    Slip("return in the loop", "back_project", LOOPS, "    return rays\n", "        return rays\n"),
    Slip("sum of everything", "intersect_sphere", PLAIN, "c = (oc * oc).sum(axis=1)", "c = (oc * oc).sum()"),
    Slip("or for and", "intersect_sphere", FOOT, "(d2 > r2) | (t <= 0)", "(d2 > r2) & (t <= 0)"),
    Slip("minimum", "shade", PLAIN, "np.maximum(normals @ to_light, 0)", "np.minimum(normals @ to_light, 0)"),
    Slip("sky without albedo", "shade", FOOT, "return sun + albedo * sky", "return sun + sky"),
)  # fmt: skip

RIGHT = (
    (PLAIN, "", ""),
    (LOOPS, "", ""),
    (FOOT, "", ""),
    (PLAIN, "range(50)", "range(25)"),
    (PLAIN, "d = rays @ R", "d = (rays @ R).astype(np.float32)"),
    (PLAIN, "d = rays @ R", "d = rays @ R * np.linspace(0.5, 2, len(rays))[:, None]"),
    (PLAIN, "eye = -R.T @ tvec", "eye = -np.linalg.solve(R, tvec)"),
    (PLAIN, "np.where(t1 > 1e-9, t1, t2)", "np.where(t1 > 1e-6, t1, t2)"),
    (LOOPS, "near = (-half - s) / a", "near = q / (-half + s) if half < 0 else (-half - s) / a"),
    (FOOT, "np.sum(L * L, axis=1) - tca * tca", "np.linalg.norm(np.cross(L, unit), axis=1) ** 2"),
    (FOOT, "return sun + albedo * sky", "return albedo * (irradiance / np.pi * ndotl[:, None] + sky)"),
    (PLAIN, "best = np.minimum(best, t)", "best = np.where(t < best, t, best)"),
    (PLAIN, "return out.reshape", "return out.astype(np.float32).reshape"),
)  # fmt: skip
"""Correct ones: (text, old, new)."""
