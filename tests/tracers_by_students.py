"""Tracers as students write them, and mistakes put into their text: they share no code with the catalogue."""

# ruff: noqa: E501 (a mistake a line)

from typing import Any

import numpy as np

CAMERA_FRAME = """
import numpy as np

EPS = 1e-4


def undistort(xd, yd, dist):
    k1, k2, p1, p2, k3 = dist
    x, y = xd.copy(), yd.copy()
    for _ in range(100):
        r2 = x ** 2 + y ** 2
        radial = 1 + k1 * r2 + k2 * r2 ** 2 + k3 * r2 ** 3
        dx = 2 * p1 * x * y + p2 * (r2 + 2 * x ** 2)
        dy = p1 * (r2 + 2 * y ** 2) + 2 * p2 * x * y
        x = (xd - dx) / radial
        y = (yd - dy) / radial
    return x, y


def make_rays(scene):
    W, H = scene["width"], scene["height"]
    K = scene["K"]
    u, v = np.meshgrid(np.arange(W), np.arange(H))
    xd = (u - K[0, 2]) / K[0, 0]
    yd = (v - K[1, 2]) / K[1, 1]
    x, y = undistort(xd, yd, scene["dist"])
    d = np.stack([x, y, np.ones_like(x)], axis=-1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def hit_sphere(o, d, c, r):
    oc = o - c
    a = np.sum(d * d, axis=-1)
    b = 2 * np.sum(oc * d, axis=-1)
    cc = np.sum(oc * oc, axis=-1) - r ** 2
    disc = b * b - 4 * a * cc
    s = np.sqrt(np.maximum(disc, 0))
    t0 = (-b - s) / (2 * a)
    t1 = (-b + s) / (2 * a)
    t = np.where(t0 > 1e-9, t0, t1)
    return np.where((disc >= 0) & (t > 1e-9), t, np.inf)


def hit_plane(o, d, c, hu, hv):
    n = np.cross(hu, hv)
    denom = d @ n
    denom = np.where(np.abs(denom) < 1e-12, 1e-12, denom)
    t = ((c - o) @ n) / denom
    q = o + t[..., None] * d - c
    inside = (np.abs(q @ hu) <= hu @ hu) & (np.abs(q @ hv) <= hv @ hv)
    return np.where(inside & (t > 1e-9), t, np.inf)


def render(scene):
    R, t_vec = scene["R_cam_board"], scene["t_cam_board"]
    spheres = [(R @ s["center"] + t_vec, s["radius"], s["albedo"]) for s in scene["spheres"]]
    planes = [(R @ p["center"] + t_vec, R @ p["half_u"], R @ p["half_v"], p["albedo"]) for p in scene["planes"]]
    L = R @ scene["sun"]["to_light"]
    E, sky = scene["sun"]["irradiance"], scene["sky"]["radiance"]
    d = make_rays(scene)
    o = np.zeros(3)
    best = np.full(d.shape[:2], np.inf)
    normal = np.zeros(d.shape)
    albedo = np.zeros(d.shape)
    for c, r, a in spheres:
        t = hit_sphere(o, d, c, r)
        closer = t < best
        best = np.where(closer, t, best)
        p = t[..., None] * d
        normal[closer] = ((p - c) / r)[closer]
        albedo[closer] = a
    for c, hu, hv, a in planes:
        t = hit_plane(o, d, c, hu, hv)
        closer = t < best
        best = np.where(closer, t, best)
        n = np.cross(hu, hv)
        n = n / np.linalg.norm(n)
        n = np.where((d @ n)[..., None] > 0, -n, n)
        normal[closer] = n[closer]
        albedo[closer] = a
    hit = np.isfinite(best)
    point = np.where(hit, best, 0)[..., None] * d
    visible = np.ones(hit.shape)
    if scene["rung"] == "shadow":
        start = point + EPS * normal
        ld = np.broadcast_to(L, start.shape)
        for c, r, a in spheres:
            visible[np.isfinite(hit_sphere(start, ld, c, r))] = 0
        for c, hu, hv, a in planes:
            visible[np.isfinite(_any(start, L, c, hu, hv))] = 0
    cos = np.maximum(normal @ L, 0)
    sun = albedo / np.pi * E * (cos * visible)[..., None]
    img = sun + albedo * sky
    img[~hit] = sky
    return img


def _any(start, L, c, hu, hv):
    n = np.cross(hu, hv)
    denom = L @ n
    if abs(denom) < 1e-12:
        return np.full(start.shape[:2], np.inf)
    t = ((c - start) @ n) / denom
    q = start + t[..., None] * L - c
    inside = (np.abs(q @ hu) <= hu @ hu) & (np.abs(q @ hv) <= hv @ hv)
    return np.where(inside & (t > 1e-9), t, np.inf)
"""

