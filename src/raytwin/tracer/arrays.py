"""The few names that differ between NumPy and Dr.Jit; everything else in this folder is arithmetic that both share.

A number per pixel is a NumPy array or a Dr.Jit array; a vector is a tuple of three of them. To add an engine, add a row
to ENGINES: its array type must overload the usual operators.
"""

from typing import Any, NamedTuple

import numpy as np

from raytwin.errors import MachineError

Vec = tuple[Any, Any, Any]


class Engine(NamedTuple):
    """What computes: a `package` of arrays, and the `precision` of its floats."""

    package: str
    precision: str

    @property
    def is_numpy(self) -> bool:
        return self.package == "numpy"

    @property
    def float_type(self) -> Any:
        """The type that holds one float per pixel. Raises MachineError where the machine lacks the backend."""
        if self.is_numpy:
            return np.dtype(self.precision).type
        import drjit

        backend = {"llvm": drjit.JitBackend.LLVM, "cuda": drjit.JitBackend.CUDA}[self.package]
        if not drjit.has_backend(backend):
            raise MachineError("engine", f"a machine with {self.package} for Dr.Jit", "none (see `raytwin doctor`)")
        arrays = drjit.llvm if self.package == "llvm" else drjit.cuda
        return arrays.Float if self.precision == "float32" else arrays.Float64


ENGINES = {
    "numpy64": Engine("numpy", "float64"),
    "numpy32": Engine("numpy", "float32"),
    "drjit32": Engine("llvm", "float32"),
    "drjit64": Engine("llvm", "float64"),
    "cuda32": Engine("cuda", "float32"),
    "cuda64": Engine("cuda", "float64"),
}


def library(*values: Any) -> Any:
    """The array library that the values belong to: Dr.Jit if any of them is its, else NumPy."""
    if any(type(v).__module__.startswith("drjit") for v in values):
        import drjit

        return drjit
    return np


def sqrt(x: Any) -> Any:
    return library(x).sqrt(x)


def maximum(a: Any, b: Any) -> Any:
    return library(a, b).maximum(a, b)


def select(mask: Any, a: Any, b: Any) -> Any:
    """`a` where the mask holds, else `b`."""
    return np.where(mask, a, b) if (xp := library(mask, a, b)) is np else xp.select(mask, a, b)


def dot(a: Vec, b: Vec) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def pixel_grid(engine: Engine, box: tuple[int, int, int, int]) -> tuple[Any, Any]:
    """The centres (u, v) of the box's pixels, x0 <= u < x1, y0 <= v < y1, row by row."""
    x0, y0, x1, y1 = box
    kind = engine.float_type
    if engine.is_numpy:
        # A row and a column: NumPy broadcasts them, so what depends on u or v alone is computed once a line.
        return np.arange(x0, x1, dtype=kind)[None, :], np.arange(y0, y1, dtype=kind)[:, None]
    import drjit

    index = drjit.arange(drjit.uint32_array_t(kind), (x1 - x0) * (y1 - y0))
    # Opaque: the width is then data, and boxes of all sizes share one compiled kernel.
    width = drjit.opaque(type(index), x1 - x0)
    row = index // width
    return kind(index - row * width) + drjit.opaque(kind, x0), kind(row) + drjit.opaque(kind, y0)


def parameters(engine: Engine, value: Any) -> Any:
    """The numbers of nested tuples as the engine's: on Dr.Jit as data, so that a kernel outlives a change of scene."""
    if engine.is_numpy:
        return value
    if isinstance(value, tuple):
        return tuple(parameters(engine, v) for v in value)
    import drjit

    return drjit.opaque(engine.float_type, float(value))


def to_numpy(value: Any, shape: tuple[int, int], dtype: str = "float32") -> np.ndarray:
    """A number per pixel as a NumPy array (h, w)."""
    if library(value) is np:
        return np.broadcast_to(np.asarray(value, dtype), shape)
    array = value.numpy()
    return np.broadcast_to(array, shape[0] * shape[1]).reshape(shape).astype(dtype, copy=False)
