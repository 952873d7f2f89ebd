"""All changes of a statement in one text that is compiled once: a switch says which of them holds.

Where a change would stand, `x` becomes `x if 7 not in SWITCH else (first if SWITCH[7] == 0 else second)`. One
compilation does for thousands of changes, two may hold at once, and the switch notes which places are reached
(mutant schemata: Untch, Offutt and Harrold 1993).
"""

import ast
import copy
import marshal
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from raytwin.diagnose.edit import Edit, New, locate

SWITCH = "raytwin_switch"
"""The global name that the text reads: place -> number of the change that holds there."""
Setting = tuple[tuple[int, int], ...]
"""(place, number of the change) of each place that an edit changes."""


@dataclass(frozen=True, eq=False)
class Schema:
    """`code` defines the statement anew, with the changes that the switch has."""

    code: bytes
    settings: Mapping[int, Setting]
    """id of an edit -> what the switch is for it."""
    end: int
    """The place after the last."""


def schemata(
    statement: ast.stmt, some: Sequence[Edit], first: int, switched: bool = True
) -> Iterator[tuple[Sequence[Edit], Schema]]:
    """The edits, and the text that has them, its places counted from `first`; edits that leave no Python are in none.

    One text, unless some cannot be compiled together; or one each, without a switch.
    """
    todo = [list(some)] if switched else [[edit] for edit in some]
    while todo:
        part = todo.pop(0)
        made = _compiled(statement, part, first, switched)
        if made is not None:
            yield part, made
            first = made.end
        elif len(part) > 1:
            half = len(part) // 2
            todo += [part[:half], part[half:]]


def _compiled(statement: ast.stmt, some: Sequence[Edit], first: int, switched: bool) -> Schema | None:
    for edit in some:
        edit.locate()
    if not switched:
        changed = some[0].applied(statement)
        code = code_of(changed if isinstance(changed, list) else [changed])
        return None if code is None else Schema(code, {id(some[0]): ()}, first)
    sites = _Sites(statement, first)
    try:
        settings = {id(edit): sites.put(edit) for edit in some}
        code = code_of([sites.built(statement)])
    except (RecursionError, AttributeError):
        return None
    return None if code is None else Schema(code, settings, first + len(sites.at))


def code_of(statements: list[ast.stmt]) -> bytes | None:
    """None where they are no Python."""
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
        return None


class _Sites:
    """Where changes stand: at expressions that are computed, or else at the statement around them."""

    def __init__(self, statement: ast.stmt, first: int) -> None:
        self.first = first
        self.at: dict[int, tuple[int, list[Any]]] = {}
        self.around: dict[int, list[ast.AST]] = {}
        self.changed: set[int] = set()
        self._walk(statement, [])

    def _walk(self, node: ast.AST, around: list[ast.AST]) -> None:
        self.around[id(node)] = around = [*around, node]
        for child in ast.iter_child_nodes(node):
            self._walk(child, around)

    def put(self, edit: Edit) -> Setting:
        """The places of all its parts; a place around another part has that part, too."""
        sites: dict[int, ast.AST] = {}
        for old, new in edit.parts:
            one = self._site(old, new)
            sites[id(one)] = one
        inner = {id(s) for s in sites.values() if any(id(a) in sites for a in self.around[id(s)][:-1])}
        return tuple(self._add(site, edit) for key, site in sites.items() if key not in inner)

    def _site(self, old: ast.AST, new: New) -> ast.AST:
        """The node itself where another expression may be computed in its place; else the statement around it."""
        *outer, node = self.around[id(old)]
        plain = isinstance(node, ast.expr) and isinstance(new, ast.expr) and not _has_slice(node)
        loaded = isinstance(getattr(node, "ctx", ast.Load()), ast.Load) and not isinstance(new, ast.Starred)
        inside = any(isinstance(a, ast.pattern | ast.JoinedStr) for a in outer)
        if plain and loaded and not inside and not isinstance(node, ast.Starred):
            return node
        while not isinstance(node, ast.stmt):
            *outer, node = outer
        return node

    def _add(self, site: ast.AST, edit: Edit) -> tuple[int, int]:
        place, others = self.at.setdefault(id(site), (self.first + len(self.at), []))
        self.changed.update(map(id, self.around[id(site)]))
        others.append(edit.applied(site))
        return place, len(others) - 1

    def built(self, tree: Any) -> Any:
        """The tree with a switch at each place; what has none is shared."""
        if isinstance(tree, list):
            return [one for item in tree for one in (self._statement(item) if isinstance(item, ast.stmt)
                                                     else [self.built(item)])]  # fmt: skip
        if id(tree) not in self.changed:
            return tree
        made = self._within(tree)
        if id(tree) in self.at and isinstance(tree, ast.expr):
            place, others = self.at[id(tree)]
            chosen = _chosen(place, others, 0, len(others))
            switched = ast.IfExp(_absent(place), made, chosen)
            locate(switched, tree)
            return switched
        if isinstance(tree, ast.stmt):
            (made,) = self._statement(tree)
        return made

    def _within(self, tree: ast.AST) -> Any:
        made = copy.copy(tree)
        for name, value in ast.iter_fields(tree):
            if isinstance(value, list | ast.AST):
                setattr(made, name, self.built(value))
        return made

    def _statement(self, tree: ast.stmt) -> list[Any]:
        made = self._within(tree)
        if id(tree) not in self.at:
            return [made]
        place, others = self.at[id(tree)]
        rest: list[Any] = [
            ast.If(_is(place, number), other if isinstance(other, list) else [other], [])
            for number, other in enumerate(others)
        ]
        switched = ast.If(_absent(place), [made], rest)
        locate(switched, tree)
        return [switched]


def _has_slice(node: ast.AST) -> bool:
    return isinstance(node, ast.Slice) or (
        isinstance(node, ast.Tuple) and any(isinstance(e, ast.Slice | ast.Starred) for e in node.elts)
    )


def _switch() -> ast.expr:
    return ast.Name(SWITCH, ast.Load())


def _absent(place: int) -> ast.expr:
    return ast.Compare(ast.Constant(place), [ast.NotIn()], [_switch()])


def _is(place: int, number: int, op: type[ast.cmpop] = ast.Eq) -> ast.expr:
    return ast.Compare(ast.Subscript(_switch(), ast.Constant(place), ast.Load()), [op()], [ast.Constant(number)])


def _chosen(place: int, others: list[Any], begin: int, end: int) -> Any:
    """One of others[begin:end], by halves: nothing is nested deeply."""
    if end - begin == 1:
        return others[begin]
    half = (begin + end) // 2
    left, right = _chosen(place, others, begin, half), _chosen(place, others, half, end)
    return ast.IfExp(_is(place, half, ast.Lt), left, right)
