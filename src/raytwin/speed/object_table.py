"""What each ray is tested against: short lists, found beforehand, in the place of all objects.

NumPy, where all rays of a tile share one list, loops over it in Python. On Dr.Jit each ray walks its tile's list in a
loop within the kernel: it does not grow with the scene, and another scene needs no other kernel. Few objects are tried
one after the other there, too: their numbers are a kernel's parameters, and looking numbers up costs more.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from raytwin.arrays import INFINITY, select
from raytwin.scene import Rectangle, Scene, Shape, Sphere
from raytwin.speed.engine import Engine, from_numpy, gather, lift
from raytwin.speed.tile_lists import Lists, one_list
from raytwin.tracer.hit import NO_GLOSS, Body, Facts, Gloss, Ray, Reach, facts_of

FEW = 6
"""Objects of a scene that need no lists on Dr.Jit."""
FIELDS = {"center": 3, "radius": 1, "half_u": 3, "half_v": 3, "albedo": 3, "flat": 3, "bend": 1}
GLOSS = {"specular": 3, "exponent": 1}
"""The table's fields and how many numbers each has; GLOSS only where an object has a highlight."""


class Table:
    """One row an object: `objects` are the records, `columns` their numbers (n,), in the engine's floats.

    Of `few` objects on Dr.Jit a column is a tuple of single numbers, of which `objects` are made.
    """

    def __init__(self, scene: Scene, engine: Engine) -> None:
        self.objects, self.kinds = scene.objects, {type(thing) for thing in scene.objects}
        self.glossy = scene.glossy
        fields = FIELDS | (GLOSS if self.glossy else {})
        # Two rows of nothing: Dr.Jit cannot look up in an empty array, and treats one of one number as that number.
        rows = [*(_row(thing, self.glossy) for thing in scene.objects), *[(0.0,) * sum(fields.values())] * 2]
        self.few = not engine.is_numpy and 0 < len(scene.objects) <= FEW
        columns: Iterator[Any] = iter(np.array(rows, float).T)
        if self.few:
            columns = (lift(tuple(c[:-2].tolist()), engine) for c in columns)
        else:
            columns = (from_numpy(engine, np.ascontiguousarray(c)) for c in columns)
        self.columns = {name: tuple(next(columns) for _ in range(n)) for name, n in fields.items()}
        if self.few:
            self.objects = tuple(self.object(type(thing), i) for i, thing in enumerate(scene.objects))

    def look_up(self, field: str, ids: Any, where: Any = True) -> tuple[Any, ...]:
        """The field's numbers for each of `ids`; anything where `where` does not hold."""
        if self.few:
            return tuple(_chosen(column, ids) for column in self.columns[field])
        return tuple(gather(column, ids, where) for column in self.columns[field])

    def facts(self, ids: Any) -> Facts:
        center, flat, bend, albedo = (
            self.look_up(name, ids, ids >= 0) for name in ("center", "flat", "bend", "albedo")
        )
        if not self.glossy:
            return Facts(center, flat, bend[0], albedo)
        specular, exponent = (self.look_up(name, ids, ids >= 0) for name in GLOSS)
        return Facts(center, flat, bend[0], albedo, Gloss(specular, exponent[0]))

    def object(self, kind: type, ids: Any) -> Shape:
        """A sphere or a rectangle, each of whose numbers are those of `ids`."""
        if kind is Sphere:
            return Sphere(self.look_up("center", ids), *self.look_up("radius", ids))
        return Rectangle(self.look_up("center", ids), self.look_up("half_u", ids), self.look_up("half_v", ids))


def _chosen(numbers: Sequence[Any], ids: Any) -> Any:
    """numbers[ids], without looking up."""
    if isinstance(ids, int):
        return numbers[ids]
    found = numbers[-1]
    for index in reversed(range(len(numbers) - 1)):
        found = select(ids == index, numbers[index], found)
    return found


def _row(thing: Shape, glossy: bool) -> tuple[float, ...]:
    facts, zero = facts_of(thing), (0.0, 0.0, 0.0)
    shape = (thing.radius, *zero, *zero) if isinstance(thing, Sphere) else (0.0, *thing.half_u, *thing.half_v)
    specular, exponent = facts.gloss or NO_GLOSS
    return (*facts.center, *shape, *facts.albedo, *facts.flat, facts.bend, *((*specular, exponent) if glossy else ()))


class Listed(NamedTuple):
    """The same objects for every ray: their ids, in order."""

    table: Table
    ids: Sequence[int]

    def fold(self, ray: Ray | None, state: Any, body: Body, reach: Reach = lambda state: INFINITY) -> Any:
        for index in self.ids:
            state = body(state, ray, index, self.table.objects[index])
        return state

    def facts(self, ids: Any) -> Facts:
        return self.table.facts(ids)


class Walked(NamedTuple):
    """To each ray its own list: of `number` k, `flat[first[k]:last[k]]`, where rectangles begin at `middle[k]`."""

    table: Table
    number: Any
    flat: Any
    first: Any
    middle: Any
    last: Any

    def fold(self, ray: Ray | None, state: Any, body: Body, reach: Reach = lambda state: INFINITY) -> Any:
        for kind, start, stop in ((Sphere, self.first, self.middle), (Rectangle, self.middle, self.last)):
            if kind in self.table.kinds:
                state = self._walk(kind, start, stop, ray, state, body)
        return state

    def facts(self, ids: Any) -> Facts:
        return self.table.facts(ids)

    def _walk(self, kind: type, start: Any, stop: Any, ray: Ray | None, state: Any, body: Body) -> Any:
        import drjit

        start, stop = gather(start, self.number), gather(stop, self.number)

        def step(place: Any, *state: Any) -> Any:
            index = gather(self.flat, place)
            return (place + 1, *body(state, ray, index, self.table.object(kind, index)))

        _, *state_after = drjit.while_loop((start, *state), lambda place, *state: place < stop, step)
        return tuple(state_after)


def walk(table: Table, engine: Engine, lists: Lists, tiles: np.ndarray, number: Any) -> Walked | Listed:
    """For each ray, on Dr.Jit, the list of the tile `tiles[number]`; or all objects, where they are few."""
    if table.few:
        return Listed(table, range(len(table.objects)))
    ends = (from_numpy(engine, end[tiles], whole=True) for end in lists[1:])
    flat = from_numpy(engine, np.append(lists.flat, (0, 0)), whole=True)  # as in Table
    return Walked(table, number, flat, *ends)


def walk_some(table: Table, engine: Engine, ids: Sequence[int]) -> Walked | Listed:
    """The same objects for every ray, on Dr.Jit."""
    if table.few:
        return Listed(table, ids)
    is_flat = np.array([not isinstance(table.objects[i], Sphere) for i in ids], bool)
    one = one_list(2, is_flat)
    zero = from_numpy(engine, np.zeros(1, int), whole=True)
    return walk(table, engine, one._replace(flat=np.array(ids, int)[one.flat]), np.zeros(2, int), zero)
