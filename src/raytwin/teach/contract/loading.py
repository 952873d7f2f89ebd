"""What is made of what a student hands in: functions by name, arrays, a program's image, an image by a scene's name.

Standard library and NumPy alone: a submission's process (child.py) loads this file without the rest of raytwin, which
imports it.
"""

import ast
import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

Functions = dict[str, Callable[..., Any]]


def new_module(name: str, file: Path) -> ModuleType:
    """Registered before it runs, since dataclasses and pickle look it up."""
    module = ModuleType(name)
    module.__file__ = str(file)
    module.__spec__ = importlib.util.spec_from_loader(name, loader=None)
    sys.modules[name] = module
    return module


class DoesNothing:
    """Stands for what a submission uses beside its functions. Whatever is called or read of it does nothing, too."""

    def __call__(self, *arguments: Any, **options: Any) -> "DoesNothing":
        return self

    def __getattr__(self, name: str) -> "DoesNothing":
        if name.startswith("__"):
            raise AttributeError(name)
        return self


def run_cells(module: ModuleType, cells: Iterable[tuple[str, str]]) -> dict[str, BaseException]:
    """Runs each (name, text) in the module; name -> the first error of those that failed: none is lost by another.

    An import that fails costs what it would have imported, not what is written below it.
    """
    failed: dict[str, BaseException] = {}
    vars(module).update({"display": DoesNothing(), "get_ipython": DoesNothing()})
    for name, text in cells:
        try:
            tree = ast.parse(text, name)
            while tree.body:
                try:
                    exec(compile(tree, name, "exec", dont_inherit=True), vars(module))
                    break
                except ImportError as error:
                    below = _below_import(tree.body, error, name)
                    if below is None:
                        raise
                    failed.setdefault(name, error)
                    tree.body = below
        except (Exception, SystemExit) as error:  # theirs, whatever it is
            failed.setdefault(name, error)
    return failed


def _below_import(body: list[ast.stmt], error: ImportError, name: str) -> list[ast.stmt] | None:
    """The statements after the import that failed; None where no import of the cell itself did."""
    frames = [frame.lineno or 0 for frame in traceback.extract_tb(error.__traceback__) if frame.filename == name]
    for index, one in enumerate(body):
        if isinstance(one, ast.Import | ast.ImportFrom) and frames and one.lineno <= frames[0] <= (one.end_lineno or 0):
            future = [f for f in body[:index] if isinstance(f, ast.ImportFrom) and f.module == "__future__"]
            return future + body[index + 1 :]
    return None


def functions_of(module: ModuleType, names: Iterable[str]) -> Functions:
    """Those of these names that are written."""
    found = {name: getattr(module, name, None) for name in names}
    return {name: f for name, f in found.items() if callable(f) and not is_unwritten(f)}


def is_unwritten(function: Any) -> bool:
    """It does nothing but raise NotImplementedError, as the starter file's do."""
    code = getattr(function, "__code__", None)
    return code is not None and code.co_names == ("NotImplementedError",)


def arrays_of(made: Any) -> tuple[np.ndarray, ...]:
    """What a function returned: a tuple's items one by one, anything else as one. TypeError, in words, where a student
    returned something else than numbers."""
    try:
        arrays = tuple(np.asarray(one) for one in (made if isinstance(made, tuple) else (made,)))
    except (TypeError, ValueError, RuntimeError):
        raise TypeError(f"it returned a {type(made).__name__} that is no array") from None
    if made is None:
        raise TypeError("it returned None: is there a return?")
    if any(a.dtype.kind not in "fiub" for a in arrays):
        names = {"c": "complex numbers", "O": "objects", "U": "text"}
        kinds = dict.fromkeys(names.get(a.dtype.kind, str(a.dtype)) for a in arrays)
        raise TypeError(f"it returned {' and '.join(kinds)}, not numbers")
    return tuple(a if a.dtype.itemsize <= 8 else a.astype(float) for a in arrays)


def run_program(
    command: Sequence[str], scene: Path, out: Path, endings: Sequence[str], timeout: float | None = None, **options: Any
) -> Path:
    """The image that a program wrote, which finds `{scene}` at `scene` and writes to `{out}`, or to `{out}.pfm` and so
    on. RuntimeError, in words, where there is none.

    It has ended when its first process has. What that left behind holds nobody up; in a session of its own it is ended.
    """
    words = [word.replace("{scene}", str(scene)).replace("{out}", str(out)) for word in command]
    with tempfile.TemporaryFile(dir=out.parent) as errors:
        process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stderr=errors, **options)
        try:
            code = process.wait(timeout)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
            if options.get("start_new_session"):
                with contextlib.suppress(OSError):
                    os.killpg(process.pid, signal.SIGKILL)
        errors.seek(0)
        said = errors.read(1 << 20).decode(errors="replace")
    sys.stderr.write(said[-2000:])
    paths = (out, *(out.with_name(out.name + ending) for ending in endings))
    written = [p for p in paths if p.is_file() and not p.is_symlink()]
    if code or not written:
        last = "".join(f": {line}" for line in said.strip().splitlines()[-1:])
        raise RuntimeError(f"exit code {code}{', no image' if not written else ''}{last}")
    return written[0]


def image_at(folder: Path, scene: str, endings: Sequence[str]) -> Path:
    """Return the folder's image of the scene's name; if there is none, the first name it might have."""
    named = [folder / f"{scene}{ending}" for ending in endings]
    return next((path for path in named if path.is_file()), named[0])
