"""The process that a submission runs in: locks itself in, loads the submission, answers calls until it is ended.

sandbox.py runs this file as a script (`python -I child.py`), with its standard input and output as the two pipes; the
submission gets neither. What it prints goes to standard error. raytwin itself is not importable here.
"""

import contextlib
import errno
import importlib.util
import json
import os
import pickle
import random
import signal
import sys
import traceback
from collections.abc import Callable
from importlib.machinery import BuiltinImporter, FrozenImporter, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

MAX_ERROR_CHARACTERS = 200
"""Characters of an error that are kept: arrays are printed whole."""
MAX_MESSAGE_CHARACTERS = 2000
"""Characters of an error that are sent."""


def main() -> None:
    here = Path(__file__).resolve().parent
    lock, wire = _load_file(here / "lock.py"), _load_file(here / "wire.py")
    loading = _load_file(here.parent / "contract" / "loading.py")
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    os.dup2(2, 1)
    take, most = wire.exactly(requests), 1 << 34
    job = wire.read(take, most, trusted=True)
    folder, submission = Path(job["folder"]), Path(job["submission"])
    os.chdir(folder)
    hidden, packages = job.pop("hidden"), job.pop("packages")
    readers = _readers(packages) if job["kind"] != "python" else None
    np.random.seed(0)  # noqa: NPY002 - the one that students call
    random.seed(0)
    locks = lock.lock(folder, submission, job["limits"], hidden, job["entries"])
    del hidden, packages  # a submission reads this frame
    wire.write(answers, {"locks": locks, "pid": os.getpid()})
    try:
        functions, notes = _load(job, submission, readers, loading)
    except BaseException as error:
        wire.write(answers, {"error": _said(error, submission, job["modules"])})
        return
    wire.write(answers, {"functions": sorted(n for n in job["asked"] if n in functions), "notes": notes})
    while True:
        try:
            call = wire.read(take, most, trusted=True)
        except EOFError:
            return
        answer: dict[str, Any] = {"call": call["call"]}
        lock.allow_cpu(job["limits"]["a_call"])
        try:
            before = [pickle.dumps(argument) for argument in call["arguments"]]
            arrays = loading.arrays_of(functions[call["function"]](*call["arguments"]))[: call["most_arrays"]]
            if sum(a.nbytes for a in arrays) > job["limits"]["answer"]:
                raise MemoryError(f"it returned arrays of {[a.shape for a in arrays]}: more than is taken")
            answer["arrays"] = list(arrays)
            after = [pickle.dumps(argument) for argument in call["arguments"]]
            answer["changed"] = [k for k, one in enumerate(before) if one != after[k]]
        except BaseException as error:
            answer |= {"error": _said(error, submission, job["modules"])}
        with contextlib.suppress(Exception):
            sys.stdout.flush()
        wire.write(answers, answer)


