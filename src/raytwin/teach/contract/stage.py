"""What a stage of a tracer is: a function that students write, the calls that test it, the mistakes it is known for."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial, wraps
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.explain.catalogue import FAULTS
from raytwin.explain.predict import text_of
from raytwin.explain.textbook import Changes, tracer_with

Function = Callable[..., Any]
Arrays = tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Case:
    """One call: `args` in the stage's order, and the arrays `expected` of it. `shows`: in words, what it tries."""

    shows: str
    args: tuple[Any, ...]
    expected: Arrays


@dataclass(frozen=True)
class Variant:
    """A typical mistake: `make` returns the function that has it, `sentence` tells it to whoever made it.

    Several variants may share a `name`: the same mistake in other numbers. `sometimes`: it shows in some cases, and in
    others it is correct by chance.
    """

    name: str
    sentence: str
    make: Callable[[], Function]
    sometimes: bool = False


PARTS_OF = {"back_project": ("pixel", "undistort", "through")}
"""Functions of the contract that the textbook has in parts."""


def textbook_variants(function: str) -> tuple[Variant, ...]:
    """The catalogue's slips in a function, in its words."""
    parts = PARTS_OF.get(function, (function,))
    ways = [(fault, text_of(way)) for fault in FAULTS for way in (*fault.ways, *fault.alone)]
    return tuple(
        Variant(fault.name, fault.sentence, partial(wrong, function, text[1]))
        for fault, text in ways if text is not None and text[0] in parts and text[1]
    )  # fmt: skip


@lru_cache(maxsize=4096)
def wrong(function: str, slips: Changes) -> Function:
    """The textbook's function with these slips in it."""
    made: Function = getattr(tracer_with(changes=slips), function)
    return made


def read_faults(function: str) -> list[tuple[str, str, list[list[str]]]]:
    """The function's mistakes in stage_faults.tsv: name, sentence, and the fields of each way.

    A mistake's line is the functions that may have it, its name and its sentence. A way's line begins with a tab.
    """
    made: list[tuple[str, str, list[list[str]]]] = []
    for line in Path(__file__).with_name("stage_faults.tsv").read_text(encoding="utf-8").splitlines():
        functions, *fields = line.replace("\\n", "\n").split("\t")
        if functions:
            concerned = function in functions.split()
            made += [(fields[0], fields[1], [])] if concerned else []
        elif concerned:
            made[-1][2].append(fields)
    return made


def text_variants(function: Function, *form: str) -> tuple[Variant, ...]:
    """The file's mistakes in a function: what stands in its text, what the mistake makes of it, and so on.

    `form`: such changes that come before, for another correct form of the function.
    """
    return tuple(
        Variant(name, sentence, partial(_changed, function, *form, *way))
        for name, sentence, ways in read_faults(function.__name__) for way in ways
    )  # fmt: skip


@lru_cache(maxsize=256)
def _changed(function: Function, *changes: str) -> Function:
    text = inspect.getsource(function)
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        if text.count(old) != 1:
            raise ValueError(f"{function.__name__} has {old!r} {text.count(old)} times")
        text = text.replace(old, new)
    exec(text, space := dict(function.__globals__))
    made: Function = space[function.__name__]
    return made


def quiet(function: Function) -> Function:
    """The function without NumPy's warnings: rays that miss divide by 0."""

    @wraps(function)
    def called(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*arguments)

    return called


def shape_hint(right: tuple[int, ...], found: tuple[int, ...]) -> str:
    """What an array of another shape is likely to be.

    >>> shape_hint((13, 20, 3), (20, 13, 3)), shape_hint((24, 3), (24,))
    ('its axes are in another order', 'the last axis, of 3, is missing')
    """
    if found in ((), right[1:]):
        return "one for all is returned: one each is wanted"
    if found == right[:-1]:
        return f"the last axis, of {right[-1]}, is missing"
    if len(found) == 2 and found[0] == found[1] == right[0]:
        return "(N,) and (N, 1) were multiplied to (N, N): keep factors as (N, 1), and sum over the last axis only"
    if sorted(found) == sorted(right):
        return "its axes are in another order"
    if found[: len(right)] == right:
        return "one number each is wanted: take the last axis away"
    if prod(found) == prod(right):
        return "reshape it"
    return "only some are returned: one each is wanted" if prod(found) < prod(right) else ""


def unit(v: np.ndarray) -> np.ndarray:
    """Vectors along the last axis, made unit."""
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


@dataclass(frozen=True)
class Stage:
    """A function of the contract. Its name and parameters are those of `reference`, which does it correctly.

    `cases(seed)`: the calls. `errors(case, got)`: how far each value is off, in `unit`; at most `tolerance` passes,
    but for a share `outliers` of the values. `returns`: what its arrays are called. `columns`: (3, 1) does for (3,).
    `in_other_forms`: variants made of other correct functions, tried where none of them alone explains what is wrong.
    `by_values(cases, got)`: name and sentence of a mistake that the values themselves tell, as a mark of misses does.
    `tells(cases, got)`: numbers in words, said of what passes and of what no mistake explains.
    `judged_by`: the statistical test that decides beside the tolerance.
    `last(seed)`: calls that are made only once all others are correct: what is wrong there is one mistake by itself.
    `hints`: what another number of arrays, or shape of the first, is likely to be, where `shape_hint` says less.
    """

    reference: Function
    returns: tuple[str, ...]
    cases: Callable[[int], list[Case]]
    errors: Callable[[Case, Arrays], np.ndarray]
    tolerance: float
    unit: str
    variants: tuple[Variant, ...] = ()
    in_other_forms: tuple[Variant, ...] = ()
    outliers: float = 0.0
    columns: bool = False
    by_values: Callable[[Sequence[Case], Sequence[Arrays]], tuple[str, str] | None] = lambda cases, got: None
    tells: Callable[[Sequence[Case], Sequence[Arrays]], str] = lambda cases, got: ""
    judged_by: str = ""
    last: Callable[[int], list[Case]] = lambda seed: []
    hints: Mapping[Any, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.reference.__name__

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(inspect.signature(self.reference).parameters)

    @property
    def signature(self) -> str:
        """`back_project(K, dist, width, height)`."""
        return f"{self.name}({', '.join(self.parameters)})"

    def changes(self, arguments: Sequence[int]) -> str:
        """In words, that a function changed these of its arguments in place; empty for none, and for a scene's."""
        names = [self.parameters[k] for k in arguments if k < len(self.parameters) and self.parameters[k] != "scene"]
        said = ", ".join(f"`{name}`" for name in names)
        return f"it changes {said} in place: whatever calls it goes on with other values" if names else ""

    def misfit(self, function: Function) -> str:
        """The function with its own parameters, where it cannot be called with the stage's arguments; else empty."""
        try:
            signature = inspect.signature(function)
        except (TypeError, ValueError):  # compiled: it tells none
            return ""
        try:
            signature.bind(*self.parameters)
        except TypeError:
            return f"{getattr(function, '__name__', 'a function')}{signature}"
        return ""

    def hint(self, expected: Arrays, got: Arrays) -> str:
        """What another number of arrays, or another shape, is likely to be; empty where that says nothing."""
        if len(got) != len(expected):
            return self.hints.get(len(got), f"return {' and '.join(self.returns)} alone")
        return self.hints.get(got[0].shape) or shape_hint(expected[0].shape, got[0].shape)

    def worst(self, errors: np.ndarray) -> float:
        """The largest of `errors`, the outliers left out."""
        ordered = np.sort(errors, axis=None)
        return float(ordered[len(ordered) - 1 - int(self.outliers * len(ordered))])