BOARD_FRAME = """
import numpy as np
from dataclasses import dataclass


def normalize(v):
    return v / np.sqrt((v * v).sum(-1, keepdims=True))


@dataclass
class Ball:
    c: np.ndarray
    r: float
    rho: np.ndarray

    def hit(self, org, dirs):
        oc = self.c - org
        tca = (oc * dirs).sum(-1)
        d2 = (oc * oc).sum(-1) - tca ** 2
        thc = np.sqrt(np.clip(self.r ** 2 - d2, 0, None))
        t = np.where(tca - thc > 1e-7, tca - thc, tca + thc)
        return np.where((d2 <= self.r ** 2) & (t > 1e-7), t, np.inf)

    def normal(self, p, dirs):
        return normalize(p - self.c)


@dataclass
class Sheet:
    c: np.ndarray
    u: np.ndarray
    v: np.ndarray
    rho: np.ndarray

    def hit(self, org, dirs):
        n = normalize(np.cross(self.u, self.v))
        with np.errstate(all="ignore"):
            t = ((self.c - org) * n).sum(-1) / (dirs * n).sum(-1)
            rel = org + t[:, None] * dirs - self.c
        a = (rel * self.u).sum(-1) / (self.u ** 2).sum()
        b = (rel * self.v).sum(-1) / (self.v ** 2).sum()
        ok = (np.abs(a) <= 1) & (np.abs(b) <= 1) & (t > 1e-7)
        return np.where(ok, t, np.inf)

    def normal(self, p, dirs):
        n = normalize(np.cross(self.u, self.v))
        return np.where(((dirs * n).sum(-1) < 0)[:, None], n, -n)


def directions(scene):
    K, (k1, k2, p1, p2, k3) = scene["K"], scene["dist"]
    v, u = np.divmod(np.arange(scene["width"] * scene["height"]), scene["width"])
    u, v = u.astype(float), v.astype(float)
    xd, yd = (u - K[0][2]) / K[0][0], (v - K[1][2]) / K[1][1]
    x, y = xd, yd
    for _ in range(200):
        r2 = x * x + y * y
        g = 1 + k1 * r2 + k2 * r2 * r2 + k3 * r2 ** 3
        fx = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        fy = y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        x, y = x - (fx - xd), y - (fy - yd)
    return normalize(np.stack([x, y, np.ones_like(x)], 1))


def render(scene):
    R, T = scene["R_cam_board"], scene["t_cam_board"]
    eye = -R.T @ T
    dirs = directions(scene) @ R
    world = [Ball(s["center"], s["radius"], s["albedo"]) for s in scene["spheres"]]
    world += [Sheet(p["center"], p["half_u"], p["half_v"], p["albedo"]) for p in scene["planes"]]
    t = np.array([thing.hit(eye, dirs) for thing in world])
    which = t.argmin(0)
    sky, sun = scene["sky"]["radiance"], scene["sun"]
    out = np.tile(sky, (len(dirs), 1)).astype(float)
    for i, thing in enumerate(world):
        m = (which == i) & np.isfinite(t[i])
        if not m.any():
            continue
        p = eye + t[i][m][:, None] * dirs[m]
        n = thing.normal(p, dirs[m])
        cos = np.clip((n * sun["to_light"]).sum(-1), 0, None)
        free = np.ones(len(p), bool)
        if scene["rung"] == "shadow":
            for j, other in enumerate(world):
                if j != i:
                    free &= ~np.isfinite(other.hit(p, np.tile(sun["to_light"], (len(p), 1))))
        out[m] = thing.rho * (sun["irradiance"] / np.pi * (cos * free)[:, None] + sky)
    return out.reshape(scene["height"], scene["width"], 3)
"""


