"""The tracer's World over fewer objects: what a ray cannot meet is left out.

`FastWorld` asks the tracer's two questions by folding over objects, state = body(state, ray, id, object). Four classes
say which objects: ObjectList and TileLists here, NumpyTree and KernelTree in `speed.bvh`.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from raytwin.arrays import INFINITY, Vec, integers, select
from raytwin.scene import Rectangle, Sphere
from raytwin.speed.engine import Engine, from_numpy, gather
from raytwin.speed.object_table import Table
from raytwin.speed.tile_lists import Lists, one_list
from raytwin.tracer.hit import Facts, Hit, Stages
from raytwin.tracer.world import distance, hides


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


class TileLists(NamedTuple):
    """On Dr.Jit each ray has its own list: of `number` k, `flat[first[k]:last[k]]`, where rectangles begin at
    `middle[k]`. A loop within the kernel."""

    table: Table
    number: Any
    flat: Any
    first: Any
    middle: Any
    last: Any

    def fold(self, ray: Any, state: Any, body: Body, reach: MaxDistance = no_reach) -> Any:
        for kind, start, stop in ((Sphere, self.first, self.middle), (Rectangle, self.middle, self.last)):
            if kind in self.table.kinds:
                state = self._loop(kind, start, stop, ray, state, body)
        return state

    def _loop(self, kind: type, start: Any, stop: Any, ray: Any, state: Any, body: Body) -> Any:
        import drjit

        start, stop = gather(start, self.number), gather(stop, self.number)

        def step(place: Any, *state: Any) -> Any:
            index = gather(self.flat, place)
            return (place + 1, *body(state, ray, index, self.table.object(kind, index)))

        _, *state_after = drjit.while_loop((start, *state), lambda place, *state: place < stop, step)
        return tuple(state_after)


def tile_lists(table: Table, engine: Engine, lists: Lists, tiles: np.ndarray, number: Any) -> TileLists | ObjectList:
    """On Dr.Jit, for each ray the list of the tile `tiles[number]`; or all objects, where they are few."""
    if table.few:
        return ObjectList(table, range(len(table.objects)))
    ends = (from_numpy(engine, end[tiles], whole=True) for end in lists[1:])
    flat = from_numpy(engine, np.append(lists.flat, (0, 0)), whole=True)  # as in Table
    return TileLists(table, number, flat, *ends)


def same_list(table: Table, engine: Engine, ids: Sequence[int]) -> TileLists | ObjectList:
    """The same objects for every ray, on any engine."""
    if engine.is_numpy or table.few:
        return ObjectList(table, ids)
    is_flat = np.array([not isinstance(table.objects[i], Sphere) for i in ids], bool)
    one = one_list(2, is_flat)
    zero = from_numpy(engine, np.zeros(1, int), whole=True)
    return tile_lists(table, engine, one._replace(flat=np.array(ids, int)[one.flat]), np.zeros(2, int), zero)
