"""What a ray meets: the nearest of all objects, its point, normal and albedo; or whether anything at all."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from raytwin.arrays import INFINITY, Vec, dot, integers, select
from raytwin.scene import Phong, Shape, Sphere


class Stages(NamedTuple):
    """The tracer's steps as data: `STAGES._replace(lambert=...)` puts a learner's, or a fault, in the place of one."""

    undistort: Callable[[Any, Any, Any], Any]
    back_project: Callable[..., Any]
    intersect_sphere: Callable[[Any, Any, Any], Any]
    intersect_rectangle: Callable[[Any, Any, Any], Any]
    nearer: Callable[[Any, Any], Any]
    normal: Callable[[Any, Any], Any]
    lambert: Callable[..., Any]
    sun_visible: Callable[..., Any]


class Gloss(NamedTuple):
    """The highlight of `scene.Phong`; none, for all objects at once, where the scene has no such material."""

    specular: Vec
    exponent: Any


class Facts(NamedTuple):
    """Of an object, or of what each ray met. The normal at p is flat + bend (p - center); a sphere's bend is 1/r."""

    center: Vec
    flat: Vec
    bend: Any
    albedo: Vec
    gloss: Gloss | None = None


def facts_of(thing: Shape) -> Facts:
    rho, gloss = thing.material.albedo, gloss_of(thing)
    if isinstance(thing, Sphere):
        return Facts(thing.center, (0.0, 0.0, 0.0), 1 / thing.radius, rho, gloss)
    return Facts(thing.center, thing.normal, 0.0, rho, gloss)


def gloss_of(thing: Shape) -> Gloss | None:
    material = thing.material
    return Gloss(material.specular, material.exponent) if isinstance(material, Phong) else None


NO_GLOSS = Gloss((0.0, 0.0, 0.0), 1.0)
"""Of the Lambertian objects of a scene that has others, too."""


class Ray(NamedTuple):
    """From `origin` along the unit `d`; `start`: the surface that it leaves, None for the eye."""

    origin: Vec
    d: Vec
    start: Any = None


Body = Callable[..., Any]
Reach = Callable[[Any], Any]


@runtime_checkable
class Objects(Protocol):
    """What rays are tested against: state = body(state, ray, id, object) for one after the other, `facts` of those met.

    What a ray cannot meet, or only beyond reach(state), may be left out; without a ray nothing is.
    """

    def fold(self, ray: Ray | None, state: Any, body: Body, reach: Reach = lambda state: INFINITY) -> Any: ...
    def facts(self, ids: Any) -> Facts: ...


class Every(NamedTuple):
    """All objects for every ray, on NumPy."""

    things: Sequence[Shape]

    def fold(self, ray: Ray | None, state: Any, body: Body, reach: Reach = lambda state: INFINITY) -> Any:
        for index, thing in enumerate(self.things):
            state = body(state, ray, index, thing)
        return state

    def facts(self, ids: Any) -> Facts:
        rows = [np.hstack([*(facts := facts_of(thing))[:4], *(facts.gloss or NO_GLOSS)]) for thing in self.things] or [
            np.zeros(14)
        ]
        columns = np.array(rows).T[:, ids]
        glossy = any(gloss_of(thing) for thing in self.things)
        gloss = Gloss(tuple(columns[10:13]), columns[13]) if glossy else None
        return Facts(tuple(columns[:3]), tuple(columns[3:6]), columns[6], tuple(columns[7:10]), gloss)


class Hit(NamedTuple):
    """Per ray: `t` metres (infinity: nothing), `ids` (-1: nothing), unit `normal` to the eye; `inside` of a sphere.

    `d`: the ray's direction; `gloss`: None where no object of the scene has any.
    """

    t: Any
    ids: Any
    point: Vec
    normal: Vec
    albedo: Vec
    inside: Any
    d: Vec
    gloss: Gloss | None = None


