"""The tracer's World with fewer tests: objects that a ray cannot meet are left out.

NumPy tries one object after the other, but only those whose boxes touch a tile, and towards the sun those that stand
near the way. Dr.Jit tries all of a few objects, whose numbers are the kernel's parameters; many are in trees, whose
numbers are data. Either kernel serves another scene too.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from raytwin.fast.bvh import Nodes, grow
from raytwin.fast.engine import Engine, from_numpy, gather, to_engine
from raytwin.scene import Rectangle, Scene, Shape, Sphere
from raytwin.scene.record_base import unchecked
from raytwin.tracer.arrays import INFINITY, Vec, integers, maximum, minimum, select
from raytwin.tracer.hit import Facts, Hit, Stages
from raytwin.tracer.world import distance, facts_in, facts_row, hides

MAX_OBJECTS_WITHOUT_TREE = 16
"""Objects of a scene that Dr.Jit's rays try one after the other; with more, its kernels take seconds to compile."""
SHAPES: dict[type, tuple[str, ...]] = {Sphere: ("center", "radius"), Rectangle: ("center", "half_u", "half_v")}
"""What a shape is made of. To add a shape, add a row."""
SIZE_MARGIN, POINT_MARGIN = 1e-4, 1e-6
"""How much larger an object is taken to be, as shares of its size and of the largest coordinate: float32's rounding."""
FLAT = 1e-20
"""A smaller component of a ray's direction is replaced by this: its inverse must be finite."""

Body = Callable[..., Any]
"""(state, index, object) -> state."""


class Tree(NamedTuple):
    """Objects like `thing` in the `nodes` of `fast.bvh`, and for each leaf the numbers of its object's `shape`."""

    thing: Shape
    nodes: Nodes
    shape: tuple[Any, ...]

    def fold(self, origin: Vec, d: Vec, state: tuple[Any, ...], body: Body, reach: Callable[..., Any]) -> Any:
        """state = body(state, index, object) for each object whose box the ray meets before reach(*state)."""
        import drjit

        inverse = tuple(1 / select(abs(c) > FLAT, c, FLAT) for c in d)
        fields = SHAPES[type(self.thing)]

        def step(place: Any, *state: Any) -> Any:
            near, far = through(gather(self.nodes.low, place), gather(self.nodes.high, place), origin, inverse)
            met, index = (near <= far) & (near < reach(*state)), gather(self.nodes.thing, place)

            def test(*state: Any) -> Any:
                numbers = dict(zip(fields, gather(self.shape, place), strict=True))
                return body(state, index, unchecked(self.thing, **numbers))

            state = drjit.if_stmt(state, met & (index >= 0), test, lambda *same: same)
            return (select(met, place + 1, gather(self.nodes.onward, place)), *state)

        end = gather(self.nodes.onward, 0)
        looped = drjit.while_loop((drjit.zeros(type(end)), *state), lambda place, *_: place < end, step)
        return tuple(looped[1:])


def grow_tree(ids: Sequence[int], objects: Sequence[Shape], engine: Engine, every: bool) -> Tree:
    """Return the tree of the objects `ids`, all of one kind; with `every`, its boxes hold all of space."""
    things = [objects[i] for i in ids]
    nodes = grow(np.array([t.center for t in things]), np.array([t.extent(np.eye(3)) for t in things]))
    low, high = (np.full_like(c, s * INFINITY) if every else c for s, c in ((-1, nodes.low), (1, nodes.high)))
    shape = (np.array([getattr(t, field) for t in things])[nodes.thing] for field in SHAPES[type(things[0])])
    index = np.where(nodes.thing >= 0, np.array(ids)[nodes.thing], -1)
    lifted = Nodes(*(columns(engine, part) for part in (low, high, index, nodes.onward)))
    return Tree(things[0], lifted, tuple(columns(engine, part) for part in shape))


def columns(engine: Engine, values: np.ndarray) -> Any:
    """Return a table (n, k) as a tuple of k columns, and (n,) as one, in the engine's numbers."""
    # Two more rows: Dr.Jit cannot look up in an empty array, and treats an array of one number as that number.
    padded = np.concatenate([values, np.zeros((2, *values.shape[1:]), values.dtype)])
    found = tuple(from_numpy(engine, column, values.dtype.kind == "i") for column in padded.reshape(len(padded), -1).T)
    return found if values.ndim == 2 else found[0]


