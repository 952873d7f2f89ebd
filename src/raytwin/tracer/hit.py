"""What a ray meets first: the nearest of all objects, its point, normal and albedo."""

from typing import Any, NamedTuple

from raytwin.scene import Shape, Sphere
from raytwin.tracer.arrays import Vec, dot, integers, select
from raytwin.tracer.objects import Listed, Table, Walked
from raytwin.tracer.plane import intersect_plane
from raytwin.tracer.sphere import INFINITY, intersect_sphere


class Hit(NamedTuple):
    """Per ray: `t` metres (infinity: nothing), `ids` (-1: nothing), `point`, `normal` (unit, to the eye), `albedo`.

    `inside`: it is a sphere, seen from within. Where nothing is met, only `t` and `ids` mean anything.
    """

    t: Any
    ids: Any
    point: Vec
    normal: Vec
    albedo: Vec
    inside: Any


def intersect(origin: Vec, d: Vec, thing: Shape, solver: str = "robust") -> Any:
    """t > 0 where the ray meets the object, infinity for a miss. A new shape gets a line here."""
    if isinstance(thing, Sphere):
        return intersect_sphere(origin, d, thing, solver)
    return intersect_plane(origin, d, thing)


def first(origin: Vec, d: Vec, objects: Listed | Walked, solver: str = "robust") -> tuple[Any, Any]:
    """(t, id) of the nearest object on each ray; infinity and -1 where there is none."""

    def nearer(state, index, thing):
        best, ids = state
        t = intersect(origin, d, thing, solver)
        return select(t < best, t, best), select(t < best, index, ids)

    return objects.fold((0 * d[0] + INFINITY, integers(d[0], -1)), nearer)


def describe(origin: Vec, d: Vec, t: Any, ids: Any, table: Table) -> Hit:
    """What lies at the distance t on each ray: a point of the object `ids`."""
    met = ids >= 0
    reach = select(met, t, 0.0)  # a miss has no point: keep infinity out of the arithmetic
    point = tuple(o + reach * c for o, c in zip(origin, d, strict=True))
    center, flat = table.look_up("center", ids, met), table.look_up("flat", ids, met)
    (bend,) = table.look_up("bend", ids, met)
    normal = tuple(n + bend * (p - c) for n, p, c in zip(flat, point, center, strict=True))
    away = dot(normal, d) > 0
    normal = tuple(select(away, -n, n) for n in normal)
    return Hit(t, ids, point, normal, table.look_up("albedo", ids, met), away & (bend > 0))


def nearest(origin: Vec, d: Vec, objects: Listed | Walked, solver: str = "robust") -> Hit:
    """The first object on each ray, and what is met there."""
    return describe(origin, d, *first(origin, d, objects, solver), objects.table)
