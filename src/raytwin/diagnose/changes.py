"""What mistakes are made of: a fault, and changes of the tracer's steps that many faults share."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import pi
from typing import Any

import msgspec
import numpy as np

from raytwin.diagnose.predict import Array, Change, Hits, Rays, Steps, Terms, lambert, meet_all, others_hide
from raytwin.diagnose.slips import slips
from raytwin.scene import Camera, Scene, Shape, Sphere

CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, OUTPUT, SAMPLING = (
    "camera", "solver", "order", "normals", "light", "shadow", "output", "sampling",
)  # fmt: skip
Casters = tuple[Shape, ...]
STAGES = (CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, SAMPLING, OUTPUT)
"""From the pixel to the picture: what stands earlier is told first."""


@dataclass(frozen=True, eq=False)
class Fault:
    """`name` is unique; `sentence` says to a student what is wrong and what is right.

    `alone`: slips that show the fault where a function is tested alone; pictures have `ways` for it.
    """

    name: str
    stage: str
    sentence: str
    ways: tuple[Change, ...]
    alone: tuple[Change, ...] = ()


def row(name: str, stage: str, sentence: str, *ways: Change, alone: tuple[Change, ...] = ()) -> Fault:
    return Fault(name, stage, sentence, ways, alone)


def put(**steps: Any) -> Change:
    """The steps in the place of the right ones."""
    return lambda s: s._replace(**steps)


def behind(f: Callable[[Scene], Any]) -> Change:
    """Another background."""
    return put(background=lambda scene, d: np.broadcast_to(np.asarray(f(scene), float), 3)[:, None])


def both(*changes: Change) -> Change:
    """One after the other."""
    if len(changes) == 1:
        return changes[0]

    def change(s: Steps) -> Steps:
        for one in changes:
            s = one(s)
        return s

    return change


def terms(f: Callable[[Terms], Terms]) -> Change:
    """Other things to shade with."""
    return lambda s: s._replace(prepare=lambda x: s.prepare(f(x)))


def coloured(f: Callable[[Terms], Array]) -> Change:
    return terms(lambda x: x._replace(albedo=f(x)))


def at(f: Callable[[Array, Array, Camera], tuple[Any, Any]]) -> Change:
    """Rays through other places in the image than the pixels' centres."""
    return lambda s: s._replace(place=lambda u, v, camera: f(*s.place(u, v, camera), camera))


def seen(f: Callable[[Camera], Camera]) -> Change:
    """Another K or other coefficients."""
    return lambda s: s._replace(lens=lambda camera: f(s.lens(camera)))


def lens(fx: Any = None, fy: Any = None, cx: Any = None, cy: Any = None) -> Change:
    def changed(camera: Camera) -> Camera:
        a, b, c, d = (f(camera) if f else old for f, old in
                      ((fx, camera.fx), (fy, camera.fy), (cx, camera.cx), (cy, camera.cy)))  # fmt: skip
        return msgspec.structs.replace(camera, K=((a, 0.0, c), (0.0, b, d), (0.0, 0.0, 1.0)))

    return seen(changed)


def posed(f: Callable[[Array, Array], tuple[Any, Any]]) -> Change:
    """(R, t) -> the eye in the board's frame, and the matrix that turns directions from the camera's axes to its."""

    def changed(camera: Camera) -> Camera:
        R, t = np.asarray(camera.R_cam_board), np.asarray(camera.t_cam_board)
        eye, turn = f(R, t)
        matrix, moved = np.asarray(turn).T, -np.asarray(turn).T @ np.asarray(eye)
        return msgspec.structs.replace(
            camera, R_cam_board=tuple(map(tuple, matrix.tolist())), t_cam_board=tuple(moved.tolist())
        )

    return placed(changed)


def placed(f: Callable[[Camera], Camera]) -> Change:
    """Another R and t."""
    return lambda s: s._replace(camera=lambda camera: f(s.camera(camera)))


def other(f: Callable[[Shape, Camera], Shape]) -> Change:
    """Another object in the place of each."""
    return lambda s: s._replace(objects=lambda all_, camera: tuple(f(x, camera) for x in s.objects(all_, camera)))


