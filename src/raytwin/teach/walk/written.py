"""The source of the walk as a script or a notebook."""

import ast
from importlib import resources
from pathlib import Path

from raytwin.errors import InputError
from raytwin.safe_write import write_text


def source() -> str:
    """Return lessons.py.txt."""
    return resources.files("raytwin.teach.walk").joinpath("lessons.py.txt").read_text(encoding="utf-8")


def solutions() -> dict[str, str]:
    """Return the text of every function, filled in, by its name."""
    text = resources.files("raytwin.teach.walk").joinpath("solutions.py").read_text(encoding="utf-8")
    functions = (node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef))
    return {node.name: ast.get_source_segment(text, node) or "" for node in functions}


def with_functions(text: str, functions: dict[str, str]) -> str:
    """The source with functions of those names replaced. Raises InputError for one that it does not have."""
    lines = text.splitlines(keepends=True)
    places = {node.name: node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)}
    for name in sorted(functions, key=lambda name: -places[name].lineno if name in places else 0):
        if name not in places:
            raise InputError("function", f"one of {', '.join(places)}", name)
        node = places[name]
        lines[node.lineno - 1 : node.end_lineno] = [functions[name].rstrip("\n") + "\n"]
    return "".join(lines)


def write_walk(folder: Path, notebook: bool = False, solved: bool = False) -> Path:
    """The walk in `folder`, as walk.py or walk.ipynb. Raises InputError where it is there: it may be half walked."""
    text = with_functions(source(), solutions()) if solved else source()
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
