"""A change of a syntax tree: an `Edit` puts other nodes in the place of some. Below it, queries on trees."""

import ast
import copy
import marshal
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

New = ast.AST | list[ast.stmt]
"""What stands in the place of a node: another node, or statements."""
Replacement = tuple[ast.AST, New]
"""A node, and what stands in its place."""


@dataclass(frozen=True, eq=False)
class Edit:
    """`old`, a node of the tree, becomes `new`. `operator`: what was wrong, in words. `also`: what changes with it.

    `weight`: a penalty, larger for rarer slips (1: every term; COPIED to FAR in forms.py). `moved`: the
    statement that the edit moves, if it is not `old`.
    """

    operator: str
    weight: float
    old: ast.AST
    new: New
    also: tuple[Replacement, ...] = ()
    moved: ast.stmt | None = None

    @property
    def parts(self) -> tuple[Replacement, ...]:
        """All places that change."""
        return ((self.old, self.new), *self.also)

    def applied(self, tree: Any) -> Any:
        """The tree with the edit in it."""
        for old, new in self.parts:
            tree = replaced(tree, old, new)
        return tree

    def locate(self) -> None:
        """Copy line numbers from the old nodes to the new, so that they compile."""
        for old, new in self.parts:
            for tree in new if isinstance(new, list) else [new]:
                locate(tree, old)

    @property
    def line(self) -> int:
        return int(getattr(self.old, "lineno", 0))

    @property
    def before(self) -> str:
        return ast.unparse(self.old)

    @property
    def after(self) -> str:
        return "\n".join(map(ast.unparse, self.new)) if isinstance(self.new, list) else ast.unparse(self.new)


def replaced(tree: Any, old: ast.AST, new: New) -> Any:
    """Return the tree with `new` in place of `old`. Copies only the nodes above it; the rest is shared."""
    if tree is old:
        return new
    if isinstance(tree, list):
        made: list[Any] = []
        for item in tree:
            one = replaced(item, old, new)
            made += one if isinstance(one, list) else [one]
        return tree if len(made) == len(tree) and all(a is b for a, b in zip(made, tree, strict=True)) else made
    if not isinstance(tree, ast.AST):
        return tree
    parts = {name: one for name, value in ast.iter_fields(tree) if (one := replaced(value, old, new)) is not value}
    if not parts:
        return tree
    result = copy.copy(tree)
    for name, one in parts.items():
        setattr(result, name, one or [ast.Pass(lineno=1, col_offset=0)] if name == "body" else one)
    return result


POSITION_FIELDS = ("lineno", "col_offset", "end_lineno", "end_col_offset")


def locate(tree: ast.AST, like: ast.AST) -> None:
    """Give the tree's new nodes the place of another node. Descend only into nodes without a place."""
    place = {name: getattr(like, name) for name in POSITION_FIELDS if hasattr(like, name)}
    todo = [tree]
    while todo:
        node = todo.pop()
        if "lineno" not in node.__dict__:
            if "lineno" in node._attributes:
                node.__dict__.update(place)
            todo += ast.iter_child_nodes(node)


def code_of(statements: list[ast.stmt]) -> bytes:
    """Compile the statements. Returns b"" if they do not compile."""
    tree = ast.Module(statements, [])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                code = compile(tree, "<repair>", "exec", dont_inherit=True)
            except TypeError:  # a new node below an old one has no place
                code = compile(ast.fix_missing_locations(tree), "<repair>", "exec", dont_inherit=True)
            return marshal.dumps(code)
    except (SyntaxError, ValueError, TypeError, RecursionError, AttributeError):
        return b""


# ------------------------------------------------------------------------------------------ new nodes


def changed(node: Any, **fields: Any) -> Any:
    """Copy the node with these fields changed."""
    return type(node)(**dict(ast.iter_fields(node)) | fields)


def renamed(tree: ast.AST, names: Mapping[str, str]) -> Any:
    """Copy the tree with its names replaced by `names`."""
    made = copy.deepcopy(tree)
    for n in all_names(made):
        n.id = names.get(n.id, n.id)
    return made


# ------------------------------------------------------------------------------------------ what a tree has


def code_children(node: ast.AST) -> Iterator[ast.AST]:
    """The children but docstrings, annotations, decorators and imports."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            text = isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant)
            if isinstance(child, ast.AST) and not text and not isinstance(child, ast.Import | ast.ImportFrom):
                yield child


def code(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes below, but docstrings, annotations, decorators and imports."""
    for child in code_children(tree):
        yield child
        yield from code(child)


def blocks(node: ast.AST) -> Iterator[list[ast.stmt]]:
    """The node's `body` and `orelse`; blocks of `except`, `finally` and `case` are not searched."""
    for block in (getattr(node, "body", None), getattr(node, "orelse", None)):
        if isinstance(block, list) and block:
            yield block


def all_names(tree: ast.AST) -> list[ast.Name]:
    return [n for n in ast.walk(tree) if isinstance(n, ast.Name)]


def names_in(tree: ast.AST, use: type[ast.expr_context] = ast.expr_context) -> set[str]:
    """The names in the tree: all, or with `use` ast.Load or ast.Store only those that are read or stored."""
    return {n.id for n in all_names(tree) if isinstance(n.ctx, use)}


def form(tree: ast.AST) -> str:
    """The tree's structure, with names and constants masked."""
    return re.sub(r"Name\(id='\w+'|Constant\(value=[^,)]*", "_(", ast.dump(tree))
