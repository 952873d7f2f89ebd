"""What changes do where they stand, seen in one run: most can be dismissed before the function runs with each of them.

With many a change an expression raises, keeps its value, or has the value that another change gives. The value of a
statement is computed as it is and, beside it, with each of its changes, and goes on as it is.
"""

import ast
import copy
from collections.abc import Iterator, Sequence
from typing import Any

from raytwin.diagnose.edit import Edit, locate
from raytwin.diagnose.schemata import code_of
from raytwin.diagnose.statement_operators import SHARED

LIBRARIES = {"np", "numpy", "math"}
BUILT_IN = {"abs", "bool", "enumerate", "float", "int", "len", "list", "max", "min", "range", "round", "sum", "tuple"}
METHODS = {
    "all", "any", "argmax", "argmin", "argsort", "astype", "clip", "cumsum", "dot", "flatten", "max", "mean", "min",
    "nonzero", "prod", "ravel", "reshape", "squeeze", "std", "sum", "swapaxes", "take", "tolist", "transpose",
}  # fmt: skip
"""Methods of arrays that change nothing."""


def values_text(statement: ast.stmt, some: Sequence[Edit], first: int) -> tuple[bytes, dict[Edit, tuple[int, int]]]:
    """The statement, which tells `raytwin_values` the values of its changes; edit -> place, counted from `first`, and
    number. Empty where none can be told."""
    values = {id(node): value for value in _values(statement) for node in ast.walk(value)}
    at: dict[int, tuple[int, list[ast.expr]]] = {}
    numbers: dict[Edit, tuple[int, int]] = {}
    for edit in some:
        value = values.get(id(edit.old))
        inside = all(values.get(id(old)) is value for old, _ in edit.parts)
        # The values of a copy are those of what it is a copy of.
        if value is None or not inside or edit.operator.startswith(("a copy", SHARED)):
            continue
        edit.locate()
        made = edit.applied(value)
        if isinstance(made, ast.expr) and not isinstance(made, ast.Starred):
            place, others = at.setdefault(id(value), (first + len(at), []))
            others.append(made)
            numbers[edit] = place, len(others) - 1
    if not at:
        return b"", {}
    code = code_of([_Watched(at).visit(statement)])
    if code is None:
        right = [edit for edit in numbers if code_of([ast.Expr(edit.applied(values[id(edit.old)]))]) is not None]
        return (b"", {}) if len(right) == len(numbers) else values_text(statement, right, first)
    return code, numbers


def _values(statement: ast.AST, in_class: bool = False) -> Iterator[ast.expr]:
    """What statements compute and may compute twice: it calls nothing that could change anything."""
    for child in ast.iter_child_nodes(statement):
        if isinstance(child, ast.stmt):
            some = [getattr(child, name, None) for name in ("value", "test")]
            if not isinstance(child, ast.Expr) and not in_class:
                yield from (one for one in some if isinstance(one, ast.expr) and _changes_nothing(one))
        if not isinstance(child, ast.expr):
            yield from _values(child, isinstance(child, ast.ClassDef))


def _changes_nothing(value: ast.expr) -> bool:
    for node in ast.walk(value):
        if isinstance(node, ast.NamedExpr | ast.Yield | ast.YieldFrom | ast.Await | ast.Lambda):
            return False
        if isinstance(node, ast.keyword) and node.arg in (None, "out"):
            return False
        if isinstance(node, ast.Call) and not _is_known(node.func):
            return False
    return True


def _is_known(called: ast.expr) -> bool:
    if isinstance(called, ast.Name):
        return called.id in BUILT_IN
    if not isinstance(called, ast.Attribute):
        return False
    root = called.value
    while isinstance(root, ast.Attribute) and root.attr != "random":
        root = root.value
    return called.attr in METHODS or (isinstance(root, ast.Name) and root.id in LIBRARIES)


class _Watched(ast.NodeTransformer):
    """`x = f(y)` becomes `x = raytwin_values(7, lambda: f(y), lambda: (lambda: g(y), lambda: f(z)))`."""

    def __init__(self, at: dict[int, tuple[int, list[ast.expr]]]) -> None:
        self.at = at

    def generic_visit(self, node: ast.AST) -> ast.AST:
        made = copy.copy(node)
        for name, value in ast.iter_fields(node):
            if isinstance(value, list):
                setattr(made, name, [self.visit(one) if isinstance(one, ast.AST) else one for one in value])
            elif isinstance(value, ast.AST):
                setattr(made, name, self._watched(value) if id(value) in self.at else self.visit(value))
        return made

    def _watched(self, value: ast.AST) -> ast.AST:
        place, others = self.at[id(value)]
        all_of_them = ast.Tuple([_later(one) for one in others], ast.Load())
        watched = ast.Call(
            ast.Name("raytwin_values", ast.Load()), [ast.Constant(place), _later(value), _later(all_of_them)], []
        )
        locate(watched, value)
        return watched


def _later(value: Any) -> ast.Lambda:
    return ast.Lambda(ast.arguments([], [], None, [], [], None, []), value)
