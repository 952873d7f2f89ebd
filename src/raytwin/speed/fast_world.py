"""The tracer's World over fewer objects: what a ray cannot meet is left out.

`FastWorld` asks the tracer's two questions by folding over objects, state = body(state, ray, id, object). Four classes
say which objects: ObjectList, SunwardList and KernelLists here, Trees in `speed.bvh`.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from raytwin.arrays import INFINITY, Vec, integers, select
from raytwin.scene import Rectangle, Sphere
from raytwin.speed.engine import Engine, from_numpy, gather
from raytwin.speed.object_table import Table
from raytwin.tracer.hit import Facts, Hit, Stages
from raytwin.tracer.world import distance, hides

SIZE_MARGIN, POINT_MARGIN = 1e-4, 1e-6
"""How much larger a caster is taken to be, as shares of its size and of the largest coordinate: float32's rounding."""


class Ray(NamedTuple):
    """From `origin` along the unit `d`; `start`: the surface that it leaves, None for the eye."""

    origin: Vec
    d: Vec
    start: Hit | None = None


Body = Callable[..., Any]
MaxDistance = Callable[[Any], Any]


def no_reach(state: Any) -> Any:
    return INFINITY


@runtime_checkable
class Objects(Protocol):
    """state = body(state, ray, id, object) for one object after the other.

    What the `Ray` cannot meet, or only beyond reach(state), may be left out.
    """

    def fold(self, ray: Any, state: Any, body: Body, reach: MaxDistance = no_reach) -> Any: ...


class FastWorld(NamedTuple):
    """A `tracer.World` that tests rays for their closest hit with `seen`, and for what blocks them with `casters`."""

    table: Table
    stages: Stages
    seen: Objects
    casters: Objects

    def closest_hit(self, origin: Vec, d: Vec, start: Hit | None = None) -> tuple[Any, Any]:
        def closer(state: Any, ray: Any, index: Any, thing: Any) -> Any:
            t = distance(ray.origin, ray.d, thing, index, ray.start, self.stages)
            nearer = self.stages.nearer(t, state[0])
            return select(nearer, t, state[0]), select(nearer, index, state[1])

        nothing = 0 * d[0] + INFINITY, integers(d[0], -1)
        t, ids = self.seen.fold(Ray(origin, d, start), nothing, closer, lambda state: state[0])
        return t, ids

    def blocked(self, start: Hit, d: Vec) -> Any:
        def block(state: Any, ray: Any, index: Any, thing: Any) -> Any:
            return (state[0] | hides(ray.start, ray.d, thing, index, self.stages),)

        ray = Ray(start.point, d, start)
        return self.casters.fold(ray, (start.inside,), block, lambda state: select(state[0], 0.0, INFINITY))[0]

    def facts(self, ids: Any) -> Facts:
        return self.table.facts(ids)


class ObjectList(NamedTuple):
    """The same objects for every ray: their ids, in order. A loop in Python."""

    table: Table
    ids: Sequence[int]

    def fold(self, ray: Any, state: Any, body: Body, reach: MaxDistance = no_reach) -> Any:
        for index in self.ids:
            state = body(state, ray, index, self.table.objects[index])
        return state


class SunwardList(NamedTuple):
    """NumPy's objects that may stand between some points and the sun, towards which all rays are parallel.

    Seen in `axes` (3, 3), the last of which points to the sun, object i lies between `low[i]` and `high[i]` (n, 3).
    `only`: the id of the object that the points are on, None where there are several.
    """

    table: Table
    axes: np.ndarray
    low: np.ndarray
    high: np.ndarray
    only: int | None = None

    def fold(self, ray: Any, state: Any, body: Body, reach: MaxDistance = no_reach) -> Any:
        others = np.delete(np.arange(len(self.low)), [] if self.only is None else self.only)
        if not others.size or not (seen := np.broadcast_to(ray.start.ids >= 0, np.shape(ray.origin[0]))).any():
            return state
        points = [c if seen.all() else c[seen] for c in ray.origin]
        low, high = (np.array([find(c) for c in points], float) for find in (np.min, np.max))
        middle, half = self.axes @ (low + high) / 2, np.abs(self.axes) @ (high - low) / 2
        half += POINT_MARGIN * np.abs([low, high]).max()
        near = (self.high[others] >= middle - half).all(axis=1)
        near &= (self.low[others, :2] <= (middle + half)[:2]).all(axis=1)
        return ObjectList(self.table, others[near].tolist()).fold(ray, state, body)


def sunward_list(table: Table, to_sun: Sequence[float]) -> SunwardList:
    """All objects of the table as the sun sees them."""
    side = np.cross(to_sun, np.eye(3)[np.abs(to_sun).argmin()])
    side /= np.linalg.norm(side)
    axes, things = np.array([side, np.cross(to_sun, side), to_sun]), table.objects
    center = np.array([thing.center for thing in things]).reshape(-1, 3)
    half = np.array(
        [(thing.radius,) * 3 if isinstance(thing, Sphere) else np.abs([thing.half_u, thing.half_v] @ axes.T).sum(axis=0)
         for thing in things]
    ).reshape(-1, 3)  # fmt: skip
    half = half * (1 + SIZE_MARGIN) + POINT_MARGIN * np.abs(center).max(initial=0)
    return SunwardList(table, axes, center @ axes.T - half, center @ axes.T + half)


class KernelLists(NamedTuple):
    """On Dr.Jit each ray has a list of each kind's objects: of `number` k, `ids[first[k]:first[k + 1]]`. A loop within
    the kernel."""

    table: Table
    number: Any
    parts: tuple[tuple[type, Any, Any], ...]

    def fold(self, ray: Any, state: Any, body: Body, reach: MaxDistance = no_reach) -> Any:
        import drjit

        for kind, ids, first in self.parts:

            def step(place: Any, *state: Any, kind: type = kind, ids: Any = ids) -> Any:
                index = gather(ids, place)
                return (place + 1, *body(state, ray, index, self.table.object(kind, index)))

            place, end = gather(first, self.number), gather(first, self.number + 1)
            loop = drjit.while_loop((place, *state), lambda place, *_, end=end: place < end, step)
            state = tuple(loop[1:])
        return state


def kernel_lists(table: Table, engine: Engine, owner: np.ndarray, ids: np.ndarray, number: Any) -> KernelLists:
    """Object ids[i] is in the list of `owner[i]`, in ascending order; `number`: of each ray's list."""
    parts = []
    for kind in (Sphere, Rectangle):
        mine = np.array([isinstance(thing, kind) for thing in table.objects], bool)[ids]
        if mine.any():
            first = np.searchsorted(owner[mine], np.arange(owner[-1] + 2))
            padded = (np.append(a, (0, 0)) for a in (ids[mine], first))  # as in Table
            parts.append((kind, *(from_numpy(engine, a, whole=True) for a in padded)))
    return KernelLists(table, number, tuple(parts))


def same_list(table: Table, engine: Engine) -> ObjectList | KernelLists:
    """All objects for every ray, one after the other."""
    ids = np.arange(len(table.objects))
    if engine.is_numpy or table.few or not len(ids):
        return ObjectList(table, ids.tolist())
    return kernel_lists(table, engine, 0 * ids, ids, from_numpy(engine, np.zeros(1, int), whole=True))
