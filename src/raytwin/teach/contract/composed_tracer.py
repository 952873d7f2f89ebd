"""A whole tracer of functions: a submission's own where it has them, the textbook's for the rest."""

from collections.abc import Collection, Mapping
from types import SimpleNamespace

import numpy as np

from raytwin.explain.textbook import tracer_with
from raytwin.teach.contract.stage import Function, quiet

PARTS = ("back_project", "intersect_sphere", "shade")
"""The functions of the contract that a picture is made with."""

NEEDED = {"hit_points": PARTS[:2], "render": PARTS}
"""Names that are composed of a submission's parts if it has no function of that name."""


def compose(stages: Mapping[str, Function]) -> SimpleNamespace:
    """The textbook's tracer with these functions in the place of its own: `render(scene)` and `hit_points(scene)`."""
    made = tracer_with({name: _as_array(stages[name]) for name in PARTS if name in stages})
    return SimpleNamespace(render=quiet(made.render), hit_points=quiet(made.hit_points))


def _as_array(function: Function) -> Function:
    return lambda *args: np.asarray(function(*args), float)


def made_of(stages: Collection[str]) -> str:
    """In words, what `compose` makes: `render is made of its shade, the rest is ours`."""
    own = [name for name in PARTS if name in stages]
    return f"render is made of its {' and '.join(own)}, the rest is ours" if own else ""