class Objects:
    """The objects of a scene in an engine's floats, and how rays find them; `every`: each ray tries each object."""

    def __init__(self, scene: Scene, engine: Engine, every: bool = False) -> None:
        self.every, self.numpy = every, engine.is_numpy
        self.glossy, self.number = scene.glossy, len(scene.objects)
        few = not engine.is_numpy and 0 < self.number <= MAX_OBJECTS_WITHOUT_TREE
        rows = np.array([facts_row(t) for t in scene.objects]).reshape(-1, 14)
        one_by_one = few or engine.is_numpy
        self.objects = to_engine(scene.objects, engine) if one_by_one else scene.objects
        # Of a few objects each number is one of the kernel's parameters.
        self.rows = tuple([to_engine(x, engine) for x in c] for c in rows.T.tolist()) if few else columns(engine, rows)
        spheres, planes = range(len(scene.spheres)), range(len(scene.spheres), self.number)
        kinds = () if one_by_one else (spheres, planes)
        self.trees = [grow_tree(ids, scene.objects, engine, every) for ids in kinds if ids]
        self.center = np.array([thing.center for thing in scene.objects]).reshape(-1, 3)
        self.size = (1 + SIZE_MARGIN) * np.array([np.hypot.reduce(thing.sizes) for thing in scene.objects])

    def towards(self, start: Hit, d: Vec) -> Sequence[int]:
        """The objects that may stand beside the surfaces `start` in the one direction d (NumPy); without their own."""
        seen = np.broadcast_to(start.ids >= 0, np.shape(start.point[0]))
        own = start.ids.max()
        alone = (~seen | (start.ids == own)).all()
        if not seen.any() or (alone and self.number == 1):
            return ()
        points = [c if seen.all() else c[seen] for c in start.point]
        low, high = (np.array([find(c) for c in points], float) for find in (np.min, np.max))
        to = self.center - (low + high) / 2
        margin = POINT_MARGIN * max(np.abs(self.center).max(), np.abs(low).max(), np.abs(high).max())
        size, along = self.size + np.linalg.norm(high - low) / 2 + margin, to @ d
        near = (np.linalg.norm(to - along[:, None] * d, axis=1) <= size) & (along >= -size)
        near[own] &= not alone
        return np.flatnonzero(near).tolist()


class FastWorld(NamedTuple):
    """A `tracer.World` whose rays from the eye meet none but the objects `seen`."""

    objects: Objects
    stages: Stages
    seen: Sequence[int]

    def closest_hit(self, origin: Vec, d: Vec, start: Hit | None = None) -> tuple[Any, Any]:
        def closer(state: Any, index: Any, thing: Any) -> Any:
            t = distance(origin, d, thing, index, start, self.stages)
            return select(self.stages.nearer(t, state[0]), (t, index), state)

        nothing = 0 * d[0] + INFINITY, integers(d[0], -1)
        ids = self.seen if start is None else range(self.objects.number)
        t, ids = self._fold(ids, origin, d, nothing, closer, lambda t, ids: t)
        return t, ids

    def blocked(self, start: Hit, d: Vec) -> Any:
        def block(state: Any, index: Any, thing: Any) -> Any:
            return (state[0] | hides(start, d, thing, index, self.stages),)

        def reach(found: Any) -> Any:
            return select(found, 0.0, INFINITY)

        parallel = isinstance(d[0], float) and self.objects.numpy and not self.objects.every
        ids = self.objects.towards(start, d) if parallel else range(self.objects.number)
        return self._fold(ids, start.point, d, (start.inside,), block, reach)[0]

    def facts(self, ids: Any) -> Facts:
        return facts_in(gather(self.objects.rows, ids, ids >= 0), self.objects.glossy)

    def _fold(self, ids: Sequence[int], origin: Vec, d: Vec, state: Any, body: Body, reach: Body) -> Any:
        for tree in self.objects.trees:
            state = tree.fold(origin, d, state, body, reach)
        for index in () if self.objects.trees else ids:
            state = body(state, index, self.objects.objects[index])
        return state


def through(low: Vec, high: Vec, origin: Vec, inverse: Vec) -> tuple[Any, Any]:
    """(t where the ray enters the box, or 0; t where it leaves it): entered where the first is not the larger."""
    sides = [((a - o) * i, (b - o) * i) for a, b, o, i in zip(low, high, origin, inverse, strict=True)]
    (x, y, z), (u, v, w) = (tuple(order(a, b) for a, b in sides) for order in (minimum, maximum))
    return maximum(maximum(x, y), maximum(z, 0.0)), minimum(minimum(u, v), w)
