"""The objects as a table of numbers, from which a kernel looks one up.

On Dr.Jit the table is data: the kernel does not grow with the scene, and another scene needs no other kernel. A few
objects are parameters of the kernel instead, since looking numbers up costs more than trying each in turn.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from raytwin.arrays import select
from raytwin.scene import Rectangle, Scene, Shape, Sphere
from raytwin.speed.engine import Engine, from_numpy, gather, to_engine
from raytwin.tracer.hit import NO_SPECULAR, Facts, Specular
from raytwin.tracer.world import facts_of

FEW = 6
"""On Dr.Jit, up to this number the objects of a scene are the kernel's parameters and need no lists."""
FIELDS = {"center": 3, "radius": 1, "half_u": 3, "half_v": 3, "albedo": 3, "flat": 3, "curvature": 1}
HIGHLIGHT = {"share": 3, "exponent": 1}
"""The table's fields and how many numbers each has; HIGHLIGHT only in scenes where an object has one."""


class Table:
    """One row per object: `objects` are the records, `columns` their numbers (n,), in the engine's floats.

    With `few` objects on Dr.Jit a column is a tuple of single numbers, and the records are made of them.
    """

    def __init__(self, scene: Scene, engine: Engine) -> None:
        self.objects, self.kinds = scene.objects, {type(thing) for thing in scene.objects}
        self.glossy = scene.glossy
        fields = FIELDS | (HIGHLIGHT if self.glossy else {})
        # Two rows of nothing: Dr.Jit cannot look up in an empty array, and treats one of one number as that number.
        rows = [*(_row(thing, self.glossy) for thing in scene.objects), *[(0.0,) * sum(fields.values())] * 2]
        self.few = not engine.is_numpy and 0 < len(scene.objects) <= FEW
        columns: Iterator[Any] = iter(np.array(rows, float).T)
        if self.few:
            columns = (to_engine(tuple(c[:-2].tolist()), engine) for c in columns)
        else:
            columns = (from_numpy(engine, np.ascontiguousarray(c)) for c in columns)
        self.columns = {name: tuple(next(columns) for _ in range(n)) for name, n in fields.items()}
        if self.few:
            self.objects = tuple(self.object(type(thing), i) for i, thing in enumerate(scene.objects))

    def look_up(self, field: str, ids: Any, where: Any = True) -> tuple[Any, ...]:
        """The field's numbers for each of `ids`; anything where `where` is false."""
        if self.few:
            return tuple(_chosen(column, ids) for column in self.columns[field])
        return tuple(gather(column, ids, where) for column in self.columns[field])

    def facts(self, ids: Any) -> Facts:
        """What the objects `ids` say of their surfaces; anything for -1."""
        center, flat, curvature, albedo = (
            self.look_up(name, ids, ids >= 0) for name in ("center", "flat", "curvature", "albedo")
        )
        if not self.glossy:
            return Facts(center, flat, curvature[0], albedo)
        share, exponent = (self.look_up(name, ids, ids >= 0) for name in HIGHLIGHT)
        return Facts(center, flat, curvature[0], albedo, Specular(share, exponent[0]))

    def object(self, kind: type, ids: Any) -> Shape:
        """A sphere or a rectangle whose every number is an array: those of the objects `ids`."""
        if kind is Sphere:
            return Sphere(self.look_up("center", ids), *self.look_up("radius", ids))
        return Rectangle(self.look_up("center", ids), self.look_up("half_u", ids), self.look_up("half_v", ids))


def _chosen(numbers: Sequence[Any], ids: Any) -> Any:
    """numbers[ids] by comparisons, without a look-up."""
    if isinstance(ids, int):
        return numbers[ids]
    found = numbers[-1]
    for index in reversed(range(len(numbers) - 1)):
        found = select(ids == index, numbers[index], found)
    return found


def _row(thing: Shape, glossy: bool) -> tuple[float, ...]:
    facts, zero = facts_of(thing), (0.0, 0.0, 0.0)
    shape = (thing.radius, *zero, *zero) if isinstance(thing, Sphere) else (0.0, *thing.half_u, *thing.half_v)
    share, exponent = facts.specular or NO_SPECULAR
    highlight = (*share, exponent) if glossy else ()
    return (*facts.center, *shape, *facts.albedo, *facts.flat, facts.curvature, *highlight)
