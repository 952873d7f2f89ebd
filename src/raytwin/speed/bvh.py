"""Many objects for rays from anywhere: a tree of boxes (BVH), most of which a ray misses with all that they contain.

The nodes are in depth-first order, and each says which node follows when its box is missed (Smits, "Efficiency Issues
for Ray Tracing", JGT 3(2), 1998): a loop without a stack, within Dr.Jit's kernel. NumPy tries one object after
the other: a tree there saved a quarter.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from raytwin.arrays import Vec, maximum, minimum, select
from raytwin.scene import Rectangle, Shape, Sphere
from raytwin.speed.engine import Engine, constant, from_numpy, gather
from raytwin.speed.fast_world import Body, MaxDistance, no_reach
from raytwin.speed.object_table import Table

FEW = 16
"""Objects of a scene up to which a tree is not faster than one after the other."""
MARGIN = 2e-6
"""How much larger a box is than its contents, as a share of the scene's extent: more than float32's rounding."""
FLAT = 1e-20
"""A smaller component of a ray's direction is replaced by this: its inverse must be finite."""


class Nodes(NamedTuple):
    """The 2n - 1 nodes of a binary tree over n objects, depth first. `low`, `high`: the box. `thing`: the object of a
    leaf, -1 for others. `onward`: the node that follows when the box is missed; when it is met, the next one does."""

    low: Vec
    high: Vec
    thing: Any
    onward: Any

    def box(self, place: Any) -> tuple[Vec, Vec]:
        (a, b, c), (d, e, f) = (tuple(gather(side, place) for side in corner) for corner in (self.low, self.high))
        return (a, b, c), (d, e, f)


def grow(low: np.ndarray, high: np.ndarray) -> Nodes:
    """Halve the objects, by their boxes' middles along the axis of their largest spread, until each is alone.

    `low`, `high`: (n, 3), n > 0. All nodes of a level at once.
    """
    n = len(low)
    middle, order = low + high, np.arange(n)  # twice the middle
    box, thing, onward = np.zeros((2, 2 * n - 1, 3)), np.full(2 * n - 1, -1), np.zeros(2 * n - 1, int)
    first, count, place = np.zeros(1, int), np.array([n]), np.zeros(1, int)
    while len(first):
        # A node's objects are order[first:first + count], its own index is `place`.
        here = np.repeat(np.arange(len(first)), count)
        at = np.arange(len(here)) - np.repeat(np.cumsum(count) - count, count) + first[here]
        starts = np.cumsum(count) - count
        least, most = (f.reduceat(middle[order[at]], starts) for f in (np.minimum, np.maximum))
        box[0, place] = np.minimum.reduceat(low[order[at]], starts)
        box[1, place] = np.maximum.reduceat(high[order[at]], starts)
        onward[place], alone = place + 2 * count - 1, count == 1
        thing[place[alone]] = order[first[alone]]
        along = (most - least).argmax(axis=1)[here]
        order[at] = order[at][np.lexsort((middle[order[at], along], here))]
        first, count, place = first[~alone], count[~alone], place[~alone]
        half = count // 2
        first, place = np.concatenate([first, first + half]), np.concatenate([place + 1, place + 2 * half])
        count = np.concatenate([half, count - half])
    return Nodes(tuple(box[0].T), tuple(box[1].T), thing, onward)


class KernelTree(NamedTuple):
    """Objects of one kind on Dr.Jit, where each ray goes from node to node."""

    table: Table
    kind: type
    nodes: Nodes
    end: Any

    def fold(self, ray: Any, state: Any, body: Body, reach: MaxDistance = no_reach) -> Any:
        import drjit

        nodes, inverse = self.nodes, inverted(ray.d)

        def step(place: Any, *state: Any) -> Any:
            near, far = through(*nodes.box(place), ray.origin, inverse)
            met, thing = (near <= far) & (near < reach(state)), gather(nodes.thing, place)

            def test(*state: Any) -> Any:
                return body(state, ray, thing, self.table.object(self.kind, thing))

            state = drjit.if_stmt(state, met & (thing >= 0), test, lambda *same: same)
            return (select(met, place + 1, gather(nodes.onward, place)), *state)

        place = drjit.zeros(type(self.end), drjit.width(ray.d[0]))
        return tuple(drjit.while_loop((place, *state), lambda place, *_: place < self.end, step)[1:])


class Trees(NamedTuple):
    """The tree of each kind after the other."""

    parts: tuple[KernelTree, ...]

    def fold(self, ray: Any, state: Any, body: Body, reach: MaxDistance = no_reach) -> Any:
        for part in self.parts:
            state = part.fold(ray, state, body, reach)
        return state


def trees(table: Table, engine: Engine) -> Trees:
    """All objects of the table, for rays from anywhere on Dr.Jit."""
    parts = []
    for kind in (Sphere, Rectangle):
        ids = np.array([i for i, thing in enumerate(table.objects) if isinstance(thing, kind)])
        if len(ids):
            nodes = grow(*corners([table.objects[i] for i in ids]))
            nodes = nodes._replace(thing=np.where(nodes.thing >= 0, ids[nodes.thing], -1))
            parts.append(KernelTree(table, kind, lifted(nodes, engine), constant(engine, len(nodes.thing))))
    return Trees(tuple(parts))


def corners(things: Sequence[Shape]) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest x, y, z (n, 3) of each, and a margin for float32's rounding."""
    reach = [(t.radius,) * 3 if isinstance(t, Sphere) else np.abs([t.half_u, t.half_v]).sum(axis=0) for t in things]
    center, half = np.array([thing.center for thing in things]), np.array(reach)
    half = half + MARGIN * (np.abs(center) + half).max()
    return center - half, center + half


def lifted(nodes: Nodes, engine: Engine) -> Nodes:
    """In the engine's numbers."""
    low, high = (tuple(from_numpy(engine, np.append(c, (0, 0))) for c in side) for side in (nodes.low, nodes.high))
    thing, onward = (from_numpy(engine, np.append(a, (0, 0)), whole=True) for a in nodes[2:])
    return Nodes((low[0], low[1], low[2]), (high[0], high[1], high[2]), thing, onward)


def inverted(d: Vec) -> Vec:
    x, y, z = (1 / select(abs(c) > FLAT, c, FLAT) for c in d)
    return x, y, z


def through(low: Vec, high: Vec, origin: Vec, inverse: Vec) -> tuple[Any, Any]:
    """(t where the ray enters the box, or 0; t where it leaves it): entered where the first is not the larger."""
    sides = [((a - o) * i, (b - o) * i) for a, b, o, i in zip(low, high, origin, inverse, strict=True)]
    (x, y, z), (u, v, w) = (tuple(order(a, b) for a, b in sides) for order in (minimum, maximum))
    return maximum(maximum(x, y), maximum(z, 0.0)), minimum(minimum(u, v), w)
