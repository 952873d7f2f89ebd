"""Checks annotated shapes, dtypes and types of tracer and speed in the tests: CALLS calls of each function a test."""

import functools
import inspect
import os
from collections.abc import Callable
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

CALLS = 20
"""Checks cost more than most functions do: all calls of a long test would take three times as long."""

# An int is a float here, as type checkers have it.
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
# Not records: a scene's are checked by msgspec where they are read, and engines put their own floats in; an Image may
# hold whatever a foreign file or a test hands over, which the comparison must tell in words.
ROOMS = ("raytwin.rungs", "raytwin.tracer", "raytwin.speed")

_every_call = jaxtyping.jaxtyped
_test = 0


def next_test() -> None:
    """The first calls of each function are checked again, so that no test's outcome hangs on those before it."""
    global _test
    _test += 1


def _first_calls(function: Any = None, *, typechecker: Callable) -> Any:
    """What the import hook decorates with, in place of jaxtyping's own."""
    if function is None:
        return functools.partial(_first_calls, typechecker=typechecker)
    if "<locals>" in getattr(function, "__qualname__", ""):
        # Made at each call of the one around it, whose arrays it has: its checks would be compiled each time.
        return function
    strict = _every_call(function, typechecker=typechecker)
    if not inspect.isfunction(function):
        return strict
    test = calls = 0

    @functools.wraps(function)
    def call(*args: Any, **named: Any) -> Any:
        nonlocal test, calls
        if test != _test:
            test, calls = _test, 0
        calls += 1
        return (strict if calls <= CALLS else function)(*args, **named)

    return call


jaxtyping.jaxtyped = _first_calls
jaxtyping.install_import_hook(list(ROOMS), "shape_checks.checked")

# For this process alone: those that tests start are as light as a user's.
os.environ["RAYTWIN_CHECK_SHAPES"] = "1"
import raytwin.shapes  # noqa: E402

del os.environ["RAYTWIN_CHECK_SHAPES"]
assert raytwin.shapes.Float32 is jaxtyping.Float32
