"""Slips of the pen, as changes of a syntax tree: a term dropped, a sign turned, an axis forgotten, two names mixed up.

Applied to the textbook they are mistakes, to a student's text they are repairs: each operator has its way back.
"""

import ast
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from raytwin.diagnose import expression_operators as expressions
from raytwin.diagnose import statement_operators as statements
from raytwin.diagnose.edit import Edit, all_names, blocks, code, code_children, form, names_in, renamed, same
from raytwin.diagnose.rewritings import rewritten, wrapped
from raytwin.diagnose.scope import File, Found, Scope

USUAL = 2.0
"""Weights up to here are tried first; beyond are names for one another, and factors by name."""
ALONE = File()
"""Nothing is known of the file."""
Operator = Callable[[Any, Scope], Found]
OPERATORS: tuple[tuple[Any, Operator], ...] = (
    (ast.BinOp, expressions.binary),
    (ast.BinOp, expressions.square),
    (ast.BoolOp, expressions.conditions),
    (ast.Call, expressions.other_functions),
    (ast.Call, expressions.call),
    (ast.Call, expressions.axis),
    (ast.Call, expressions.indices_of_sum),
    (ast.Call, expressions.library),
    (ast.Attribute, expressions.attribute),
    (ast.Tuple | ast.List, expressions.sequence),
    (ast.Constant, expressions.constant),
    (ast.Name, expressions.other_name),
    (ast.Subscript | ast.Attribute | ast.Name, expressions.loop_variable),
    (ast.Constant | ast.Subscript | ast.Name, expressions.index),
    (ast.Subscript, expressions.part),
    (ast.Assign, statements.assign),
    (ast.Assign, statements.copied),
    (ast.AugAssign, statements.augmented),
    (ast.Expr, statements.expression),
    (ast.If, statements.condition),
    (ast.For | ast.While, statements.loop),
    (ast.Break | ast.Continue, statements.jump),
    (ast.FunctionDef, statements.function),
    (ast.Lambda, statements.late_variable),
    (ast.expr, rewritten),
    (ast.expr, wrapped),
)
"""Which nodes an operator is for, and the operator."""


def edits(
    statement: ast.stmt,
    file: File = ALONE,
    rare: bool = False,
    runs: Callable[[ast.stmt], bool] = lambda one: True,
) -> list[Edit]:
    """Single slips of a top-level statement, the least far-fetched first: those of weights up to `USUAL`, or the rest.

    `runs(statement)`: whether it is one that matters. Names in scope are those of a function, or of a class's method.
    """
    made: list[Edit] = []
    for unit in _units(statement):
        scope = Scope(unit, file, rare)
        nodes = list(_running(unit, runs))
        by_node = {id(node): list(_of_node(node, scope, OPERATORS)) for node in nodes}
        of_blocks = [edit for n in nodes for block in blocks(n) for edit in statements.in_block(block, scope)]
        bound: dict[int, set[str]] = {}
        _bound(unit, scope.stored, bound)
        made += [e for e in itertools.chain(*by_node.values(), of_blocks) if _stores(e) <= bound[id(e.old)]]
        made += [edit for items in scope.lists for pair in itertools.pairwise(items) for edit in _unlike(*pair, scope)]
        everywhere = [edit for nodes in _repeated(unit) for edit in _at_all(nodes, by_node, _what)]
        made += [edit for edit in everywhere if not edit.operator.startswith("the sign")]
        made += [edit for nodes in _counterparts(scope) for edit in _at_all(nodes, by_node, _form_of_what)]
    made = [edit for edit in made if (edit.weight > USUAL) == rare and not same(edit.old, edit.new)]
    return sorted(made, key=lambda e: e.weight)


UNSEEN = {statements.assign, statements.copied, statements.augmented, expressions.index, expressions.part}


def edits_of_right(statement: ast.stmt) -> list[Edit]:
    """Slips that the tests of a function do not see, whose arrays are small and nobody else's."""
    operators = [(kind, operator) for kind, operator in OPERATORS if operator in UNSEEN]
    scopes = [(unit, Scope(unit, ALONE, False)) for unit in _units(statement)]
    made = [edit for unit, scope in scopes for node in code(unit) for edit in _of_node(node, scope, operators)]
    return [edit for edit in made if edit.operator in (statements.SHARED, expressions.WITHIN, expressions.OF_PART)]


def _units(statement: ast.stmt) -> Iterator[ast.stmt]:
    """What has names of its own."""
    if isinstance(statement, ast.ClassDef):
        for one in statement.body:
            yield from _units(one)
    else:
        yield statement


def _running(statement: ast.AST, runs: Callable[[ast.stmt], bool]) -> Iterator[ast.AST]:
    """The statement's nodes, but for the statements in it that do not run."""
    yield statement
    for child in code_children(statement):
        if not isinstance(child, ast.stmt) or runs(child):
            yield from _running(child, runs)


def _of_node(node: ast.AST, scope: Scope, operators: Sequence[tuple[Any, Operator]]) -> Iterator[Edit]:
    if isinstance(getattr(node, "ctx", None), ast.Store | ast.Del) and not isinstance(node, ast.Tuple | ast.List):
        return
    for operator in [operator for kind, operator in operators if isinstance(node, kind)]:
        yield from (Edit(words, weight, node, new, *also) for words, weight, new, *also in operator(node, scope))


