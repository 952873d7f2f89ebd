"""The two questions that a ray can ask of a scene: what does it meet first, and is its way blocked?

A ray that leaves a surface needs no offset along the normal. From outside, a convex object is not met again and never
hides from a point of itself what that point faces: each object is left out of the test of its own rays. From inside, a
sphere is met where the chord ends, and hides everything.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from raytwin.scene import Shape, Sphere
from raytwin.tracer.arrays import INFINITY, Vec, dot, integers, select
from raytwin.tracer.hit import NO_SPECULAR, Facts, Hit, Specular, Stages, World


class PlainWorld(NamedTuple):
    """Every object for every ray, on NumPy."""

    objects: Sequence[Shape]
    stages: Stages

    def closest_hit(self, origin: Vec, d: Vec, start: Hit | None = None) -> tuple[Any, Any]:
        best, ids = 0 * d[0] + INFINITY, integers(d[0], -1)
        for index, thing in enumerate(self.objects):
            t = distance(origin, d, thing, index, start, self.stages)
            closer = self.stages.nearer(t, best)
            best, ids = select(closer, (t, index), (best, ids))
        return best, ids

    def blocked(self, start: Hit, d: Vec) -> Any:
        found = start.inside
        for index, thing in enumerate(self.objects):
            found = found | hides(start, d, thing, index, self.stages)
        return found

    def facts(self, ids: Any) -> Facts:
        rows = np.array([facts_row(thing) for thing in self.objects] or [(0.0,) * 14])
        return facts_in(tuple(rows.T[:, ids]), any(thing.highlight for thing in self.objects))


def intersect(origin: Vec, d: Vec, thing: Shape, stages: Stages) -> Any:
    """t > 0 where the ray meets the object, infinity for a miss."""
    if isinstance(thing, Sphere):
        return stages.intersect_sphere(origin, d, thing)
    return stages.intersect_rectangle(origin, d, thing)


def distance(origin: Vec, d: Vec, thing: Shape, index: Any, start: Hit | None, stages: Stages) -> Any:
    """The same for a ray that leaves `start`, which meets its own object only from inside: 2 r n·d away."""
    t = intersect(origin, d, thing, stages)
    if start is None:
        return t
    own = INFINITY
    if isinstance(thing, Sphere):
        own = select(start.inside, 2 * thing.radius * dot(start.normal, d), INFINITY)
    return select(start.ids == index, own, t)


def hides(start: Hit, d: Vec, thing: Shape, index: Any, stages: Stages) -> Any:
    """True where the object, another than the ray's own, lies on the way along d."""
    return (start.ids != index) & (intersect(start.point, d, thing, stages) < INFINITY)


def surface_at(world: World, origin: Vec, d: Vec, t: Any, ids: Any) -> Hit:
    """What lies at the distance t on each ray: a point of the object `ids`."""
    reach = select(ids >= 0, t, 0.0)  # a miss has no point: keep infinity out of the arithmetic
    point = tuple(o + reach * c for o, c in zip(origin, d, strict=True))
    facts = world.facts(ids)
    n = world.stages.normal(point, facts)
    away = dot(n, d) > 0
    n = select(away, (-n[0], -n[1], -n[2]), n)
    return Hit(t, ids, point, n, facts.albedo, away & (facts.curvature > 0), d, facts.specular)


def first_hit(world: World, origin: Vec, d: Vec) -> Hit:
    """The first surface along each ray from `origin`."""
    return surface_at(world, origin, d, *world.closest_hit(origin, d))


def next_hit(world: World, start: Hit, d: Vec) -> Hit:
    """The first surface along each ray from the surface `start`."""
    return surface_at(world, start.point, d, *world.closest_hit(start.point, d, start))


def facts_row(thing: Shape) -> tuple[float, ...]:
    """What an object says of its surface, in 14 numbers; `facts_in` has their order."""
    flat, curvature = thing.facing
    share, exponent = thing.highlight or NO_SPECULAR
    return (*thing.center, *flat, curvature, *thing.albedo, *share, exponent)


def facts_in(row: Sequence[Any], glossy: bool) -> Facts:
    """The facts that the 14 numbers tell, or arrays of them; the highlight's where any object is `glossy`."""
    center, flat, albedo, share = ((row[i], row[i + 1], row[i + 2]) for i in (0, 3, 7, 10))
    return Facts(center, flat, row[6], albedo, Specular(share, row[13]) if glossy else None)


def normal(point: Vec, facts: Facts) -> Vec:
    """flat + curvature (p - center): unit, outwards."""
    return tuple(n + facts.curvature * (p - c) for n, p, c in zip(facts.flat, point, facts.center, strict=True))


def nearer(t: Any, best: Any) -> Any:
    """t < best: this object hides what was met so far."""
    return t < best
