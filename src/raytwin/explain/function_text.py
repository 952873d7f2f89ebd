"""Find the statements that a function is made of, and collect what the operators need to know of their file."""

import ast
import re
import warnings
from collections.abc import Sequence

from raytwin.explain.edits import File

Cells = Sequence[tuple[str, str]]
"""(name, text): a Python file has one, a notebook several."""


def file_of(cells: Cells, reached: Sequence[ast.stmt]) -> File:
    """Collect what the operators need: NumPy's name, words, and the number of arguments of each function."""
    nodes = [n for s in reached for n in ast.walk(s)]
    words = {n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)}
    top = [s for _, text in cells for s in _parsed(text).body]
    numpy = next((a.asname or a.name for s in top if isinstance(s, ast.Import) for a in s.names
                  if a.name == "numpy"), "np")  # fmt: skip
    arity = {s.name: len(s.args.args) for s in top if isinstance(s, ast.FunctionDef)}
    return File(
        numpy,
        tuple(sorted(word for word in words if word.isidentifier())),
        arity,
        frozenset(re.findall(r"[A-Za-z_]\w*", "\n".join(text for _, text in cells))),
    )


def _parsed(text: str) -> ast.Module:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text)
    except (SyntaxError, ValueError, RecursionError):
        return ast.Module([], [])


def statements_of(cells: Cells, function: str, innocent: Sequence[str]) -> list[tuple[str, ast.stmt]]:
    """Return the top-level statements that define the function and all that it reads, without the innocent."""
    bound: dict[str, tuple[str, ast.stmt]] = {}
    for cell, text in cells:
        for statement in _parsed(text).body:
            for name in names_bound(statement):
                # `f = check(f)` behind `def f` wraps the function, and is not its text.
                if isinstance(statement, ast.FunctionDef) or not isinstance(
                    bound.get(name, ("", None))[1], ast.FunctionDef
                ):
                    bound[name] = cell, statement
    found: dict[int, tuple[str, ast.stmt]] = {}
    todo = [function]
    bound = {name: one for name, one in bound.items() if name not in innocent}
    while todo:
        name = todo.pop(0)
        if name in bound and id(bound[name][1]) not in found:
            found[id(bound[name][1])] = bound[name]
            todo += [n.id for n in ast.walk(bound[name][1]) if isinstance(n, ast.Name)]
    return list(found.values())


def names_bound(statement: ast.stmt) -> tuple[str, ...]:
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return (statement.name,)
    if isinstance(statement, ast.Assign):
        return tuple(n.id for target in statement.targets for n in ast.walk(target) if isinstance(n, ast.Name))
    return ()
