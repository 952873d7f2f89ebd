"""The scene's objects in float64, in Mitsuba's world: for what Mitsuba's float32 can neither represent nor decide.

Mitsuba answers for every ray. Three things are beyond float32:

- an object far larger than its distance from the eye (a ground of 1000 m under a camera at 2 m): a sphere's centre and
  radius are off by 2⁻²⁴ of themselves, and Mitsuba's shadow test takes the difference of their squares;
- an object far smaller than its distance from the eye: its centre is off by 2⁻²⁴ of that distance, and shadow rays
  start 4e-6 of it above the surface;
- a ray within rounding of an outline: see `outlines`.

`beyond_floats` finds the first two. Mitsuba is not given these objects; `distance` intersects them, whatever the ray.
"""

from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from raytwin.scene import Rectangle, Scene
from raytwin.twin.twin_scene import SHADOW_OFFSET, UNIT

SPHERE_REACH, RECTANGLE_REACH = 16.0, 100.0
"""Largest radius, and largest distance to a corner, divided by the distance from the eye, that Mitsuba intersects.

At these, rounding moves the surface by 1e-6 of the distance from the eye, a quarter of what shadow rays start above it
(`world.SHADOW_OFFSET`). Spheres shaded themselves from 100 on, rectangles from 1000 on.
"""

SPHERE_FAR, RECTANGLE_FAR = 128.0, 1024.0
"""Largest distance from the eye, divided by the radius or by the longer half edge, at which float32 is trusted.

At 128 radii the normal at a sphere's rim is off by 5e-6, at 1000 by 4e-5. A rectangle's own normal has no such error,
but shadow rays start 0.4 % of its size above it.
"""

START = 1e-9
"""How far off the surface a float64 shadow ray starts, as a part of the distance from the eye."""

MOST_IN_DOUBLES = 64
"""Objects: in a scene of more, the small and far ones stay with Mitsuba (`outlines.refine` then corrects what the eye
sees of them), since every ray is tested against every object here.
"""


class Body(NamedTuple):
    """A sphere, `round`, or a rectangle: numbers, or arrays of them (n,); vectors as components (3, ...).

    A rectangle is |(p - center) · u| <= 1 and |(p - center) · v| <= 1 on its plane, with its unit normal n.
    """

    round: Any
    center: Any
    radius: Any
    u: Any
    v: Any
    n: Any

    def at(self, index: Any) -> "Body":
        """The bodies of these ids, from a table of all."""
        return Body(*(field[..., index] for field in self))


def table(scene: Scene) -> Body:
    """All objects, by id: (3, n) each, the radius (n,)."""
    R, t = np.asarray(scene.camera.R_cam_board), np.asarray(scene.camera.t_cam_board)
    rows: list[tuple[Any, ...]] = []
    for thing in scene.objects:
        center = (R @ thing.center + t) * UNIT
        if isinstance(thing, Rectangle):
            u, v = (R @ edge * UNIT for edge in (thing.half_u, thing.half_v))
            rows.append((False, center, 0.0, u / (u @ u), v / (v @ v), R @ thing.normal))
        else:
            rows.append((True, center, thing.radius * UNIT, np.zeros(3), np.zeros(3), np.zeros(3)))
    if not rows:
        return Body(np.zeros(0, bool), np.zeros((3, 0)), np.zeros(0), *np.zeros((3, 3, 0)))
    return Body(*(np.stack(column, axis=-1) for column in zip(*rows, strict=True)))


def beyond_floats(bodies: Body) -> list[int]:
    """The ids of the objects that float64 must intersect: those too large for float32, or all where one is too far."""
    number = len(bodies.radius)
    everything = number <= MOST_IN_DOUBLES and too_far(bodies).any()
    return [int(i) for i in (range(number) if everything else np.flatnonzero(too_large(bodies)))]


