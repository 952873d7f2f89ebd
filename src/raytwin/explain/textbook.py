"""The tracer of a textbook, as a student would write it: plain functions over N rays, float64, in the board's frame.

It has three uses. Students read it. `edits.py` changes its syntax tree as slips would. Tests compare it with the
subject, which it equals to rounding. The functions of the contract have the contract's names, and a scene is
the contract's dict. `tracer_with` replaces some of its functions by others, a student's for instance.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from types import CodeType, FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from raytwin.images.photo_files import srgb_decode, srgb_encode

Array = np.ndarray


def read_scene(scene: Any, things: Any) -> Any:
    """The scene and its objects as the tracer takes them."""
    return scene, things


def pixel(u: Any, v: Any, width: int, height: int) -> Any:
    """Where in the image the ray of column u and row v goes: (0, 0) is the centre of the top-left pixel."""
    return u, v


def undistort(xd: Any, yd: Any, dist: Any) -> Any:
    """The (x, y) that the lens takes to (xd, yd): x = (xd - tangential) / radial, repeated until nothing moves."""
    k1, k2, p1, p2, k3 = dist
    x, y = xd, yd
    for _ in range(30):
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        dx = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        dy = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        x, y = (xd - dx) / radial, (yd - dy) / radial
    return x, y


def through(K: Any, dist: Any, u: Any, v: Any) -> Any:
    """Unit rays (..., 3) in the camera's frame through the pixels (u, v)."""
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    x, y = undistort((u - cx) / fx, (v - cy) / fy, dist)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def back_project(K: Any, dist: Any, width: int, height: int) -> Any:
    """Those of all pixels, (H, W, 3)."""
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    u, v = pixel(columns, rows, width, height)
    return through(K, dist, u, v)


def to_board(rays: Any, R: Any, t: Any) -> Any:
    """The eye (3,) and directions (N, 3) in the board's frame; p_cam = R @ p_board + t."""
    eye = -R.T @ t
    directions = rays @ R
    return eye, directions


def intersect_sphere(origins: Any, directions: Any, center: Any, radius: Any) -> Any:
    """The smallest t > 0 (N,) with |o + t d - c|² = r²: a t² + b t + c = 0; infinity for a miss."""
    f = origins - center
    a = np.sum(directions * directions, axis=-1)
    b = 2 * np.sum(f * directions, axis=-1)
    c = np.sum(f * f, axis=-1) - radius**2
    disc = b * b - 4 * a * c
    near = (-b - np.sqrt(disc)) / (2 * a)
    far = (-b + np.sqrt(disc)) / (2 * a)
    t = np.where(near > 0, near, far)
    return np.where((disc >= 0) & (t > 0), t, np.inf)


def intersect_plane(origins: Any, directions: Any, center: Any, half_u: Any, half_v: Any) -> Any:
    """t > 0 (N,) where rays meet the rectangle center ± half_u ± half_v; infinity for a miss."""
    n = np.cross(half_u, half_v)
    t = ((center - origins) @ n) / (directions @ n)
    q = origins + t[:, None] * directions - center
    inside = (np.abs(q @ half_u) <= half_u @ half_u) & (np.abs(q @ half_v) <= half_v @ half_v)
    return np.where(inside & (t > 0), t, np.inf)


def intersect_all(origins: Any, directions: Any, things: Any) -> Any:
    """t (objects, N)."""
    t = np.full((max(1, len(things)), len(origins)), np.inf)
    for k, thing in enumerate(things):
        if "radius" in thing:
            t[k] = intersect_sphere(origins, directions, thing["center"], thing["radius"])
        else:
            t[k] = intersect_plane(origins, directions, thing["center"], thing["half_u"], thing["half_v"])
    return t


def nearest(t: Any) -> Any:
    """The object (N,) that each ray meets first, -1 for none."""
    which = np.argmin(t, axis=0)
    closest = t[which, np.arange(t.shape[1])]
    return np.where(np.isfinite(closest), which, -1)


def normals_at(points: Any, which: Any, eye: Any, things: Any) -> Any:
    """Unit normals (N, 3), on the side of the eye."""
    normals = np.zeros(points.shape)
    for k, thing in enumerate(things):
        if "radius" in thing:
            n = (points - thing["center"]) / thing["radius"]
        else:
            n = np.cross(thing["half_u"], thing["half_v"])
            n = np.tile(n / np.linalg.norm(n), (len(points), 1))
        towards = np.sum(n * (eye - points), axis=-1, keepdims=True) > 0
        n = np.where(towards, n, -n)
        normals[which == k] = n[which == k]
    return normals


def sun_visible(points: Any, normals: Any, which: Any, to_light: Any, eye: Any, things: Any) -> Any:
    """(N,) bool: no other object lies on the way to the sun, nor the own sphere around the eye."""
    t = intersect_all(points, np.tile(to_light, (len(points), 1)), things)
    visible = np.ones(len(points), bool)
    for k, thing in enumerate(things):
        own = which == k
        if "radius" in thing:
            own = own & (np.linalg.norm(eye - thing["center"]) > thing["radius"])
        visible = visible & (own | ~np.isfinite(t[k]))
    return visible


