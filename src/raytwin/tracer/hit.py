"""What a ray meets first: the nearest of all objects, its point, normal and albedo."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from raytwin.scene import Plane, Sphere
from raytwin.tracer.arrays import Vec, dot, select, sqrt
from raytwin.tracer.plane import cross, intersect_plane
from raytwin.tracer.sphere import INFINITY, intersect_sphere, sphere_normal


class Hit(NamedTuple):
    """Per ray: `t` metres (infinity: nothing), `ids` (-1: nothing), `point`, `normal` (unit, to the eye), `albedo`."""

    t: Any
    ids: Any
    point: Vec
    normal: Vec
    albedo: Vec


def intersect(origin: Vec, d: Vec, thing: Sphere | Plane, solver: str = "robust") -> Any:
    """t > 0 where the ray meets the object, infinity for a miss. A new shape gets a line here and in `normal_at`."""
    if isinstance(thing, Sphere):
        return intersect_sphere(origin, d, thing, solver)
    return intersect_plane(origin, d, thing)


def normal_at(p: Vec, thing: Sphere | Plane) -> Vec:
    """The object's unit normal at its point p, on the side that the shape prefers."""
    if isinstance(thing, Sphere):
        return sphere_normal(p, thing)
    n = cross(thing.half_u, thing.half_v)
    # half_u and half_v are perpendicular: |u × v| = |u| |v|.
    length = sqrt(dot(thing.half_u, thing.half_u) * dot(thing.half_v, thing.half_v))
    return tuple(c / length for c in n)


def nearest(origin: Vec, d: Vec, things: Sequence[tuple[int, Sphere | Plane]], solver: str = "robust") -> Hit:
    """The least t over the (id, object) pairs, and what is met there."""
    nothing = 0 * d[0]
    best, ids, normal, albedo = nothing + INFINITY, nothing - 1, (nothing,) * 3, (nothing,) * 3
    for index, thing in things:
        t = intersect(origin, d, thing, solver)
        nearer = t < best
        finite = select(nearer, t, 0.0)  # a miss has no point: keep infinity out of the arithmetic
        n = normal_at(tuple(o + finite * c for o, c in zip(origin, d, strict=True)), thing)
        best = select(nearer, t, best)
        ids = select(nearer, float(index), ids)
        normal = tuple(select(nearer, a, b) for a, b in zip(n, normal, strict=True))
        albedo = tuple(select(nearer, a, b) for a, b in zip(thing.albedo, albedo, strict=True))
    away = dot(normal, d) > 0
    normal = tuple(select(away, -n, n) for n in normal)
    reach = select(best < INFINITY, best, 0.0)
    point = tuple(o + reach * c for o, c in zip(origin, d, strict=True))
    return Hit(best, ids, point, normal, albedo)
