"""The tracer's World over fewer objects: what a ray cannot meet is left out.

`FastWorld` asks the tracer's two questions by folding over objects, state = body(state, ray, id, object). Three classes
say which objects: ObjectList, SunwardList (NumPy), KernelObjects (Dr.Jit).

On Dr.Jit the objects' numbers are a `Table`, which is data: the kernel does not grow with the scene, and another scene
needs no other kernel. A few objects are parameters of the kernel instead, since looking numbers up costs more than
trying each in turn.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from raytwin.fast.bvh import grow
from raytwin.fast.engine import Engine, from_numpy, gather, to_engine
from raytwin.scene import Rectangle, Scene, Shape, Sphere
from raytwin.tracer.arrays import INFINITY, Vec, integers, maximum, minimum, select
from raytwin.tracer.hit import NO_SPECULAR, Facts, Hit, Specular, Stages
from raytwin.tracer.world import distance, facts_of, hides

MAX_OBJECTS_AS_PARAMETERS = 6
"""On Dr.Jit, up to this number the objects of a scene are the kernel's parameters and need no lists."""
SHAPES: dict[type, tuple[str, ...]] = {Sphere: ("center", "radius"), Rectangle: ("center", "half_u", "half_v")}
"""What a shape is made of. To add a shape, add a row, and its numbers to FIELDS."""
FIELDS = {
    "center": 3, "radius": 1, "half_u": 3, "half_v": 3,
    "flat": 3, "curvature": 1, "albedo": 3, "share": 3, "exponent": 1,
}  # fmt: skip
HIGHLIGHT = ("share", "exponent")
"""The table's columns: how many numbers each of a shape's and of a surface's facts has."""
SIZE_MARGIN, POINT_MARGIN = 1e-4, 1e-6
"""How much larger a caster is taken to be, as shares of its size and of the largest coordinate: float32's rounding."""
FLAT = 1e-20
"""A smaller component of a ray's direction is replaced by this: its inverse must be finite."""


class Table:
    """One row per object: `objects` are the records, `columns` their numbers (n,), in the engine's floats.

    With `few` objects on Dr.Jit a column is a tuple of single numbers, and the records are made of them.
    """

    def __init__(self, scene: Scene, engine: Engine) -> None:
        self.objects, self.spheres, self.glossy = scene.objects, len(scene.spheres), scene.glossy
        self.few = not engine.is_numpy and 0 < len(scene.objects) <= MAX_OBJECTS_AS_PARAMETERS
        # Two rows of nothing: Dr.Jit cannot look up in an empty array, and treats one of one number as that number.
        numbers: Iterator[Any] = iter(np.array([*map(_row, scene.objects), *[(0.0,) * sum(FIELDS.values())] * 2]).T)
        if self.few:
            numbers = (to_engine(tuple(c[:-2].tolist()), engine) for c in numbers)
        else:
            numbers = (from_numpy(engine, np.ascontiguousarray(c)) for c in numbers)
        fields = FIELDS if self.glossy else {name: n for name, n in FIELDS.items() if name not in HIGHLIGHT}
        self.columns = {name: [next(numbers) for _ in range(n)] for name, n in fields.items()}
        if self.few:
            self.objects = tuple(self.object(type(thing), i) for i, thing in enumerate(scene.objects))

    def of_kind(self, kind: type) -> np.ndarray:
        """(n,) bool: the objects of this kind."""
        among: np.ndarray = np.arange(len(self.objects)) < self.spheres
        return among if kind is Sphere else ~among

    def look_up(self, field: str, ids: Any, where: Any = True) -> Any:
        """The field's number, or tuple of numbers, for each of `ids`; anything where `where` is false."""
        find = _chosen if self.few else gather
        found = tuple(find(column, ids, where) for column in self.columns[field])
        return found if len(found) > 1 else found[0]

    def facts(self, ids: Any) -> Facts:
        """What the objects `ids` say of their surfaces; anything for -1."""
        fields = ("center", "flat", "curvature", "albedo", *(HIGHLIGHT if self.glossy else ()))
        center, flat, curvature, albedo, *shine = (self.look_up(name, ids, ids >= 0) for name in fields)
        return Facts(center, flat, curvature, albedo, Specular(*shine) if shine else None)

    def object(self, kind: type, ids: Any) -> Shape:
        """A shape whose every number is an array: those of the objects `ids`."""
        thing: Shape = kind(*(self.look_up(name, ids) for name in SHAPES[kind]))
        return thing


def _chosen(numbers: Any, ids: Any, where: Any) -> Any:
    """numbers[ids] by comparisons, without a look-up."""
    if isinstance(ids, int):
        return numbers[ids]
    return reduce(lambda found, i: select(ids == i, numbers[i], found), reversed(range(len(numbers) - 1)), numbers[-1])


def _row(thing: Shape) -> tuple[float, ...]:
    facts, zero = facts_of(thing), (0.0, 0.0, 0.0)
    shape = getattr(thing, "radius", 0.0), *getattr(thing, "half_u", zero), *getattr(thing, "half_v", zero)
    share, exponent = facts.specular or NO_SPECULAR
    return (*facts.center, *shape, *facts.flat, facts.curvature, *facts.albedo, *share, exponent)


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
            return select(self.stages.nearer(t, state[0]), (t, index), state)

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
        seen = np.broadcast_to(ray.start.ids >= 0, np.shape(ray.origin[0]))
        if len(self.low) == (self.only is not None) or not seen.any():
            return state
        points = [c if seen.all() else c[seen] for c in ray.origin]
        low, high = (np.array([find(c) for c in points], float) for find in (np.min, np.max))
        middle, half = self.axes @ (low + high) / 2, np.abs(self.axes) @ (high - low) / 2
        half += POINT_MARGIN * np.abs([low, high]).max()
        near = (self.high >= middle - half).all(axis=1) & (self.low[:, :2] <= (middle + half)[:2]).all(axis=1)
        ids = [index for index in np.flatnonzero(near).tolist() if index != self.only]
        return ObjectList(self.table, ids).fold(ray, state, body)


