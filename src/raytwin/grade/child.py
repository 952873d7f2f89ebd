"""The process that a submission runs in: locks itself in, loads the submission, answers calls until it is ended.

sandbox.py runs this file as a script (`python -I child.py`), with its standard input and output as the two pipes; the
submission gets neither. What it prints goes to standard error. Of raytwin there are only the files beside this one.
"""

import contextlib
import importlib.util
import json
import os
import random
import subprocess
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

SAID = 2000
"""Characters of an error that are sent."""
ENDINGS = (".exr", ".pfm", ".hdr", ".png", ".jpg", ".jpeg")

Functions = dict[str, Callable[..., Any]]


def main() -> None:
    here = Path(__file__).resolve().parent
    lock, wire = _beside(here, "lock"), _beside(here, "wire")
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    os.dup2(2, 1)
    take, most = wire.exactly(requests), 1 << 34
    told = wire.read(take, most)
    folder, submission = Path(told["folder"]), Path(told["submission"])
    os.chdir(folder)
    readers = _readers(told["packages"]) if told["kind"] != "python" else None
    np.random.seed(told["seed"])  # noqa: NPY002 - the one that students call
    random.seed(told["seed"])
    held = lock.lock(folder, submission, told["limits"], told["hidden"], told["uid"])
    wire.write(answers, {"locks": held, "pid": os.getpid()})
    try:
        functions, notes = _load(told, submission, readers)
    except BaseException as error:
        wire.write(answers, {"error": _said(error, submission)})
        return
    wire.write(answers, {"functions": sorted(n for n in told["asked"] if n in functions), "notes": notes})
    while True:
        try:
            call = wire.read(take, most)
        except EOFError:
            return
        answer: dict[str, Any] = {"call": call["call"]}
        try:
            answer["arrays"] = _arrays(functions[call["function"]](*call["arguments"]), told["limits"]["answer"])
        except BaseException as error:
            answer |= {"error": _said(error, submission)}
        with contextlib.suppress(Exception):
            sys.stdout.flush()
        wire.write(answers, answer)


def _beside(here: Path, name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"_{name}", here / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _load(told: dict[str, Any], submission: Path, readers: Any) -> tuple[Functions, list[str]]:
    """The submission's functions that are `asked` for; and of a notebook what went wrong in cells that failed."""
    if told["kind"] == "images":
        return {"render": lambda scene: _image_of(submission, scene["name"], readers)}, []
    if told["kind"] == "command":
        return {"render": lambda scene: _run(told["command"], submission, scene, readers)}, []
    sys.modules["raytwin"] = None  # type: ignore[assignment]  # it has the answers
    sys.path.insert(0, str(submission))
    module = ModuleType("submission")
    module.__file__ = str(submission / told["file"])
    sys.modules["submission"] = module  # dataclasses and pickle look their module up
    vars(module)["display"] = lambda *things, **options: None
    notes: list[str] = []
    for name, text in told["cells"]:
        try:
            exec(compile(text, str(submission / name), "exec", dont_inherit=True), vars(module))
        except BaseException as error:
            if len(told["cells"]) == 1:
                raise
            notes.append(f"{name}: {_said(error, submission)}"[:200])
    return {name: f for name in told["asked"] if callable(f := getattr(module, name, None))}, notes[:20]


def _arrays(result: Any, most: int) -> list[np.ndarray]:
    """One array, or those of a tuple. Raises TypeError for what is none of numbers."""
    if result is None:
        raise TypeError("it returned nothing (None): is the `return` missing?")
    parts = result if isinstance(result, tuple) else (result,)
    arrays = []
    for part in parts[:8]:
        array = np.asarray(part)
        if array.dtype.kind not in "fiub" or array.dtype.itemsize > 8:
            raise TypeError(f"it returned {type(part).__name__} of {array.dtype}, which are no numbers")
        arrays.append(array)
    if sum(a.nbytes for a in arrays) > most:
        raise MemoryError(f"it returned arrays of {[a.shape for a in arrays]}: more than is taken")
    return arrays


def _said(error: BaseException, submission: Path) -> str:
    """`ValueError: ...`, and the lines of the submission that led there."""
    try:
        lines = [f"{type(error).__name__}: {error}"]
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(str(submission))]
        if isinstance(error, SyntaxError) and error.lineno:
            lines.append(f"line {error.lineno}: {(error.text or '').strip()}")
        lines += [f"{Path(f.filename).name}, line {f.lineno}, in {f.name}: {f.line}" for f in frames[-4:]]
        return "\n".join(lines)[:SAID]
    except BaseException:
        return "an error that cannot be printed"


# ------------------------------------------------------------------------------------------ images and programs


def _readers(packages: list[str]) -> Any:
    """raytwin's readers of images, loaded whole before the locks close: these formats are read in here, too."""
    sys.path += packages
    import OpenEXR  # noqa: F401
    from PIL import Image as Pillow

    from raytwin import given
    from raytwin.files import exr, hdr, images, limits, pfm, pictures, rounding  # noqa: F401

    Pillow.init()
    return given


def _image_of(folder: Path, scene: str, given: Any) -> tuple[np.ndarray, ...]:
    found = [path for ending in ENDINGS if (path := folder / f"{scene}{ending}").is_file()]
    if not found:
        raise FileNotFoundError(f"no {scene}{ENDINGS[0]} (nor {', '.join(ENDINGS[1:])})")
    return _read(found[0], given)


def _read(path: Path, given: Any) -> tuple[np.ndarray, ...]:
    """Its pixels, and the file's first bytes: they tell what the format rounds."""
    with path.open("rb") as file:
        start = file.read(26)
    return np.asarray(given.take(path).image.mean, np.float32), np.frombuffer(start, np.uint8)


def _run(command: list[str], submission: Path, scene: dict[str, Any], given: Any) -> tuple[np.ndarray, ...]:
    told, out = Path("scene.json").resolve(), Path("out.exr").resolve()
    for old in out.parent.glob("out.exr*"):
        old.unlink()
    told.write_text(json.dumps(scene, default=lambda array: array.tolist()))
    words = [w.replace("{scene}", str(told)).replace("{out}", str(out)) for w in command]
    done = subprocess.run(words, cwd=submission, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    sys.stderr.write(done.stderr[-SAID:].decode(errors="replace"))
    written = [p for p in (out, *(out.with_name(out.name + e) for e in ENDINGS)) if p.is_file() and not p.is_symlink()]
    if done.returncode or not written:
        said = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or [""]
        raise RuntimeError(f"no image at {{out}}, exit code {done.returncode}: {said[0]}")
    return _read(written[0], given)


if __name__ == "__main__":
    main()
