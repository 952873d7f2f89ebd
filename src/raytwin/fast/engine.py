"""Engines: NumPy or Dr.Jit, each in two precisions. Moves pixels and scenes into their arrays and back."""

import os
import sys
from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct, structs

from raytwin.errors import MachineError
from raytwin.scene.record_base import unchecked
from raytwin.tracer.arrays import library, select


class Engine(NamedTuple):
    """An array `package`, and the `precision` of its floats."""

    package: str
    precision: str

    @property
    def title(self) -> str:
        """The package as people call it."""
        return "drjit" if self.package == "llvm" else self.package

    @property
    def bits(self) -> int:
        return np.dtype(self.precision).itemsize * 8

    @property
    def is_numpy(self) -> bool:
        return self.package == "numpy"

    @property
    def float_type(self) -> Any:
        """The array type of one float per pixel. Raises MachineError where the machine lacks the backend."""
        if self.is_numpy:
            return np.dtype(self.precision).type
        # Dr.Jit takes whatever libLLVM it finds when it is imported, and a wrong one aborts the process at a kernel.
        if self.package == "llvm" and "drjit" not in sys.modules and not os.environ.get("DRJIT_LIBLLVM_PATH"):
            needed = "a libLLVM that was seen to work: call raytwin.twin.activate() first, or set DRJIT_LIBLLVM_PATH"
            raise MachineError("engine", needed, "none that was tried")
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
"""To add an engine, add a row: its array type must overload the usual operators."""


def pixel_grid(engine: Engine, box: tuple[int, int, int, int]) -> tuple[Any, Any]:
    """The centres (u, v) of the box's pixels, x0 <= u < x1, y0 <= v < y1: NumPy's row and column, which broadcast."""
    x0, y0, x1, y1 = box
    kind = engine.float_type
    return np.arange(x0, x1, dtype=kind)[None, :], np.arange(y0, y1, dtype=kind)[:, None]


def tile_pixels(engine: Engine, tiles: np.ndarray, side: int, size: tuple[int, int]) -> tuple[Any, Any, Any]:
    """Dr.Jit's whole numbers (u, v, place) for all pixels of the tiles; `place` counts the frame's pixels.

    A tile is `side` x `side` pixels; `tiles` (n, 2) are their rows and columns. Beyond the frame the last pixel is
    repeated.
    """
    import drjit

    kind = drjit.uint32_array_t(engine.float_type)
    # Opaque: sizes and places are then data, and frames of all sizes share one compiled kernel.
    w, h = (drjit.opaque(kind, n) for n in size)
    index = drjit.arange(kind, len(tiles) * side * side)
    number, inner = index // (side * side), index % (side * side)
    # Both corners are packed into one integer: unpacking costs less than a second look-up.
    corner = drjit.gather(kind, kind((tiles[:, 1] | tiles[:, 0] << 16).astype(np.uint32)), number)
    left, top = (corner & 0xFFFF) * side, (corner >> 16) * side
    u, v = drjit.minimum(left + inner % side, w - 1), drjit.minimum(top + inner // side, h - 1)
    return u, v, v * w + u


def constant(engine: Engine, value: int) -> Any:
    """An integer that all rays share. On Dr.Jit it is data, so that another value reuses the kernel."""
    if engine.is_numpy:
        return value
    import drjit

    return drjit.opaque(drjit.uint32_array_t(engine.float_type), value)


def to_engine(value: Any, engine: Engine) -> Any:
    """Convert the floats of a record to the engine's. On Dr.Jit as data: another scene reuses the kernel."""
    if isinstance(value, Struct):
        return unchecked(value, **{name: to_engine(part, engine) for name, part in structs.asdict(value).items()})
    if isinstance(value, tuple):
        lifted = [to_engine(v, engine) for v in value]
        return type(value)(*lifted) if hasattr(value, "_fields") else tuple(lifted)
    if isinstance(value, np.ndarray):
        return from_numpy(engine, value)
    if not isinstance(value, float):
        return value
    if engine.is_numpy:
        return float(value)  # not NumPy's scalar, for `sqrt`'s reason
    kind = engine.float_type  # checks for a libLLVM before Dr.Jit is imported
    import drjit

    return drjit.opaque(kind, float(value))


def from_numpy(engine: Engine, values: np.ndarray, whole: bool = False) -> Any:
    """Numbers (m,) as the engine's floats, or `whole` ones as its integers."""
    kind = engine.float_type
    if engine.is_numpy:
        return values.astype(int if whole else kind)
    import drjit

    return drjit.int32_array_t(kind)(values.astype(np.int32)) if whole else kind(values.astype(engine.precision))


def gather(numbers: Any, places: Any, where: Any = True) -> Any:
    """numbers[places], for each column of a tuple. Where `where` is false, the value is arbitrary."""
    if isinstance(numbers, tuple):
        return tuple(gather(column, places, where) for column in numbers)
    if isinstance(numbers, list):  # a few numbers: comparing costs less than a look-up
        return reduce(lambda found, i: select(places == i, numbers[i], found), range(1, len(numbers)), numbers[0])
    if isinstance(numbers, np.ndarray):
        return np.take(numbers, places)
    xp = library(numbers)
    return xp.gather(type(numbers), numbers, xp.uint32_array_t(type(places))(places), active=where)


class Canvas:
    """Arrays (H, W) or (H, W, n) that the engine writes into, n numbers per pixel; contiguous on Dr.Jit."""

    def __init__(self, engine: Engine, layers: Sequence[np.ndarray]) -> None:
        self.engine, self.layers = engine, layers
        self.targets = [self._channels(out.reshape(*out.shape[:2], -1)) for out in layers]

    def _channels(self, out: np.ndarray) -> list[Any]:
        if self.engine.is_numpy:
            return [out[..., c] for c in range(out.shape[-1])]
        import drjit

        if not out.flags.c_contiguous:
            raise ValueError("canvas: a contiguous array is needed")
        kind = self.engine.float_type
        target: Any = drjit.int32_array_t(kind) if out.dtype == np.int32 else drjit.float32_array_t(kind)
        # On the CPU each target is the array's own memory, not a copy; one per channel, since a second scatter into a
        # target would first compute the pending one, in a kernel of its own.
        if self.engine.package == "cuda":
            return [target(out.reshape(-1))] * out.shape[-1]
        return [target(out.reshape(-1)) for _ in range(out.shape[-1])]

    def store(self, place: Any, colours: Sequence[tuple[Any, ...]], where: Any) -> None:
        """Write each layer's numbers where `where` is true; `place`: NumPy's slices, or Dr.Jit's numbers of the pixels.

        On Dr.Jit this only queues the writing; `flush` does all of it in one kernel.
        """
        for targets, values in zip(self.targets, colours, strict=True):
            for c, (target, value) in enumerate(zip(targets, values, strict=True)):
                if self.engine.is_numpy:
                    np.copyto(target[place], value, where=where, casting="unsafe")
                else:
                    import drjit

                    drjit.scatter(target, type(target)(value), place * len(values) + c, active=where)

    def flush(self) -> None:
        """Do the writing that `store` has queued."""
        if self.engine.is_numpy:
            return
        import drjit

        drjit.eval(self.targets)
        drjit.sync_thread()
        if self.engine.package == "cuda":
            for out, targets in zip(self.layers, self.targets, strict=True):
                np.copyto(out.reshape(-1), targets[0].numpy())