# name of the fault -> which text, what stands there, what the student wrote. A list: any of the names is correct.
A, B = CAMERA_FRAME, BOARD_FRAME
Mistake = tuple[tuple[str, ...], str, str, str]
MISTAKES: list[Mistake] = [
    (("half-pixel",), A, "(u - K[0, 2])", "(u + 0.5 - K[0, 2])|(v - K[1, 2])|(v + 0.5 - K[1, 2])"),
    (("shifted", "half-pixel"), B, "u, v = u.astype(float), v.astype(float)", "u, v = u + 0.37, v.astype(float)"),
    (("linspace",), A, "np.arange(W), np.arange(H)", "np.linspace(0, W, W), np.linspace(0, H, H)"),
    (("distortion-kept",), A, "range(100)", "range(0)"),
    (("distortion-few-steps",), A, "range(100)", "range(3)"),
    (("distortion-few-steps",), B, "range(200)", "range(2)"),
    (("distortion-sign",), A, "k1, k2, p1, p2, k3 = dist", "k1, k2, p1, p2, k3 = -dist"),
    (("distortion-forward",), B, "x, y = x - (fx - xd), y - (fy - yd)", "x, y = fx, fy; break"),
    (("k3-left-out",), B, " + k3 * r2 ** 3", ""),
    (("tangential-left-out",), A, "(xd - dx) / radial", "xd / radial|(yd - dy) / radial|yd / radial"),
    (("tangential-swapped",), B, "(k1, k2, p1, p2, k3) =", "(k1, k2, p2, p1, k3) ="),
    (("coefficients-order",), A, "k1, k2, p1, p2, k3 = dist", "k1, k2, k3, p1, p2 = dist"),
    (("swapped-axes",), A, "img[~hit] = sky", "img[~hit] = sky; img = np.ascontiguousarray(SWAP(img))"),
    (("reshaped",), A, "np.meshgrid(np.arange(W), np.arange(H))",
     "[x.reshape(H, W) for x in np.meshgrid(np.arange(W), np.arange(H), indexing='ij')]"),
    (("swapped-focal",), A, "K[0, 0]", "K[9, 9]|K[1, 1]|K[0, 0]|K[9, 9]|K[1, 1]"),
    (("one-focal",), B, "K[1][1]", "K[0][0]"),
    (("centre-of-image",), B, "(u - K[0][2])", "(u - scene['width'] / 2)|(v - K[1][2])|(v - scene['height'] / 2)"),
    (("y-up",), B, "np.stack([x, y, np.ones_like(x)], 1)", "np.stack([x, -y, np.ones_like(x)], 1)"),
    (("z-backwards",), A, "np.stack([x, y, np.ones_like(x)]", "np.stack([x, -y, -np.ones_like(x)]"),
    (("transposed-R",), A, 'R, t_vec = scene["R_cam_board"], ', 'R, t_vec = scene["R_cam_board"].T, '),
    (("inverse-pose",), B, "eye = -R.T @ T", "eye = T|directions(scene) @ R|directions(scene) @ R.T"),
    (("wrong-eye",), B, "eye = -R.T @ T", "eye = -T"),
    (("eye-at-origin",), B, "eye = -R.T @ T", "eye = np.zeros(3)"),
    (("light-in-camera-frame",), A, 'L = R @ scene', 'L = scene'),
    (("light-turned-needlessly",), B, '(n * sun["to_light"])', '(n * (R @ sun["to_light"]))'),
    (("far-root",), A, "t = np.where(t0 > 1e-9, t0, t1)", "t = t1"),
    (("behind-the-eye",), A, "t = np.where(t0 > 1e-9, t0, t1)", "t = np.where(abs(t0) < abs(t1), t0, t1)|(disc >= 0) & (t > 1e-9)|(disc >= 0)"),
    (("t-along-z",), A, "    point = np.where", "    d = d / d[..., 2:]; point = np.where|p = t[..., None] * d|p = t[..., None] * d / d[..., 2:]"),
    (("rays-not-unit",), B, "return normalize(np.stack([x, y, np.ones_like(x)], 1))", "return np.stack([x, y, np.ones_like(x)], 1)"),
    (("radius-not-squared",), A, "- r ** 2", "- r"),
    (("diameter",), B, 'Ball(s["center"], s["radius"]', 'Ball(s["center"], 2 * s["radius"]'),
    (("radius-scaled",), B, 'Ball(s["center"], s["radius"]', 'Ball(s["center"], 1.1 * s["radius"]'),
    (("factor-in-quadratic",), A, "b = 2 * np.sum", "b = np.sum"),
    (("endless-planes",), A, "np.where(inside & (t > 1e-9), t, np.inf)", "np.where(t > 1e-9, t, np.inf)"),
    (("half-edges",), B, "(np.abs(a) <= 1) & (np.abs(b) <= 1)", "(np.abs(a) <= 0.5) & (np.abs(b) <= 0.5)"),
    (("last-wins", "planes-on-top"), A, "closer = t < best", "closer = np.isfinite(t)"),
    (("first-wins",), B, "which = t.argmin(0)", "which = np.isfinite(t).argmax(0)"),
    (("farthest-wins",), B, "which = t.argmin(0)", "which = np.where(np.isfinite(t), t, -1).argmax(0)"),
    (("painter",), B, "t = np.array([", "world.sort(key=lambda o: -np.linalg.norm(o.c - eye)); t = np.array([|which = t.argmin(0)|which = len(t) - 1 - np.isfinite(t)[::-1].argmax(0)"),
    (("spheres-on-top",), B, "which = t.argmin(0)", "which = (t + 1e3 * np.array([isinstance(w, Sheet) for w in world])[:, None]).argmin(0)"),
    (("t-of-other-rays",), A, "        t = hit_plane(o, d, c, hu, hv)\n        closer = t < best", "        t = hit_plane(o, d, c, hu, hv)\n        closer = t * d[..., 2] < best"),
    (("normal-inward",), A, "((p - c) / r)", "((c - p) / r)"),
    (("normal-not-unit",), A, "((p - c) / r)", "(p - c)"),
    (("normal-from-origin",), B, "return normalize(p - self.c)", "return normalize(p)"),
    (("plane-normal-not-unit",), A, "n = n / np.linalg.norm(n)", "n = n * 1.0"),
    (("light-reversed",), A, "L = R @ scene", "L = -R @ scene"),
    (("no-clamp",), A, "cos = np.maximum(normal @ L, 0)", "cos = normal @ L"),
    (("no-clamp",), B, "np.clip((n * sun[\"to_light\"]).sum(-1), 0, None)", "(n * sun[\"to_light\"]).sum(-1)"),
    (("abs-cosine",), B, "np.clip((n * sun[\"to_light\"]).sum(-1), 0, None)", "abs((n * sun[\"to_light\"]).sum(-1))"),
    (("squared-cosine",), A, "np.maximum(normal @ L, 0)", "np.maximum(normal @ L, 0) ** 2"),
    (("no-cosine",), A, "(cos * visible)", "((cos > 0) * visible)"),
    (("half-lambert",), B, "np.clip((n * sun[\"to_light\"]).sum(-1), 0, None)", "(0.5 + 0.5 * (n * sun[\"to_light\"]).sum(-1))"),
    (("albedo-missing-sun",), A, "sun = albedo / np.pi", "sun = 1 / np.pi"),
    (("albedo-missing",), B, "thing.rho * (sun", "1 * (sun"),
    (("albedo-squared",), B, "thing.rho * (sun", "thing.rho ** 2 * (sun"),
    (("pi-missing",), A, "albedo / np.pi * E", "albedo * E"),
    (("pi-twice",), A, "albedo / np.pi * E", "albedo / np.pi ** 2 * E"),
    (("sun-twice",), B, "sun[\"irradiance\"] / np.pi", "2 * sun[\"irradiance\"] / np.pi"),
    (("sun-scaled",), B, "sun[\"irradiance\"] / np.pi", "1.3 * sun[\"irradiance\"] / np.pi"),
    (("irradiance-missing",), A, "np.pi * E *", "np.pi *"),
    (("sky-twice",), A, "img = sun + albedo * sky", "img = sun + 2 * albedo * sky"),
    (("sky-missing",), A, "img = sun + albedo * sky", "img = sun"),
    (("sky-without-albedo",), A, "img = sun + albedo * sky", "img = sun + sky"),
    (("sky-by-pi",), B, "+ sky)", "+ sky / np.pi)"),
    (("sky-before-clamp",), A, "cos = np.maximum(normal @ L, 0)", "cos = normal @ L|img = sun + albedo * sky|img = np.maximum(sun + albedo * sky, 0)"),
    (("shadow-black",), A, "img = sun + albedo * sky", "img = (sun + albedo * sky) * visible[..., None]"),
    (("sky-only-in-shadow",), B, "+ sky)", "+ sky * (cos * free <= 0)[:, None])"),
    (("light-as-place",), B, "(n * sun[\"to_light\"])", "(n * normalize(sun[\"to_light\"] - p))"),
    (("acne",), A, "EPS * normal", "0 * normal|> 1e-9|> 0"),
    (("no-shadow",), A, 'scene["rung"] == "shadow"', "False"),
    (("all-in-shadow", "sun-missing"), B, "if j != i:", "if True:|(t > 1e-7), t|(t > -1e-7), t|tca - thc > 1e-7, tca - thc|tca - thc > -1e-7, tca - thc"),
    (("shadow-offset", "shadow-start"), A, "start = point + EPS * normal", "start = point + 0.03 * normal"),
    (("shadow-reversed",), B, "np.tile(sun[\"to_light\"]", "np.tile(-sun[\"to_light\"]"),
    (("shadow-bounded", "shadow-reach"), B, "~np.isfinite(other.hit(p, np.tile(sun[\"to_light\"], (len(p), 1))))", "~(other.hit(p, np.tile(sun[\"to_light\"], (len(p), 1))) < 0.08)"),
    (("spheres-receive-none",), B, "if j != i:", "if j != i and isinstance(thing, Sheet):"),
    (("planes-receive-none",), B, "if j != i:", "if j != i and isinstance(thing, Ball):"),
    (("one-casts",), B, "free &= ~np", "free = ~np"),
    (("shadow-dims-all",), A, "img = sun + albedo * sky", "img = (albedo / np.pi * E * cos[..., None] + albedo * sky) * np.where(visible > 0, 1, 0.5)[..., None]"),
    (("shadow-strength",), A, "visible = np.ones(hit.shape)", "visible = np.ones(hit.shape)|(cos * visible)|(cos * np.maximum(visible, 0.3))"),
    (("gamma-once",), B, "return out.reshape", "out = np.clip(out, 0, None) ** (1 / 2.2); return out.reshape"),
    (("gamma-twice",), B, "return out.reshape", "out = np.clip(out, 0, None) ** (1 / 2.2) ** 2; return out.reshape"),
    (("bgr",), A, "img[~hit] = sky", "img[~hit] = sky; img = img[..., ::-1]"),
    (("clamped",), B, "return out.reshape", "out = np.clip(out, 0, 1); return out.reshape"),
    (("overflow",), B, "return out.reshape", "out = (out * 255).astype(int).astype(np.uint8) / 255; return out.reshape"),
    (("half-float",), A, "img[~hit] = sky", "img[~hit] = sky; img = img.astype(np.float16).astype(float)"),
    (("upside-down",), A, "img[~hit] = sky", "img[~hit] = sky; img = img[::-1]"),
    (("mirrored",), A, "img[~hit] = sky", "img[~hit] = sky; img = img[:, ::-1]"),
    (("background-black",), A, "img[~hit] = sky", "img[~hit] = 0"),
    (("background-constant",), A, "img[~hit] = sky", "img[~hit] = [0.5, 0.7, 1.0]"),
    (("normalised",), B, "return out.reshape", "out = out / out.max(); return out.reshape"),
    (("tone-mapped",), B, "return out.reshape", "out = out / (1 + out); return out.reshape"),
    (("whole-numbers",), A, 'K = scene["K"]', 'K = scene["K"].astype(int)'),
    (("length-not-squared",), A, "np.sum(oc * oc, axis=-1) - r ** 2", "np.linalg.norm(oc, axis=-1) - r ** 2"),
    (("extent-from-elsewhere",), A, "t[..., None] * d - c", "t[..., None] * d"),
    (("disc-for-rectangle",), B, "(np.abs(a) <= 1) & (np.abs(b) <= 1)", "(a * a + b * b <= 1)"),
    (("plane-t",), A, "((c - o) @ n) / denom", "((o - c) @ n) / denom"),
    (("hidden-one-written",), A, "albedo[closer] = a", "albedo[np.isfinite(t)] = a"),
    (("one-array",), A, "albedo = np.zeros(d.shape)", "albedo = normal"),
    (("normal-of-another",), B, "return normalize(p - self.c)", "return normalize(p - FIRST)|world = [Ball|global FIRST; FIRST = scene[\"spheres\"][0][\"center\"]; world = [Ball"),
    (("angle-for-cosine",), A, "(cos * visible)", "(np.arccos(np.clip(cos, 0, 1)) * visible)"),
    (("half-of-pairs",), B, "if j != i:", "if j > i:"),
    (("whole-object-in-shadow",), B, "(len(p), 1))))", "(len(p), 1)))).any()"),
    (("sky-on-all",), A, "img = sun + albedo * sky", "img = sun + albedo * sky + sky"),
    (("reshaped",), B, 'out.reshape(scene["height"], scene["width"], 3)', 'out.reshape(scene["width"], scene["height"], 3).transpose(1, 0, 2)'),
    (("rounded",), B, "return out.reshape", "out = np.round(out, 2); return out.reshape"),
    (("power",), B, "return out.reshape", "out = out ** 0.8; return out.reshape"),
]  # fmt: skip

