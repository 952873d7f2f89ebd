"""The few names that differ between NumPy and Dr.Jit; lights, the tracer and its speed are arithmetic on these.

A number per pixel is a NumPy array or a Dr.Jit array; a vector is a tuple of three of them.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

Vec = tuple[Any, Any, Any]
INFINITY = float("inf")


def library(*values: Any) -> Any:
    """Return the array library of the values: Dr.Jit if any of them is its array, else NumPy."""
    for value in values:
        if type(value) is not np.ndarray and type(value).__module__.startswith("drjit"):
            import drjit

            return drjit
    return np


def sqrt(x: Any) -> Any:
    # A plain number stays one: NumPy would make it a float64 scalar, which promotes every float32 array it meets.
    return math.sqrt(x) if isinstance(x, int | float) else library(x).sqrt(x)


def cos(x: Any) -> Any:
    return library(x).cos(x)


def sin(x: Any) -> Any:
    return library(x).sin(x)


def maximum(a: Any, b: Any) -> Any:
    return library(a, b).maximum(a, b)


def minimum(a: Any, b: Any) -> Any:
    return library(a, b).minimum(a, b)


def power(x: Any, n: Any) -> Any:
    """xⁿ for x >= 0 and n > 0. Dr.Jit's is NaN in doubles near 2⁻¹⁰²³, so that what is below 2⁻¹⁰⁰⁰ is 2⁻¹⁰⁰⁰ there."""
    return x**n if (xp := library(x, n)) is np else xp.exp2(xp.maximum(xp.log2(x) * n, -1000))


def select(mask: Any, a: Any, b: Any) -> Any:
    """`a` where the mask is true, else `b`; of tuples, one by one."""
    if isinstance(a, tuple):
        return tuple(select(mask, x, y) for x, y in zip(a, b, strict=True))
    if isinstance(mask, bool | np.bool_):
        return a if mask else b
    return np.where(mask, a, b) if (xp := library(mask, a, b)) is np else xp.select(mask, a, b)


def where_any(mask: Any, compute: Callable[[], Any], like: Any, otherwise: float) -> Any:
    """compute() where the mask is true, else `otherwise`, in floats as `like`; Dr.Jit skips groups of rays without."""
    if (xp := library(mask)) is np:
        return select(mask, compute(), otherwise)
    return xp.if_stmt((), mask, compute, lambda: type(like)(otherwise))


def integers(like: Any, value: int) -> Any:
    """As many integers as `like` has numbers, all `value`."""
    if (xp := library(like)) is np:
        return np.full(np.shape(like), value)
    return xp.full(xp.int32_array_t(type(like)), value, xp.width(like))


def repeat(
    times: Any,
    body: Callable[..., tuple[Any, ...]],
    state: tuple[Any, ...],
    going: Callable[..., Any] = lambda *_: True,
) -> tuple[Any, ...]:
    """state = body(k, *state) for k = 0, 1, ... times - 1, while going(*state); on Dr.Jit a loop within the kernel."""
    if (xp := library(*state)) is np:
        for k in range(times):
            if np.any(going(*state)):
                state = body(k, *state)
        return state
    count = xp.uint32_array_t(type(state[0]))(0)
    looped = xp.while_loop((count, *state), lambda k, *s: (k < times) & going(*s), lambda k, *s: (k + 1, *body(k, *s)))
    return tuple(looped[1:])


def plus(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[Any, ...]:
    """a + b, one by one."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def dot(a: Vec, b: Vec) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec, b: Vec) -> Vec:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def cosine(normal: Vec, direction: Vec) -> Any:
    """max(0, n·l) of two unit vectors: 0 where the surface is turned away."""
    return maximum(dot(normal, direction), 0.0)


def rotate(rows: tuple[Vec, ...], v: Vec) -> Vec:
    """The matrix of these rows times v."""
    return (dot(rows[0], v), dot(rows[1], v), dot(rows[2], v))


def length(v: Vec) -> Any:
    return sqrt(dot(v, v))


def unit(v: Vec) -> Vec:
    """v / |v|."""
    size = length(v)
    return (v[0] / size, v[1] / size, v[2] / size)


def unit_again(v: Vec) -> Vec:
    """v (3 - v·v) / 2: one of Newton's steps, which makes a nearly unit vector unit to rounding.

    Without it the length's error, which is the normal's, grows by t/r from sphere to sphere along a path.
    """
    scale = 1.5 - 0.5 * dot(v, v)
    return v[0] * scale, v[1] * scale, v[2] * scale