def intersect(origin: Vec, d: Vec, thing: Shape, stages: Stages) -> Any:
    """t > 0 where the ray meets the object, infinity for a miss. A new shape gets a line here and in `facts_of`."""
    if isinstance(thing, Sphere):
        return stages.intersect_sphere(origin, d, thing)
    return stages.intersect_rectangle(origin, d, thing)


def nearer(t: Any, best: Any) -> Any:
    """t < best: this object hides what was met so far."""
    return t < best


def chord(start: Hit, d: Vec, radius: Any) -> Any:
    """2 r n·d: from a sphere's inside along d to its other side; infinity from outside."""
    return select(start.inside, 2 * radius * dot(start.normal, d), INFINITY)


def normal(point: Vec, facts: Facts) -> Vec:
    """flat + bend (p - center): unit, outwards."""
    return tuple(n + facts.bend * (p - c) for n, p, c in zip(facts.flat, point, facts.center, strict=True))


class World(NamedTuple):
    """The objects behind the two questions that a ray can ask: what is `nearest`, and is the way `blocked`?

    `objects` hold for rays from the eye, `casters` for those from what it sees to the sun, `others` for any.
    """

    objects: Objects
    casters: Objects
    others: Callable[[], Objects]
    stages: Stages

    def beyond(self) -> "World":
        """The same for rays that start elsewhere."""
        return self._replace(objects=(every := self.others()), casters=every)

    def first(self, origin: Vec, d: Vec, start: Hit | None = None) -> Any:
        """(t, id) of the nearest object on each ray; infinity and -1 where there is none.

        A ray from a surface, `start`, needs no offset along the normal: a convex object is not met again from outside;
        from inside, a sphere is where the chord ends.
        """

        def closer(state: Any, ray: Ray, index: Any, thing: Shape) -> Any:
            t = intersect(ray.origin, ray.d, thing, self.stages)
            if ray.start is not None:
                own = chord(ray.start, ray.d, thing.radius) if isinstance(thing, Sphere) else INFINITY
                t = select(ray.start.ids == index, own, t)
            hides = self.stages.nearer(t, state[0])
            return select(hides, t, state[0]), select(hides, index, state[1])

        nothing = 0 * d[0] + INFINITY, integers(d[0], -1)
        return self.objects.fold(Ray(origin, d, start), nothing, closer, lambda state: state[0])

    def describe(self, origin: Vec, d: Vec, t: Any, ids: Any) -> Hit:
        """What lies at the distance t on each ray: a point of the object `ids`."""
        reach = select(ids >= 0, t, 0.0)  # a miss has no point: keep infinity out of the arithmetic
        point = tuple(o + reach * c for o, c in zip(origin, d, strict=True))
        facts = self.objects.facts(ids)
        n = self.stages.normal(point, facts)
        away = dot(n, d) > 0
        n = tuple(select(away, -c, c) for c in n)
        return Hit(t, ids, point, n, facts.albedo, away & (facts.bend > 0), d, facts.gloss)

    def nearest(self, origin: Vec, d: Vec) -> Hit:
        """The first object on each ray, and what is met there."""
        return self.describe(origin, d, *self.first(origin, d))

    def onward(self, start: Hit, d: Vec) -> Hit:
        """The first object on each ray from one surface to the next."""
        return self.describe(start.point, d, *self.first(start.point, d, start))

    def blocked(self, hit: Hit, d: Vec) -> Any:
        """Does anything lie on the way from the hit points along d?

        No offset along the normal is needed: a convex object never hides from a point of itself what that point faces
        from outside, so each object is left out of its own test; seen from inside, a sphere hides everything.
        """

        def block(state: Any, ray: Ray, index: Any, thing: Shape) -> Any:
            t = intersect(ray.origin, ray.d, thing, self.stages)
            return (state[0] | ((ray.start.ids != index) & (t < INFINITY)),)

        return self.casters.fold(Ray(hit.point, d, hit), (hit.inside,), block, lambda s: select(s[0], 0.0, INFINITY))[0]
