"""What a ray meets: the nearest of all objects, its point, normal and albedo; or whether anything at all."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from raytwin.scene import Shape, Sphere
from raytwin.tracer.arrays import INFINITY, Vec, dot, integers, select
from raytwin.tracer.stages import Stages


class Facts(NamedTuple):
    """Of an object, or of the one that each ray met: its normal at its point p is flat + bend (p - center).

    A sphere's is (p - center) / radius; a rectangle's is the same everywhere.
    """

    center: Vec
    flat: Vec
    bend: Any
    albedo: Vec


def facts_of(thing: Shape) -> Facts:
    """A new shape gets a line here, and one in `intersect`."""
    if isinstance(thing, Sphere):
        return Facts(thing.center, (0.0, 0.0, 0.0), 1 / thing.radius, thing.material.albedo)
    return Facts(thing.center, thing.normal, 0.0, thing.material.albedo)


class Objects(Protocol):
    """What rays are tested against: `fold` hands a state from object to object, `facts` tells of those met.

    state = body(state, id, object) for one object after the other; `facts` of an id below 0 mean nothing.
    """

    def fold(self, state: tuple, body: Callable) -> tuple: ...

    def facts(self, ids: Any) -> Facts: ...


class Every(NamedTuple):
    """All objects for every ray, on NumPy: the plain way."""

    things: Sequence[Shape]

    def fold(self, state: tuple, body: Callable) -> tuple:
        for index, thing in enumerate(self.things):
            state = body(state, index, thing)
        return state

    def facts(self, ids: Any) -> Facts:
        rows = [np.hstack(facts_of(thing)) for thing in self.things] or [np.zeros(10)]
        columns = np.array(rows).T[:, ids]
        return Facts(tuple(columns[:3]), tuple(columns[3:6]), columns[6], tuple(columns[7:]))


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


def intersect(origin: Vec, d: Vec, thing: Shape, stages: Stages) -> Any:
    """t > 0 where the ray meets the object, infinity for a miss."""
    if isinstance(thing, Sphere):
        return stages.intersect_sphere(origin, d, thing)
    return stages.intersect_rectangle(origin, d, thing)


def nearer(t: Any, best: Any) -> Any:
    """t < best: this object hides what was met so far."""
    return t < best


def normal(point: Vec, facts: Facts) -> Vec:
    """flat + bend (p - center): unit, outwards."""
    return tuple(n + facts.bend * (p - c) for n, p, c in zip(facts.flat, point, facts.center, strict=True))


class World(NamedTuple):
    """The objects behind the two questions that a ray can ask: what is `nearest`, and is the way `blocked`?"""

    objects: Objects
    stages: Stages

    def first(self, origin: Vec, d: Vec) -> tuple[Any, Any]:
        """(t, id) of the nearest object on each ray; infinity and -1 where there is none."""

        def closer(state, index, thing):
            best, ids = state
            t = intersect(origin, d, thing, self.stages)
            hides = self.stages.nearer(t, best)
            return select(hides, t, best), select(hides, index, ids)

        return self.objects.fold((0 * d[0] + INFINITY, integers(d[0], -1)), closer)

    def describe(self, origin: Vec, d: Vec, t: Any, ids: Any) -> Hit:
        """What lies at the distance t on each ray: a point of the object `ids`."""
        reach = select(ids >= 0, t, 0.0)  # a miss has no point: keep infinity out of the arithmetic
        point = tuple(o + reach * c for o, c in zip(origin, d, strict=True))
        facts = self.objects.facts(ids)
        n = self.stages.normal(point, facts)
        away = dot(n, d) > 0
        return Hit(t, ids, point, tuple(select(away, -c, c) for c in n), facts.albedo, away & (facts.bend > 0))

    def nearest(self, origin: Vec, d: Vec) -> Hit:
        """The first object on each ray, and what is met there."""
        return self.describe(origin, d, *self.first(origin, d))

    def blocked(self, hit: Hit, d: Vec) -> Any:
        """Does anything lie on the way from the hit points along d?

        No offset along the normal is needed: a convex object never hides from a point of itself what that point faces
        from outside, so each object is left out of its own test; seen from inside, a sphere hides everything.
        """

        def block(state, index, thing):
            t = intersect(hit.point, d, thing, self.stages)
            return (state[0] | ((hit.ids != index) & (t < INFINITY)),)

        return self.objects.fold((hit.inside,), block)[0]
