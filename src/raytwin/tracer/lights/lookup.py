"""How a ray reads a table, on NumPy and on Dr.Jit: which row, and the number there."""

from typing import Any

import numpy as np

from raytwin.tracer.arrays import library


def arctan2(y: Any, x: Any) -> Any:
    return np.arctan2(y, x) if (xp := library(y, x)) is np else xp.atan2(y, x)


def floor(x: Any) -> Any:
    """The integer at or below each number."""
    return np.floor(x).astype(np.int32) if (xp := library(x)) is np else xp.int32_array_t(type(x))(xp.floor(x))


def as_floats(like: Any, integers: Any) -> Any:
    """The integers as floats of `like`'s precision."""
    return integers.astype(like.dtype) if library(like) is np else type(like)(integers)


def take(numbers: Any, index: Any) -> Any:
    """numbers[index]."""
    if (xp := library(numbers)) is np:
        return np.take(numbers, index)
    return xp.gather(type(numbers), numbers, xp.uint32_array_t(type(index))(index))