def _bound(tree: ast.AST, names: set[str], found: dict[int, set[str]]) -> None:
    """Into `found`, by the id of each node: the names that the innermost function around it binds."""
    if isinstance(tree, ast.FunctionDef | ast.Lambda):
        own = [n for child in ast.iter_child_nodes(tree) for n in _outside_functions(child)]
        names = {n.id for n in own if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        names |= {n.arg for n in own if isinstance(n, ast.arg)}
    found[id(tree)] = names
    for child in ast.iter_child_nodes(tree):
        _bound(child, names, found)


def _outside_functions(tree: ast.AST) -> Iterator[ast.AST]:
    """The nodes that are in no function of the tree."""
    if not isinstance(tree, ast.FunctionDef | ast.Lambda):
        yield tree
        for child in ast.iter_child_nodes(tree):
            yield from _outside_functions(child)


def _stores(edit: Edit) -> set[str]:
    """The names that its statements bind: one that a function only reads is another's, and would no longer be."""
    some = [one for _, new in edit.parts for one in (new if isinstance(new, list) else [new])]
    return {name for one in some if isinstance(one, ast.stmt) for name in names_in(one, ast.Store)}


# ------------------------------------------------------------------------------------------ in several places


def _repeated(statement: ast.AST) -> Iterator[list[ast.AST]]:
    """Equal values that a simple statement has several of: a slip that is copied is in all of them."""
    for simple in code(statement):
        if isinstance(simple, ast.Assign | ast.AugAssign | ast.Return | ast.Expr):
            of: dict[str, list[ast.AST]] = {}
            for node in ast.walk(simple):
                loaded = isinstance(getattr(node, "ctx", ast.Load()), ast.Load)
                if loaded and isinstance(node, ast.Name | ast.Attribute | ast.Subscript | ast.BinOp | ast.Call):
                    of.setdefault(ast.dump(node), []).append(node)
            yield from (nodes for nodes in of.values() if len(nodes) > 1)


def _counterparts(scope: Scope) -> Iterator[list[ast.AST]]:
    """Expressions at the same place of lines of one form: a slip that is copied, name by name, is in both."""
    for pair in scope.parallel:
        for nodes in zip(*(itertools.chain(*map(ast.walk, run)) for run in pair), strict=True):
            if isinstance(nodes[0], ast.BinOp | ast.Call | ast.UnaryOp | ast.Compare | ast.Subscript):
                yield list(nodes)


def _at_all(nodes: Sequence[ast.AST], by_node: Mapping[int, list[Edit]], key: Callable[[Edit], Any]) -> Iterator[Edit]:
    """The edits that all of these nodes have, in all of them at once: those that are equal by `key`."""
    edits_of = [[e for e in by_node.get(id(n), []) if isinstance(e.new, ast.AST) and not e.also] for n in nodes]
    first, *others = [{key(e): e for e in reversed(some)} for some in edits_of]
    for name, edit in reversed(first.items()):
        if all(name in some for some in others):
            also = tuple((some[name].old, some[name].new) for some in others)
            yield Edit(edit.operator, edit.weight + 0.05, edit.old, edit.new, also)


def _what(edit: Edit) -> Any:
    return edit.operator, edit.after


def _form_of_what(edit: Edit) -> Any:
    return re.sub("`.*?`", "", edit.operator), re.sub(r"\w+", "_", edit.after)


# ------------------------------------------------------------------------------------------ lines of almost one form


def _unlike(one: ast.AST, other: ast.AST, scope: Scope) -> Iterator[Edit]:
    """Two lines, or entries of a tuple, that differ in form at one place: there one is as the other, name by name."""
    place, names = _difference(one, other)
    if place is not None:
        for (old, like), counterparts in ((place, {b: a for a, b in names}), (place[::-1], dict(names))):
            letters = str.maketrans({b: a for b, a in counterparts.items() if len(a) == len(b) == 1})
            spelled = {name: name.translate(letters) for name in names_in(like)}
            known = {name: to for name, to in spelled.items() if to in scope.names}
            yield Edit("it is written otherwise than the line beside it", 0.9, old, renamed(like, known | counterparts))


def _difference(one: ast.AST, other: ast.AST) -> tuple[tuple[ast.AST, ast.AST] | None, list[tuple[str, str]]]:
    """The innermost expressions in which the two differ in form, and the names that stand for each other elsewhere."""
    children = list(ast.iter_child_nodes(one)), list(ast.iter_child_nodes(other))
    if type(one) is type(other) and len(children[0]) == len(children[1]):
        pairs = list(zip(*children, strict=True))
        apart = [pair for pair in pairs if form(pair[0]) != form(pair[1])]
        if len(apart) == 1 and all(isinstance(part, ast.expr) for part in apart[0]):
            alike = [pair for pair in pairs if pair is not apart[0]]
            names = [(a.id, b.id) for x, y in alike for a, b in zip(all_names(x), all_names(y), strict=True)]
            place, more = _difference(*apart[0])
            return place, names + more
    expressions = isinstance(one, ast.expr) and isinstance(other, ast.expr)
    return ((one, other) if expressions and form(one) != form(other) else None), []
