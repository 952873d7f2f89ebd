"""What computes: NumPy or Dr.Jit, in which precision, and the way of pixels and scenes into its arrays and back."""

from typing import Any, NamedTuple

import msgspec
import numpy as np

from raytwin.errors import MachineError
from raytwin.tracer.arrays import library


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
"""To add an engine, add a row: its array type must overload the usual operators."""


def pixel_grid(engine: Engine, box: tuple[int, int, int, int]) -> tuple[Any, Any]:
    """The centres (u, v) of the box's pixels, x0 <= u < x1, y0 <= v < y1, row by row."""
    kind = engine.float_type
    if engine.is_numpy:
        x0, y0, x1, y1 = box
        # A row and a column: NumPy broadcasts them, so what depends on u or v alone is computed once a line.
        return np.arange(x0, x1, dtype=kind)[None, :], np.arange(y0, y1, dtype=kind)[:, None]
    import drjit

    column, row = _pixels(drjit.uint32_array_t(kind), box)
    return kind(column), kind(row)


def _pixels(integer: Any, box: tuple[int, int, int, int]) -> tuple[Any, Any]:
    import drjit

    x0, y0, x1, y1 = box
    index = drjit.arange(integer, (x1 - x0) * (y1 - y0))
    # Opaque: sizes and places are then data, and boxes of all kinds share one compiled kernel.
    width = drjit.opaque(integer, x1 - x0)
    row = index // width
    return index - row * width + drjit.opaque(integer, x0), row + drjit.opaque(integer, y0)


def lift(value: Any, engine: Engine) -> Any:
    """A record with its floats as the engine's: on Dr.Jit as data, so that a kernel outlives a change of scene."""
    if isinstance(value, msgspec.Struct):
        return msgspec.structs.replace(value, **{n: lift(getattr(value, n), engine) for n in value.__struct_fields__})
    if isinstance(value, tuple):
        lifted = [lift(v, engine) for v in value]
        return type(value)(*lifted) if hasattr(value, "_fields") else tuple(lifted)
    if not isinstance(value, float):
        return value
    if engine.is_numpy:
        return float(value)  # not NumPy's scalar, for `sqrt`'s reason
    import drjit

    return drjit.opaque(engine.float_type, float(value))


def store(out: np.ndarray, box: tuple[int, int, int, int], values: tuple, where: Any) -> Any:
    """out[v, u, c] = values[c] for the box's pixels that `where` holds for; `out` (H, W) or (H, W, n), contiguous.

    On Dr.Jit this only queues the writing; keep what it returns and hand it to `flush`, which does all in one kernel.
    """
    x0, y0, x1, y1 = box
    layers = out.reshape(*out.shape[:2], -1)
    if library(*values) is np:
        for c, value in enumerate(values):
            np.copyto(layers[y0:y1, x0:x1, c], value, where=where, casting="unsafe")
        return None
    import drjit

    if not out.flags.c_contiguous:
        raise ValueError("store: a contiguous array is needed")
    kind = type(values[0])
    target_type = drjit.int32_array_t(kind) if out.dtype == np.int32 else drjit.float32_array_t(kind)
    column, row = _pixels(drjit.uint32_array_t(kind), box)
    place = (row * drjit.opaque(type(row), out.shape[1]) + column) * len(values)
    # On the CPU each target is the array's own memory, not a copy; one a channel, since a second scatter into a target
    # would first compute the pending one, in a kernel of its own.
    targets = [target_type(out.reshape(-1)) for _ in values]
    if on_gpu := drjit.backend_v(kind) == drjit.JitBackend.CUDA:
        targets = targets[:1] * len(values)
    for c, (target, value) in enumerate(zip(targets, values, strict=True)):
        drjit.scatter(target, target_type(value), place + c, active=where)
    if on_gpu:
        np.copyto(out.reshape(-1), targets[0].numpy())
    return targets


def flush(engine: Engine, queued: list) -> None:
    """Do the writing that `store` has queued: `queued` holds what it returned."""
    if not engine.is_numpy:
        import drjit

        drjit.eval(queued)
        drjit.sync_thread()


def evaluate(engine: Engine, values: Any) -> None:
    """Compute the values, however nested, in one kernel; NumPy has computed them already."""
    if not engine.is_numpy:
        import drjit

        drjit.eval(values)


def from_numpy(engine: Engine, values: np.ndarray) -> Any:
    """Numbers (m,) as the engine's floats."""
    kind = engine.float_type
    return values.astype(kind) if engine.is_numpy else kind(values.astype(engine.precision))


def to_numpy(values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """The engine's numbers, or one number for all, as a NumPy array of `shape`."""
    return np.broadcast_to(values if library(values) is np else values.numpy(), shape)