def unstretched(x: Array, y: Array, camera: Camera, ray: Any) -> Rays:
    """t of unit rays goes along (x, y, 1)."""
    rays = ray(x, y, camera)
    return rays._replace(aim=rays.d * rays.stretch)


UNDO, UNIT = "undistort((u - cx) / fx, (v - cy) / fy, dist)", "rays / np.linalg.norm(rays, axis=-1, keepdims=True)"


def grid(*places: str) -> tuple[Change, ...]:
    """Rays through other places in the image."""
    return slips("pixels", *(f"return u, v => return {place}" for place in places))


sphere, plane = partial(slips, "intersect_sphere"), partial(slips, "intersect_plane")
order, normals_at = partial(slips, "nearest"), partial(slips, "normals_at")
NU, NV = "np.linalg.norm(half_u)", "np.linalg.norm(half_v)"
IN_U, IN_V = "np.abs(q @ half_u) <= half_u @ half_u", "np.abs(q @ half_v) <= half_v @ half_v"
INSIDE, T, MET = f"({IN_U}) & ({IN_V})", "((center - origins) @ n) / (directions @ n)", "inside & (t > 0)"
CROSS, CROSS_AT = "n = np.cross(half_u, half_v)", 'n = np.cross(thing["half_u"], thing["half_v"])'


def resized(factor: float, length: float = 1) -> Change:
    """Spheres of another radius, whose normals have this length."""

    grown = other(lambda x, _: msgspec.structs.replace(x, radius=factor * x.radius) if isinstance(x, Sphere) else x)
    return both(grown, on_spheres(lambda n: n * length))


def on_spheres(f: Callable[[Array], Array]) -> Change:
    """Another normal of spheres."""
    return normals(lambda n, p, rays, thing: f(n) if isinstance(thing, Sphere) else n)


def normals(f: Callable[[Array, Array, Rays, Any], Array]) -> Change:
    """(right normal, point, rays, thing) -> normal."""

    def written(points: Array, which: Array, eye: Array, things: Any, of: Any) -> Array:
        p, n = points.T, np.asarray(of(points, which, eye, things), float).T
        d = made_unit(p - eye[:, None])
        return f(n, p, Rays(eye[:, None], d, d, np.ones(which.size)), None).T

    def change(s: Steps) -> Steps:
        if s.normals_at is not None:
            return s._replace(normals_at=partial(written, of=s.normals_at))
        return s._replace(normal=lambda p, rays, thing: f(s.normal(p, rays, thing), p, rays, thing))

    return change


def made_unit(n: Array, *_: Any) -> Array:
    length = np.linalg.norm(n, axis=0)
    return n / np.where(length > 0, length, 1)


def three(v: Any) -> Any:
    return tuple(np.asarray(v, float).tolist())


def in_shadow_test(change: Change) -> Change:
    """For shadow rays alone: the eye sees what it should."""
    return lambda s: s._replace(blocked=lambda hits, to, things, steps: s.blocked(
        hits, to, things, steps._replace(sphere=change(s).sphere, rectangle=change(s).rectangle)))  # fmt: skip


def inside(*tests: str) -> tuple[Change, ...]:
    """Rectangles that end elsewhere."""
    return plane(*(f"{INSIDE} => {test}" for test in tests))


def reaching(u: str, v: str) -> str:
    """|q·u| and |q·v| up to these."""
    return f"(np.abs(q @ half_u) <= {u}) & (np.abs(q @ half_v) <= {v})"


def is_sphere(thing: Shape) -> bool:
    return isinstance(thing, Sphere)


def offset_by(eps: float, along_light: bool = False) -> Callable[[Hits, Array, Casters, Steps], Array]:
    """The shadow ray starts eps metres along the normal (or towards the light), and may meet its own object."""

    def blocked(hits: Hits, to: Array, things: Casters, steps: Steps) -> Array:
        away = np.broadcast_to(to, hits.point.shape) if along_light else hits.normal
        return _any_blocks(hits.point + eps * away, to, things, steps)

    return blocked


