"""What a student hands in: a Python file, a notebook, a program of any language, or a folder of images.

Each becomes a `Submission`: functions by the names of the contract. A program and a folder of images have but one,
`render`; so whoever grades calls functions and need not know the kind.
"""

import ast
import itertools
import os
import re
import shlex
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from raytwin.errors import InputError, MachineError
from raytwin.images.exr import split_layer
from raytwin.images.image import Image
from raytwin.images.image_input import ENDINGS, as_image
from raytwin.renderers.scene_exchange import as_json
from raytwin.safe_write import check_file
from raytwin.scene.toml_json import write_json
from raytwin.teach.contract.composed_tracer import PARTS, compose, made_of
from raytwin.teach.contract.loading import functions_of, image_at, new_module, run_cells, run_program
from raytwin.teach.contract.stage import Function
from raytwin.teach.contract.stage_table import CONTRACT

SECONDS = 600
"""A program that takes longer is stopped."""

_numbers = itertools.count()


@dataclass(frozen=True)
class Submission:
    """`name`: what was handed in. `stages`: of the contract's functions those that it has, in the contract's order.

    `notes`: what a reader should know, a line each (cells of a notebook that failed).
    """

    name: str
    stages: Mapping[str, Function]
    notes: tuple[str, ...] = ()

    def picture(self) -> tuple[Function, str]:
        """What renders a scene: its own `render`, or our tracer with its stages in it; in words, what that is made of.

        Raises InputError where it has no stage that a tracer is made of.
        """
        if "render" in self.stages:
            return self.stage("render"), ""
        if not (own := {name: self.stage(name) for name in PARTS if name in self.stages}):
            raise InputError(f"{self.name}: render", "a function", "nothing of that name")
        return compose(own).render, made_of(own)

    def stage(self, name: str) -> Function:
        """The function of that name. Raises InputError where there is none, or one that takes other arguments."""
        if name not in self.stages:
            raise InputError(f"{self.name}: {name}", "a function", "nothing of that name")
        if other := CONTRACT[name].misfit(self.stages[name]):
            raise InputError(f"{self.name}: {name}", f"a function called as {CONTRACT[name].signature}", other)
        return self.stages[name]


def load(what: str | os.PathLike, function: str | None = None) -> Submission:
    """FILE.py, NOTEBOOK.ipynb, FILE:FUNCTION, a folder of images, an image, or a command with {scene} and {out}.

    `function` names what is called to render, `render` by default. Raises InputError where nothing can be made of it.
    """
    text = os.fspath(what)
    if "{out}" in text:
        return Submission(text, {"render": Program(text)})
    path, colon, named = text.rpartition(":")
    if colon and path.endswith((".py", ".ipynb")):
        text, function = path, named
    if not split_layer(text)[0].exists():
        raise InputError(text, "a Python file, a notebook, a folder of images, or a command with {out}", "no such file")
    if text.endswith((".py", ".ipynb")):
        return load_code(Path(text), function)
    return Submission(text, {"render": Shown(Path(text))})


# ------------------------------------------------------------------------------------------ code


def load_code(path: Path, function: str | None = None) -> Submission:
    """The functions of a Python file, which has to run to its end, or of a notebook, cell by cell."""
    if (folder := str(path.absolute().parent)) not in sys.path:
        sys.path.append(folder)  # its other files can be imported
    module = new_module(f"raytwin_submission_{next(_numbers)}_{path.stem}", path)
    notebook = path.suffix == ".ipynb"
    texts = [(f"cell {number}", text) for number, text in cells(path)] if notebook else [(str(path), _read(path))]
    failed = run_cells(module, texts)
    for name, error in failed.items():
        if not notebook:
            expected = "Python" if isinstance(error, SyntaxError) else "a Python file that can be imported"
            raise InputError(path, expected, _error_text(error, name)) from error
    notes = tuple(f"{name}: {_error_text(error, name)}" for name, error in failed.items())
    found: dict[str, Function] = functions_of(module, CONTRACT)
    if function is not None:
        if not callable(getattr(module, function, None)):
            raise InputError(f"{path}: {function}", "a function", "; ".join(("nothing of that name", *notes)))
        found["render"] = getattr(module, function)
    if not found:
        raise InputError(path, f"a function of {', '.join(CONTRACT)}", "; ".join(("none", *notes)))
    return Submission(str(path), found, notes)


def cells(path: Path) -> Iterator[tuple[int, str]]:
    """The code cells as plain Python by their number among all cells, from 1; those of other languages are left out."""
    text = _read(path)
    try:
        written = msgspec.json.decode(text.encode())
        cells = [(cell["cell_type"], "".join(cell["source"])) for cell in written["cells"]]
    except (msgspec.DecodeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(path, "a notebook (JSON, version 4)", f"{type(error).__name__}: {error}") from None
    for number, (kind, text) in enumerate(cells, start=1):
        if kind == "code" and (python := as_python(text)):
            yield number, python


def _read(path: Path) -> str:
    try:
        return check_file(path, "a file of Python").read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(path, "a file that can be read", error.strerror) from None
    except UnicodeDecodeError as error:
        raise InputError(path, "UTF-8 text", f"byte {error.object[error.start]:#04x} at {error.start}") from None


def _error_text(error: BaseException, name: str) -> str:
    """`KeyError: 'moon' (line 12)`, the line being the file's own."""
    if isinstance(error, SystemExit):
        return f"exit({error.code})"
    if isinstance(error, SyntaxError):
        return f"{type(error).__name__}: {error.msg} (line {error.lineno}: {(error.text or '').strip()[:60]})"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == name]
    return f"{type(error).__name__}: {error}" + (f" (line {lines[-1]})" if lines else "")


