"""Checks annotated shapes, dtypes and types of ROOMS in the tests: CALLS calls of each function a test."""

import dataclasses
import functools
import inspect
import os
from collections.abc import Callable
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

CALLS = 5
"""Checks cost more than most functions do: all calls of a long test would take three times as long."""

# An int is a float here, as type checkers have it; nothing is left to chance.
checked = beartype(conf=BeartypeConf(is_pep484_tower=True, is_random=False))
# Not the records of scenes: msgspec checks them where they are read, and engines put their own floats in.
ROOMS = (
    "raytwin.images.image",
    "raytwin.rungs",
    *(f"raytwin.scene.{noun}" for noun in ("camera_frame", "lens", "validate")),
    "raytwin.tracer.lights",
    "raytwin.tracer",
    "raytwin.fast",
    "raytwin.compare",
)

_every_call = jaxtyping.jaxtyped
_test = 0
_foreign = False


def next_test(foreign: bool = False) -> None:
    """The first calls of each function are checked again, so that no test's outcome hangs on those before it.

    `foreign`: it makes records that no annotation allows, as a foreign file or a student may, to see them refused in
    words; nothing is checked.
    """
    global _test, _foreign
    _test, _foreign = _test + 1, foreign


def _first_calls(function: Any = None, *, typechecker: Callable) -> Any:
    """What the import hook decorates with, in place of jaxtyping's own."""
    if function is None:
        return functools.partial(_first_calls, typechecker=typechecker)
    if inspect.isclass(function):
        for maker in ("__init__",) if dataclasses.is_dataclass(function) else ("__new__",) if holds(function) else ():
            setattr(function, maker, _first_calls(getattr(function, maker), typechecker=typechecker))
        return function
    if not inspect.isfunction(function):
        return _every_call(function, typechecker=typechecker)
    if "<locals>" in function.__qualname__:
        # Made at each call of the one around it, whose arrays it has: its checks would be compiled each time.
        return function
    strict = _every_call(function, typechecker=typechecker)
    test = calls = 0

    @functools.wraps(function)
    def call(*args: Any, **named: Any) -> Any:
        nonlocal test, calls
        if test != _test:
            test, calls = _test, 0
        calls += 1
        return (strict if calls <= CALLS and not _foreign else function)(*args, **named)

    return call


def holds(kind: type) -> bool:
    """Whether it is a NamedTuple of arrays."""
    return hasattr(kind, "_fields") and "jaxtyping" in repr(kind.__annotations__)


jaxtyping.jaxtyped = _first_calls
jaxtyping.install_import_hook(list(ROOMS), "shape_checks.checked")

# For this process alone: those that tests start are as light as a user's.
os.environ["RAYTWIN_CHECK_SHAPES"] = "1"
import raytwin.array_types  # noqa: E402

del os.environ["RAYTWIN_CHECK_SHAPES"]
assert raytwin.array_types.Float32 is jaxtyping.Float32