CORRECT: list[tuple[str, str, str]] = [
    (A, "", ""),
    (B, "", ""),
    (A, "EPS = 1e-4", "EPS = 1e-6"),
    (A, "EPS = 1e-4", "EPS = 1e-5|d = make_rays(scene)|d = make_rays(scene).astype(np.float32)"),
    (A, "img[~hit] = sky", "img[~hit] = sky; img = img.astype(np.float32)"),
    (B, "1e-7", "1e-9"),
    (B, "dirs = directions(scene) @ R", "dirs = (directions(scene) @ R).astype(np.float32)"),
    (B, "np.clip((n * sun", "np.maximum(0, 1) * np.clip((n * sun"),
]


def mistaken(text: str, old: str, new: str) -> str:
    """The tracer's text with a mistake: `old` becomes `new`, which may go on with |old|new."""
    words = [old, *new.split("|")] if old else []
    for before, after in zip(words[::2], words[1::2], strict=True):
        assert before in text, before
        text = text.replace(before, after)
    return text


def run(text: str, scenes: list[dict[str, Any]]) -> list[np.ndarray]:
    """The student's pictures."""
    import sys
    import types

    module = types.ModuleType("a_student")
    sys.modules["a_student"] = module
    module.__dict__["SWAP"] = swap
    exec(compile(text, "student.py", "exec"), module.__dict__)
    with np.errstate(all="ignore"):
        return [np.asarray(module.render(scene)) for scene in scenes]


def swap(img: np.ndarray) -> np.ndarray:
    """Rows for columns, cut or filled to the same shape, as an index [u, v] gives."""
    h, w = img.shape[:2]
    v, u = np.indices((h, w))
    return img[np.minimum(u, h - 1), np.minimum(v, w - 1)]