# ------------------------------------------------------------------------------------------ cells of a notebook


OTHER_LANGUAGES = frozenset({
    "bash", "sh", "script", "cmd", "html", "HTML", "javascript", "js", "latex", "markdown", "svg", "SVG", "perl",
    "ruby", "R", "cython", "writefile", "file",
})  # fmt: skip
"""Cell magics (`%%bash`) whose cells are not Python. Under any other, such as `%%time`, the cell is."""
MAX_LINES_TAKEN_OUT = 40
"""Lines taken out of a cell: each costs a parse of the whole cell."""
_FORMS = (
    (re.compile(r"(\s*)%time\s+(?=\S)(.*)"), r"\1\2"),  # runs a statement, whose names stay
    (re.compile(r"(\s*)[%!].*"), r"\1pass"),
    (re.compile(r"(\s*)(?=\S)(\?.*|.*\?)\s*"), r"\1pass"),  # help: `np.cross?`
    (re.compile(r"([\w.,\s]+=)\s*[%!].*"), r"\1 None"),  # `names = !ls`
)


def as_python(cell: str) -> str:
    """Return the cell without magics, shell commands and questions for help; "" where it is another language.

    Only lines at which Python's own parser stops are looked at: `%` within an expression or a string stays.
    """
    lines = cell.split("\n")
    first = next((line for line in lines if line.strip()), "")
    if first.startswith("%%") and first[2:].split()[:1] and first[2:].split()[0] in OTHER_LANGUAGES:
        return ""
    for _ in range(MAX_LINES_TAKEN_OUT):
        if (number := _stops_at("\n".join(lines))) is None or number >= len(lines):
            break
        line = lines[number]
        lines[number] = next((form.sub(to, line) for form, to in _FORMS if form.fullmatch(line)), line)
        if lines[number] == line:
            break
        while line.endswith("\\") and (number := number + 1) < len(lines):
            line, lines[number] = lines[number], ""
    return "\n".join(lines)


def _stops_at(text: str) -> int | None:
    """The line, from 0, at which Python's parser stops; None where it reads the text, or cannot say."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)
            ast.parse(text)
    except SyntaxError as error:
        return None if error.lineno is None else error.lineno - 1
    except (ValueError, RecursionError, MemoryError):
        return None
    return None


# ------------------------------------------------------------------------------------------ programs and images


@dataclass(frozen=True)
class Program:
    """A program of any language: `command` finds the scene as JSON at `{scene}`, and writes its image to `{out}`.

    Of a Mitsuba file `{scene}` is the file itself.

    `{out}` ends in .exr; a program that writes another format says `{out}.pfm`, `{out}.png` and so on. A command with
    `{samples}` and `{seed}` is asked for as many samples per pixel as the verdict needs, of other seeds every time.
    """

    command: str

    @property
    def takes(self) -> tuple[str, ...]:
        """What else than the scene it is given."""
        return tuple(name for name in ("samples", "seed") if f"{{{name}}}" in self.command)

    def __call__(self, scene: dict[str, Any], samples: int = 16, seed: int = 0) -> Image:
        with tempfile.TemporaryDirectory() as folder:
            described, out = Path(scene.get("mitsuba", f"{folder}/scene.json")), Path(folder) / "out.exr"
            if "mitsuba" not in scene:
                write_json(described, as_json(scene))
            try:
                words = shlex.split(self.command, posix=os.name != "nt")
            except ValueError as error:
                raise InputError(self.command, "a command", error) from None
            words = [w.replace("{samples}", str(samples)).replace("{seed}", str(seed)) for w in words]
            try:
                options = {"stdout": subprocess.DEVNULL, "timeout": SECONDS, "start_new_session": os.name == "posix"}
                return as_image(run_program(words, described, out, ENDINGS, **options)).image
            except OSError as error:
                raise MachineError(f"The program {words[0]}", f"cannot be started: {error.strerror}.") from None
            except subprocess.TimeoutExpired:
                said = f"was ended after {SECONDS} s without an image."
                raise MachineError(f"The program {words[0]}", said) from None
            except RuntimeError as error:
                raise InputError(self.command, "an image at {out}", error) from None


@dataclass(frozen=True)
class Shown:
    """An image file, or of a folder the one that bears the scene's name."""

    path: Path

    def __call__(self, scene: dict[str, Any]) -> Image:
        path = self.path
        return as_image(image_at(path, scene["name"], ENDINGS) if path.is_dir() else path).image
