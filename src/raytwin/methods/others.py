"""Images that others make: a file, a folder of them, a Python function, a program; and what `--subject` takes."""

import importlib.util
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from raytwin import files
from raytwin.errors import InputError
from raytwin.given import take
from raytwin.image import Image
from raytwin.methods.exchange import as_arrays
from raytwin.methods.method import Call, Method
from raytwin.methods.table import METHODS
from raytwin.methods.traced import Traced
from raytwin.scene import Scene

SECONDS = 600
"""A program that takes longer is stopped."""
ENDINGS = (".exr", ".pfm", ".hdr", ".png", ".jpg", ".jpeg")


@dataclass(frozen=True)
class Shown(Method):
    """An image file, or of a folder the one that bears the scene's name."""

    path: str = ""

    @property
    def name(self) -> str:
        return self.path

    def prepare(self, scene: Scene) -> Call:
        path = Path(self.path)
        if path.is_dir():
            named = [path / f"{scene.name}{ending}" for ending in ENDINGS]
            path = next((file for file in named if file.is_file()), named[0])
        return lambda seed: take(path).image


@dataclass(frozen=True)
class Called(Method):
    """`function` of the Python file `path`, called with `as_arrays(scene, rung)`; it returns radiance (H, W, 3)."""

    path: str = ""
    function: str = "render"

    @property
    def name(self) -> str:
        return f"{self.path}:{self.function}"

    @property
    def library(self) -> str:
        return "python"

    def prepare(self, scene: Scene) -> Call:
        render = load_function(self.path, self.function)

        def call(seed: int) -> Image:
            try:
                made = np.asarray(render(as_arrays(scene, self.rung)))
            except Exception as error:  # theirs, whatever it is: the program that runs it goes on
                raise InputError(self.name, "an image (H, W, 3)", f"{type(error).__name__}: {error}") from error
            if made.dtype.kind not in "fiu" or made.shape != (scene.camera.height, scene.camera.width, 3):
                wanted = f"an image ({scene.camera.height}, {scene.camera.width}, 3)"
                raise InputError(self.name, wanted, f"{made.dtype} {made.shape}")
            return Image(made.astype(np.float32))

        return call


def load_function(path: str, function: str) -> Callable[..., Any]:
    """The function of a Python file, which is run. Raises InputError where it cannot be, or has none of that name."""
    name = f"raytwin_subject_{Path(path).stem}"
    spec = importlib.util.spec_from_file_location(name, path) if Path(path).is_file() else None
    if spec is None or spec.loader is None:
        raise InputError(path, "a Python file", "no such file" if not Path(path).is_file() else "another kind of file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up while it runs
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(path, "a Python file that can be imported", f"{type(error).__name__}: {error}") from error
    if not callable(getattr(module, function, None)):
        raise InputError(f"{path}: {function}", "a function", "nothing of that name")
    made: Callable[..., Any] = getattr(module, function)
    return made


@dataclass(frozen=True)
class Run(Method):
    """A program of any language: `command` finds `as_arrays` as JSON at `{scene}`, and writes its image to `{out}`.

    `{out}` ends in .exr; a program that writes another format says `{out}.pfm`, `{out}.png` and so on.
    """

    command: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return " ".join(self.command)

    def prepare(self, scene: Scene) -> Call:
        def call(seed: int) -> Image:
            with tempfile.TemporaryDirectory() as folder:
                told, out = Path(folder) / "scene.json", Path(folder) / "out.exr"
                files.write_json(told, as_arrays(scene, self.rung))
                words = [word.replace("{scene}", str(told)).replace("{out}", str(out)) for word in self.command]
                try:
                    done = subprocess.run(words, capture_output=True, timeout=SECONDS, check=False)
                except (OSError, subprocess.TimeoutExpired) as error:
                    raise InputError(self.name, "a program that runs", error) from None
                written = [p for p in (out, *(out.with_name(out.name + e) for e in ENDINGS)) if p.is_file()]
                if done.returncode or not written:
                    said = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or [""]
                    raise InputError(self.name, "an image at {out}", f"exit code {done.returncode}: {said[0]}")
                return take(written[0]).image

        return call


def find_subject(text: str, rung: str) -> Method:
    """A name of METHODS; FILE.py:FUNCTION; an image or a folder of images; a command that names {scene} and {out}."""
    if text in METHODS:
        method = METHODS[text]
        return replace(method, surface=True) if isinstance(method, Traced) else method
    if "{out}" in text:
        return Run(rung, tuple(text.split()))
    path, colon, function = text.rpartition(":")
    if colon and path.endswith(".py"):
        return Called(rung, path, function)
    if Path(text).exists():
        return Called(rung, text) if text.endswith(".py") else Shown(rung, text)
    known = "a method's name (`raytwin bench list`), FILE.py:FUNCTION, an image, or a command with {scene} and {out}"
    raise InputError("--subject", known, text)