def _load_file(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _load(
    job: dict[str, Any], submission: Path, readers: Any, loading: Any
) -> tuple[dict[str, Callable[..., Any]], list[str]]:
    """The submission's functions that are `asked` for; and of a notebook what went wrong in cells that failed."""
    endings = job["endings"]
    if job["kind"] == "images":
        return {"render": lambda scene: _image(loading.image_at(submission, scene["name"], endings), readers)}, []
    if job["kind"] == "command":
        return {"render": lambda scene: _run(job, submission, scene, readers, loading)}, []
    # raytwin has the answers. Notebooks check themselves by it while they are written: here that does nothing.
    sys.modules["raytwin"] = stand_in = ModuleType("raytwin")
    stand_in.__getattr__ = loading.DoesNothing().__getattr__  # type: ignore[method-assign]
    sys.path.insert(0, str(submission))
    sys.meta_path[:] = [BuiltinImporter, FrozenImporter, _OnlyThese(job["modules"], str(submission))]
    module = loading.new_module("submission", submission / job["file"])
    failed = loading.run_cells(module, [(str(submission / name), text) for name, text in job["cells"]])
    functions = loading.functions_of(module, job["asked"])
    for error in failed.values():
        if len(job["cells"]) == 1 and not (functions and isinstance(error, ImportError)):
            raise error
    notes = [f"{Path(name).name}: {_said(error, submission, job['modules'])}"[:300] for name, error in failed.items()]
    return functions, notes[:20]


class _OnlyThese:
    """Finds the standard library, these modules and the submission's own; any other is as if it were not installed."""

    def __init__(self, modules: list[str], submission: str) -> None:
        self._known, self._own = frozenset(modules) | sys.stdlib_module_names, [submission]

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        if path is None and name not in self._known and not name.startswith("_sysconfigdata"):
            path = self._own
        return PathFinder.find_spec(name, path, target)

    @staticmethod
    def invalidate_caches() -> None:
        PathFinder.invalidate_caches()


def _hint(error: BaseException, submission: Path, modules: list[str]) -> str:
    """What a student does not know of the sandbox, where that is why the error came."""
    if isinstance(error, ModuleNotFoundError):
        names = [name for name in modules if not name.startswith("_")]
        return f"A submission may import the standard library, its own files, {', '.join(names)}."
    if str(error).startswith(f"exit code {-getattr(signal, 'SIGXCPU', 0)},"):
        return "The program was ended: it computed for longer than a call may."
    if not isinstance(error, OSError):
        return ""
    file = error.filename if isinstance(error.filename, str) else ""
    if isinstance(error, FileNotFoundError) and file and not os.path.isabs(file):  # noqa: PTH117
        if (submission / file).exists():
            return "It runs in an empty working folder; Path(__file__).with_name(...) is a file beside yours."
    elif error.errno in (errno.EACCES, errno.EPERM, errno.EROFS, errno.EXDEV):
        if file:
            own = 'A submission writes to its working folder alone: a relative path, as "frame.png", is there.'
            return f"{own} It reads no files but its own."
        return "The sandbox allows no network, no signals to others, no change of files' rights."
    return ""


def _said(error: BaseException, submission: Path, modules: list[str]) -> str:
    """`ValueError: ...`, what the sandbox has to do with it, and the lines of the submission that led there."""
    try:
        text = " ".join(str(error).split()).replace(f"{submission}/", "")
        text = text if len(text) <= MAX_ERROR_CHARACTERS else f"{text[:MAX_ERROR_CHARACTERS]}..."
        lines = [" ".join([f"{type(error).__name__}: {text}", _hint(error, submission, modules)]).rstrip()]
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(str(submission))]
        if isinstance(error, SyntaxError) and error.lineno:
            lines.append(f"line {error.lineno}: {(error.text or '').strip()}")
        lines += [f"{Path(f.filename).name}, line {f.lineno}, in {f.name}: {f.line}" for f in frames[-4:]]
        return "\n".join(lines)[:MAX_MESSAGE_CHARACTERS]
    except BaseException:
        return "an error that cannot be printed"


# ------------------------------------------------------------------------------------------ images and programs


def _readers(packages: list[str]) -> Any:
    """raytwin's readers of images, loaded whole before the locks close: these formats are read in here, too."""
    sys.path += packages
    import OpenEXR  # noqa: F401
    from PIL import Image as Pillow

    from raytwin.images import image_input

    Pillow.init()
    return image_input


def _image(path: Path, image_input: Any) -> tuple[np.ndarray, ...]:
    """Its pixels, and the file's first bytes: they say what the format rounds."""
    with path.open("rb") as file:
        start = file.read(26)
    return np.asarray(image_input.as_image(path).image.mean, np.float32), np.frombuffer(start, np.uint8)


def _run(
    job: dict[str, Any], submission: Path, scene: dict[str, Any], image_input: Any, loading: Any
) -> tuple[np.ndarray, ...]:
    described, out = Path("scene.json").resolve(), Path("out.exr").resolve()
    for old in out.parent.glob("out.exr*"):
        old.unlink()
    described.write_text(json.dumps(scene, default=lambda array: array.tolist()))
    return _image(loading.run_program(job["command"], described, out, job["endings"], cwd=submission), image_input)


if __name__ == "__main__":
    main()