def _any_blocks(start: Array, to: Array, things: Casters, steps: Steps, limit: float = np.inf) -> Array:
    to = np.broadcast_to(to, start.shape)
    t = meet_all(start, to, things, steps)
    return np.asarray((np.isfinite(t) & (t < limit)).any(axis=0))


def on_plane(x: Terms) -> Array:
    return np.array([not is_sphere(thing) for thing in x.scene.objects] + [False])[x.hits.ids]


def shaded(f: Callable[[Terms], Array]) -> Change:
    """Another formula."""
    return put(shade=f)


def lit(f: Callable[[Array, Scene, Hits], Array]) -> Change:
    """Another direction to the light (3, 1) or (3, N), for shading and for shadows."""
    return lambda s: s._replace(light=lambda to, scene, hits: f(s.light(to, scene, hits), scene, hits))


def half_lit(f: Callable[[Array, Scene, Hits], Array]) -> Change:
    """The same for shading alone: shadows are cast rightly."""

    def recast(x: Terms) -> Terms:
        to = f(np.array(x.scene.sun.to_light)[:, None], x.scene, x.hits)
        return x._replace(cos=(x.hits.normal * to).sum(axis=0))

    return terms(recast)


def sun(x: Terms, cos: Any = None) -> Array:
    """The sun's part."""
    return x.albedo / pi * x.irradiance * x.visible * (np.maximum(x.cos, 0) if cos is None else cos)


def sun_times(f: Any) -> Change:
    """The sun's part, a function of it and the terms; or a factor."""
    return terms(lambda x: x._replace(irradiance=x.irradiance * (f(x) if callable(f) else f)))


def sky_times(f: Any) -> Change:
    return terms(lambda x: x._replace(sky=x.sky * (f(x) if callable(f) else f)))


def turned(turn: Callable[[Array], Array]) -> tuple[Change, ...]:
    """The light's direction turned by a function of R: everywhere, or for shading alone."""
    f = lambda to, scene, hits: turn(np.asarray(scene.camera.R_cam_board)) @ to  # noqa: E731
    return lit(f), half_lit(f)


def sky_scaled(scene: Scene, k: float) -> Array:
    return k * np.array(scene.sky.radiance)


def where_cast(change: Change) -> Change:
    """What is done in shadow is done where another object casts it: what faces away from the sun is not tested."""
    return both(put(blocked=others_hide), change)


shade = partial(slips, "shade")
COS = "np.sum(normals * to_light, axis=-1, keepdims=True)"
CLAMPED, SUN, SUM = (
    f"np.maximum(0, {COS})",
    "albedo / np.pi * irradiance * cosine",
    ("albedo / np.pi * irradiance * cosine + albedo * sky"),
)


def shadows(f: Callable[[Hits, Array, Casters, Steps], Array]) -> Change:
    """(hits, to the light, things, steps) -> (N,) bool: blocked. Without shadows (rung lambert) it has no effect."""
    return put(blocked=f)


def within(limit: float) -> Callable[[Hits, Array, Casters, Steps], Array]:
    """Only what is nearer than this, metres, casts a shadow."""

    def blocked(hits: Hits, to: Array, things: Casters, steps: Steps) -> Array:
        away = (hits.normal * to).sum(axis=0) <= 0
        return away | _any_blocks(hits.point + 1e-7 * hits.normal, to, things, steps, limit)

    return blocked


def gone(thing: Shape) -> Shape:
    if isinstance(thing, Sphere):
        return msgspec.structs.replace(thing, center=(0.0, 0.0, -1e9), radius=1e-9)
    return msgspec.structs.replace(thing, center=(0.0, 0.0, -1e9), half_u=(1e-9, 0.0, 0.0), half_v=(0.0, 1e-9, 0.0))


def dimmed(x: Terms, by: float) -> Array:
    return lambert(x._replace(visible=np.ones_like(x.visible))) * np.where(x.visible > 0, 1.0, by)


def shown(f: Callable[[Array], Array]) -> Change:
    """Other values, each by itself."""
    return lambda s: s._replace(output=lambda x, brightest: f(s.output(x, brightest)))