def sunward_list(table: Table, to_sun: Sequence[float]) -> SunwardList:
    """All objects of the table as the sun sees them."""
    side = np.cross(to_sun, np.eye(3)[np.abs(to_sun).argmin()])
    side /= np.linalg.norm(side)
    axes = np.array([side, np.cross(to_sun, side), to_sun])
    center = np.array([thing.center for thing in table.objects]).reshape(-1, 3)
    half = np.array([thing.extent(axes) for thing in table.objects]).reshape(-1, 3)
    half = half * (1 + SIZE_MARGIN) + POINT_MARGIN * np.abs(center).max(initial=0)
    return SunwardList(table, axes, center @ axes.T - half, center @ axes.T + half)


class KernelObjects(NamedTuple):
    """On Dr.Jit each ray has its own sequences, one for each kind of object: a loop within the kernel.

    Of a ray's `number` k, `ids[first[k]:first[k + 1]]`. With `boxes` the sequence is a tree's nodes, see `fast.bvh`:
    low (3,), high (3,) and the node that follows when the box is missed; then an id is -1 where a node has no object.
    """

    table: Table
    number: Any
    parts: tuple[tuple[type, Any, Any, Any], ...]

    def fold(self, ray: Any, state: Any, body: Body, reach: MaxDistance = no_reach) -> Any:
        import drjit

        for kind, ids, first, boxes in self.parts:
            inverse = inverted(ray.d) if boxes else None

            def step(
                place: Any, *state: Any, kind: type = kind, ids: Any = ids, boxes: Any = boxes, inverse: Any = inverse
            ) -> Any:
                index = gather(ids, place)

                def test(*state: Any) -> Any:
                    return body(state, ray, index, self.table.object(kind, index))

                if boxes is None:
                    return (place + 1, *test(*state))
                low, high = (tuple(gather(side, place) for side in corner) for corner in boxes[:2])
                near, far = through(low, high, ray.origin, inverse)
                met = (near <= far) & (near < reach(state))
                state = drjit.if_stmt(state, met & (index >= 0), test, lambda *same: same)
                return (select(met, place + 1, gather(boxes[2], place)), *state)

            place, end = gather(first, self.number), gather(first, self.number + 1)
            loop = drjit.while_loop((place, *state), lambda place, *_, end=end: place < end, step)
            state = tuple(loop[1:])
        return state


def kernel_lists(table: Table, engine: Engine, owner: np.ndarray, ids: np.ndarray, number: Any) -> KernelObjects:
    """Object ids[i] is in the list of `owner[i]`, in ascending order; `number`: of each ray's list."""
    parts = []
    for kind in SHAPES:
        mine = table.of_kind(kind)[ids]
        if mine.any():
            first = np.searchsorted(owner[mine], np.arange(owner[-1] + 2))
            parts.append((kind, *(padded(engine, a, whole=True) for a in (ids[mine], first)), None))
    return KernelObjects(table, number, tuple(parts))


def kernel_trees(table: Table, engine: Engine) -> KernelObjects:
    """All objects of the table, for rays from anywhere."""
    parts = []
    for kind in SHAPES:
        ids = np.flatnonzero(table.of_kind(kind))
        if len(ids):
            things = [table.objects[i] for i in ids]
            nodes = grow(np.array([t.center for t in things]), np.array([t.extent(np.eye(3)) for t in things]))
            first, held = np.array((0, len(nodes.thing))), np.where(nodes.thing >= 0, ids[nodes.thing], -1)
            low, high = (tuple(padded(engine, c) for c in corner.T) for corner in (nodes.low, nodes.high))
            held, first, onward = (padded(engine, a, whole=True) for a in (held, first, nodes.onward))
            parts.append((kind, held, first, (low, high, onward)))
    return KernelObjects(table, from_numpy(engine, np.zeros(1, int), whole=True), tuple(parts))


def same_list(table: Table, engine: Engine) -> ObjectList | KernelObjects:
    """All objects for every ray, one after the other."""
    ids = np.arange(len(table.objects))
    if engine.is_numpy or table.few or not len(ids):
        return ObjectList(table, ids.tolist())
    return kernel_lists(table, engine, 0 * ids, ids, from_numpy(engine, np.zeros(1, int), whole=True))


def padded(engine: Engine, values: np.ndarray, whole: bool = False) -> Any:
    """In the engine's numbers, with two more: Dr.Jit treats an array of one number as that number."""
    return from_numpy(engine, np.append(values, (0, 0)), whole)


def inverted(d: Vec) -> Vec:
    x, y, z = (1 / select(abs(c) > FLAT, c, FLAT) for c in d)
    return x, y, z


def through(low: Vec, high: Vec, origin: Vec, inverse: Vec) -> tuple[Any, Any]:
    """(t where the ray enters the box, or 0; t where it leaves it): entered where the first is not the larger."""
    sides = [((a - o) * i, (b - o) * i) for a, b, o, i in zip(low, high, origin, inverse, strict=True)]
    (x, y, z), (u, v, w) = (tuple(order(a, b) for a, b in sides) for order in (minimum, maximum))
    return maximum(maximum(x, y), maximum(z, 0.0)), minimum(minimum(u, v), w)