def too_far(bodies: Body) -> np.ndarray:
    """Which objects are too small for float32 at their distance from the eye: (n,)."""
    with np.errstate(divide="ignore"):
        half = np.max([1 / np.linalg.norm(edge, axis=0) for edge in (bodies.u, bodies.v)], axis=0)
    size = np.where(bodies.round, bodies.radius * SPHERE_FAR, half * RECTANGLE_FAR)
    return np.asarray(np.linalg.norm(bodies.center, axis=0) > size)


def too_large(bodies: Body) -> np.ndarray:
    """Which objects are too large, or too near to the eye, for Mitsuba's float32: (n,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        half = [np.nan_to_num(edge / (edge * edge).sum(axis=0)) for edge in (bodies.u, bodies.v)]
    corners = [bodies.center + x * half[0] + y * half[1] for x in (-1, 1) for y in (-1, 1)]
    corner = np.max(np.linalg.norm(corners, axis=1), axis=0)
    # The eye's nearest point of a rectangle: that of its plane, drawn back to the edges.
    a, b = (np.clip((-bodies.center * edge).sum(axis=0), -1, 1) for edge in (bodies.u, bodies.v))
    near = np.linalg.norm(bodies.center + a * half[0] + b * half[1], axis=0)
    sphere = bodies.radius > SPHERE_REACH * abs(np.linalg.norm(bodies.center, axis=0) - bodies.radius)
    return np.asarray(np.where(bodies.round, sphere, corner > RECTANGLE_REACH * near))


def offsets(bodies: Body) -> np.ndarray:
    """How far off each object's surface float64 rays start, as a part of the distance from the eye: (n,).

    Off a large sphere as far as Mitsuba's own: its points are rounded to 1e-16 of its radius.
    """
    return np.where(bodies.round & too_large(bodies), SHADOW_OFFSET, START)


def distance(xp: ModuleType, body: Body, o: Any, d: Any) -> Any:
    """How far from o along the unit vector d the body is first met, inf where it is not; `xp` is numpy or drjit.

    Sphere: t = -b ∓ √(b² - (|f| - r)(|f| + r)), f = o - center, b = f · d, the smaller that is positive.
    Rectangle: t = (center - o) · n / d · n, where the point lies within the edges. `o`, `d`: three components each.
    """
    where = np.where if xp is np else xp.select
    f = tuple(o[k] - body.center[k] for k in range(3))
    if np.ndim(body.round):
        return np.where(body.round, _to_sphere(xp, where, body, f, d), _to_rectangle(xp, where, body, f, d))
    return (_to_sphere if body.round else _to_rectangle)(xp, where, body, f, d)


def _to_sphere(xp: ModuleType, where: Any, body: Body, f: Any, d: Any) -> Any:
    b, far = dot(f, d), xp.sqrt(dot(f, f))
    square = b * b - (far - body.radius) * (far + body.radius)
    root = xp.sqrt(xp.maximum(square, 0))
    t = where(-b - root > 0, -b - root, -b + root)
    return where((square >= 0) & (t > 0), t, xp.inf)


def _to_rectangle(xp: ModuleType, where: Any, body: Body, f: Any, d: Any) -> Any:
    toward = dot(d, body.n)
    t = -dot(f, body.n) / where(toward == 0, 1, toward)
    p = tuple(f[k] + t * d[k] for k in range(3))
    inside = (abs(dot(p, body.u)) <= 1) & (abs(dot(p, body.v)) <= 1)
    return where(inside & (toward != 0) & (t > 0), t, xp.inf)


def normal(body: Body, p: Any) -> tuple[Any, ...]:
    """The unit normal at p, three components: away from a sphere's centre, the rectangle's own."""
    if np.ndim(body.round):
        away = (p - body.center) / np.where(body.round, body.radius, 1)
        return tuple(np.where(body.round, away, body.n))
    return tuple((p[k] - body.center[k]) / body.radius for k in range(3)) if body.round else tuple(body.n)


def dot(a: Any, b: Any) -> Any:
    """a · b of three components each."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