def shade(points: Any, normals: Any, albedo: Any, to_light: Any, irradiance: Any, sky: Any) -> Any:
    """Lambert's law under sun and sky, (N, 3)."""
    cosine = np.maximum(0, np.sum(normals * to_light, axis=-1, keepdims=True))
    return albedo / np.pi * irradiance * cosine + albedo * sky


def met(rays: Any, scene: Any, things: Any) -> Any:
    """The eye, the object (N,) that each of the camera's rays (N, 3) meets, and where (N, 3), not finite for none."""
    eye, directions = to_board(rays, scene["R_cam_board"], scene["t_cam_board"])
    origins = np.tile(eye, (len(directions), 1))
    every_t = intersect_all(origins, directions, things)
    which = nearest(every_t)
    t = every_t[which, np.arange(len(which))]
    return eye, which, origins + t[:, None] * directions


def radiance(scene: Any, things: Any, eye: Any, which: Any, points: Any) -> Any:
    """Radiance (N, 3): the points under sun and sky, and the sky where a ray meets nothing."""
    sun, sky = scene["sun"], scene["sky"]["radiance"]
    picture = np.tile(sky, (len(points), 1))
    hit = which >= 0
    if not hit.any():
        return picture
    points, which = points[hit], which[hit]
    normals = normals_at(points, which, eye, things)
    albedo = np.array([thing["albedo"] for thing in things]).reshape(-1, 3)[which]
    to_light, irradiance = sun["to_light"], sun["irradiance"]
    lit = shade(points, normals, albedo, to_light, irradiance, sky)
    dark = shade(points, normals, albedo, to_light, 0 * irradiance, sky)
    visible = np.ones(len(points), bool)
    if scene["rung"] == "shadow":
        visible = sun_visible(points, normals, which, sun["to_light"], eye, things)
    picture[hit] = np.where(visible[:, None], lit, dark)
    return picture


def hand_in(picture: Any, brightest: Any) -> Any:
    """The values of the picture: linear radiance."""
    return picture


def hit_points(scene: Any) -> Any:
    """Where each pixel's ray first meets a sphere (H, W, 3); NaN for none."""
    scene, things = read_scene(scene, scene["spheres"])
    rays = back_project(scene["K"], scene["dist"], scene["width"], scene["height"])
    _, which, points = met(rays.reshape(-1, 3), scene, things)
    points = np.where((which >= 0)[:, None], points, np.nan)
    return points.reshape(scene["height"], scene["width"], 3)


def render(scene: Any) -> Any:
    """The picture (H, W, 3), linear radiance."""
    scene, things = read_scene(scene, [*scene["spheres"], *scene["planes"]])
    rays = back_project(scene["K"], scene["dist"], scene["width"], scene["height"])
    eye, which, points = met(rays.reshape(-1, 3), scene, things)
    picture = radiance(scene, things, eye, which, points)
    picture = hand_in(picture, np.max(picture))
    return picture.reshape(scene["height"], scene["width"], 3)


# ------------------------------------------------------------------------------------------ other tracers

TEXT = Path(__file__).read_text(encoding="utf-8").split("# ----")[0]
"""The functions above."""
FUNCTIONS = {part.partition("(")[0]: f"def {part.rstrip()}\n" for part in TEXT.split("\n\n\ndef ")[1:]}
"""Name -> text of each."""

Changes = tuple[tuple[str, str], ...]
"""Replacements (old, new) in the text, one after the other."""


def tracer_with(functions: Mapping[str, Callable[..., Any]] | None = None, changes: Changes = ()) -> SimpleNamespace:
    """The textbook's functions, its text changed, and some replaced by `functions`, which the others then call.

    Raises ValueError for a change of what the text does not have, and for changes that leave no Python together.
    """
    texts = list(FUNCTIONS.values())
    for old, new in changes:
        if not any(old in text for text in texts):
            raise ValueError(f"the textbook has no {old!r}")
        texts = [text.replace(old, new) for text in texts]
    space = namespace(texts)
    space.update(functions or {})
    return SimpleNamespace(**{name: thing for name, thing in space.items() if not name.startswith("__")})


@lru_cache(maxsize=4096)
def slipped(function: str, changes: Changes) -> str:
    """The text of a function with these changes. Raises ValueError where it cannot have them, or is no Python."""
    text = FUNCTIONS[function]
    for old, new in changes:
        if old not in text:
            raise ValueError(f"{function} has no {old!r}")
        text = text.replace(old, new)
    code_of(text)
    return text


def namespace(texts: Iterable[str]) -> dict[str, Any]:
    """Define the functions of these texts, which may call one another."""
    space: dict[str, Any] = {"np": np, "Any": Any, "__builtins__": __builtins__, "srgb_decode": srgb_decode}
    space["srgb_encode"] = srgb_encode
    for code in map(code_of, texts):
        space[code.co_name] = FunctionType(code, space)
    return space


@lru_cache(maxsize=4096)
def code_of(text: str) -> CodeType:
    """The function that a text defines, compiled. Raises ValueError where it is no Python."""
    space: dict[str, Any] = {"Any": Any}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a changed text may have invalid escapes or comparisons
            exec(compile(text, __file__, "exec"), space)
    except SyntaxError as error:
        raise ValueError(f"changes that exclude one another: {error}") from None
    return next(thing.__code__ for thing in reversed(space.values()) if isinstance(thing, FunctionType))
