"""The walk: a learner goes from photos to the twin in eight stages, and writes one function in each.

What a learner sees is drawn by `show/walk_cell.py`.

lessons.py.txt   the source, a script with cells (py:percent): text, empty functions, checks, pictures; no module, since
                 importing it would run the lessons
desk.py          what the lessons stand on: photos, camera, shapes, the twin
"""

from importlib import resources
from pathlib import Path

from raytwin.errors import InputError
from raytwin.safe_write import write_text


def write_walk(folder: Path, notebook: bool = False) -> Path:
    """The walk in `folder`, as walk.py or walk.ipynb. Raises InputError where it is there: it may be half walked."""
    text = resources.files("raytwin.teach.walk").joinpath("lessons.py.txt").read_text(encoding="utf-8")
    path = folder / ("walk.ipynb" if notebook else "walk.py")
    if path.exists():
        raise InputError(path, "a new file", "one that is there, perhaps half walked")
    write_text(path, as_notebook(text) if notebook else text)
    return path


def as_notebook(text: str) -> str:
    """A py:percent script as .ipynb."""
    import jupytext

    made = jupytext.reads(text, fmt="py:percent")
    made.metadata["kernelspec"] = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return str(jupytext.writes(made, fmt="ipynb"))
