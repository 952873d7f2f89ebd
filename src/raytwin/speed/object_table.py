"""The objects as a table of numbers, from which a kernel looks one up.

On Dr.Jit the table is data: the kernel does not grow with the scene, and another scene needs no other kernel. A few
objects are parameters of the kernel instead, since looking numbers up costs more than trying each in turn.
"""

from functools import reduce
from typing import Any

import numpy as np

from raytwin.arrays import select
from raytwin.scene import Rectangle, Scene, Shape, Sphere
from raytwin.speed.engine import Engine, from_numpy, gather, to_engine
from raytwin.tracer.hit import NO_SPECULAR, Facts, Specular
from raytwin.tracer.world import facts_of

FEW = 6
"""On Dr.Jit, up to this number the objects of a scene are the kernel's parameters and need no lists."""
SHAPES: dict[type, tuple[str, ...]] = {Sphere: ("center", "radius"), Rectangle: ("center", "half_u", "half_v")}
"""What a shape is made of. To add a shape, add a row, and its numbers to FIELDS."""
FIELDS = {
    "center": 3, "radius": 1, "half_u": 3, "half_v": 3,
    "flat": 3, "curvature": 1, "albedo": 3, "share": 3, "exponent": 1,
}  # fmt: skip
"""The table's columns: how many numbers each of a shape's and of a surface's facts has."""


class Table:
    """One row per object: `objects` are the records, `columns` their numbers (n,), in the engine's floats.

    With `few` objects on Dr.Jit a column is a tuple of single numbers, and the records are made of them.
    """

    def __init__(self, scene: Scene, engine: Engine) -> None:
        self.objects, self.glossy = scene.objects, scene.glossy
        self.few = not engine.is_numpy and 0 < len(scene.objects) <= FEW
        # Two rows of nothing: Dr.Jit cannot look up in an empty array, and treats one of one number as that number.
        numbers = iter(np.array([*map(_row, scene.objects), *[(0.0,) * sum(FIELDS.values())] * 2]).T)
        self.columns = {name: [next(numbers) for _ in range(n)] for name, n in FIELDS.items()}
        for name, columns in self.columns.items():
            self.columns[name] = [
                to_engine(tuple(c[:-2].tolist()), engine) if self.few else from_numpy(engine, np.ascontiguousarray(c))
                for c in columns
            ]
        if self.few:
            self.objects = tuple(self.object(type(thing), i) for i, thing in enumerate(scene.objects))

    def of_kind(self, kind: type) -> np.ndarray:
        """(n,) bool: the objects of this kind."""
        return np.array([isinstance(thing, kind) for thing in self.objects], bool)

    def look_up(self, field: str, ids: Any, where: Any = True) -> Any:
        """The field's number, or tuple of numbers, for each of `ids`; anything where `where` is false."""
        find = _chosen if self.few else gather
        found = tuple(find(column, ids, where) for column in self.columns[field])
        return found if len(found) > 1 else found[0]

    def facts(self, ids: Any) -> Facts:
        """What the objects `ids` say of their surfaces; anything for -1."""
        fields = ("center", "flat", "curvature", "albedo", *(("share", "exponent") if self.glossy else ()))
        (*facts,) = (self.look_up(name, ids, ids >= 0) for name in fields)
        return Facts(*facts[:4], Specular(*facts[4:]) if self.glossy else None)

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
