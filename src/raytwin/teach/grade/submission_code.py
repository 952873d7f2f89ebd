"""What a submission holds: Python, a notebook, a program or images, read without running any of it."""

import os
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from raytwin.errors import InputError
from raytwin.images.image_input import ENDINGS
from raytwin.safe_write import check_file
from raytwin.teach.contract.submission import cells
from raytwin.teach.grade.rubric import Rubric
from raytwin.teach.sandbox.sandbox import Code

CODE = (".py", ".ipynb")


def submission_files(path: Path) -> Iterator[Path]:
    """The file itself, or the files of a folder; hidden folders and links are left out."""
    if path.is_file():
        yield path
    for where, folders, names in os.walk(path, followlinks=False):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        yield from (p for n in names if (p := Path(where, n)).is_file() and not p.is_symlink())


def code_of(path: Path, rubric: Rubric) -> Code:
    """Return what a submission's file or folder holds: Python, a notebook, a program (the rubric's command) or images.

    Raises InputError where it is none of these.
    """
    common: dict[str, Any] = {"asked": rubric.functions, "packages": rubric.packages}
    inside = list(submission_files(path))
    found = sorted(p for p in inside if p.suffix in CODE and p.parent == path)
    shown = sum(p.suffix.lower() in ENDINGS for p in inside)
    if path.is_dir() and shown and (shown == len(inside) or not (found or rubric.command)):
        return Code("images", folder=path, **common)
    if path.is_dir() and rubric.command:
        return Code("command", command=tuple(shlex.split(rubric.command)), folder=path, **common)
    file = path
    if path.is_dir():
        named = [p for p in found if p.stem == rubric.file]
        if len(named or found) != 1:
            got = ", ".join(p.name for p in found) or "none"
            raise InputError(path, f"one file of Python, or {rubric.file}.py beside others", got)
        file = (named or found)[0]
    check_file(file, "a Python file, a notebook, or a folder")  # a pipe would be waited for without end
    if file.suffix not in CODE:
        raise InputError(path, "a Python file, a notebook, or a folder", file.suffix or "a file of another kind")
    folder = path if path.is_dir() else None
    if file.suffix == ".ipynb":
        found_cells = tuple((f"cell {n}", text) for n, text in cells(file))
        return Code(file=file.name, cells=found_cells, folder=folder, **common)
    try:
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(file, "UTF-8 text", type(error).__name__) from None
    return Code(source=text or "\n", file=file.name, folder=folder, **common)
