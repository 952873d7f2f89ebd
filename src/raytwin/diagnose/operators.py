"""Slips of the pen, as changes of a syntax tree: a term dropped, a sign turned, an axis forgotten, two names mixed up.

Applied to the textbook they are mistakes, to a student's text they are repairs: each operator has its way back. An
`Edit` replaces one node; its weight says how far-fetched it is, by how often such slips are seen (1: every term).
"""

import ast
import copy
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

New = ast.AST | list[ast.stmt]
"""What stands in the place of a node: another node, or statements."""
Part = tuple[ast.AST, New]
"""A node, and what stands in its place."""


@dataclass(frozen=True, eq=False)
class Edit:
    """`old`, a node of the tree, becomes `new`. `operator`: what was wrong, in words. `also`: what changes with it.

    `moved`: the statement that the edit moves, if it is not `old`.
    """

    operator: str
    weight: float
    old: ast.AST
    new: New
    also: tuple[Part, ...] = ()
    moved: ast.stmt | None = None

    @property
    def parts(self) -> tuple[Part, ...]:
        """All places that change."""
        return ((self.old, self.new), *self.also)

    def applied(self, tree: Any) -> Any:
        """The tree with the edit in it."""
        for old, new in self.parts:
            tree = replaced(tree, old, new)
        return tree

    @property
    def line(self) -> int:
        return int(getattr(self.old, "lineno", 0))

    @property
    def before(self) -> str:
        return ast.unparse(self.old)

    @property
    def after(self) -> str:
        return "\n".join(map(ast.unparse, self.new)) if isinstance(self.new, list) else ast.unparse(self.new)


def replaced(tree: Any, old: ast.AST, new: ast.AST | list[ast.stmt]) -> Any:
    """The tree with `new` in the place of `old`; what is not on the way to it is shared."""
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
    changed = {name: one for name, value in ast.iter_fields(tree) if (one := replaced(value, old, new)) is not value}
    if not changed:
        return tree
    result = copy.copy(tree)
    for name, one in changed.items():
        setattr(result, name, one or [ast.Pass(lineno=1, col_offset=0)] if name == "body" else one)
    return result


USUAL = 2.0
"""Weights up to here are tried first; beyond are names for one another, and factors by name."""


@dataclass(frozen=True)
class File:
    """What a statement's file has: its name for NumPy, the texts it reads entries by, and its own functions.

    `methods`: what is called on each name (`Rotation`: from_rotvec, from_euler); `arity`: function -> its arguments.
    """

    numpy: str = "np"
    words: tuple[str, ...] = ()
    methods: Mapping[str, frozenset[str]] = field(default_factory=dict)
    arity: Mapping[str, int] = field(default_factory=dict)


ALONE = File()
"""Nothing is known of the file."""


def edits(
    statement: ast.stmt,
    file: File = ALONE,
    rare: bool = False,
    only: tuple[type, ...] = (ast.AST,),
    runs: Callable[[ast.stmt], bool] = lambda one: True,
) -> list[Edit]:
    """Single slips of a top-level statement, the least far-fetched first: those of weights up to `USUAL`, or the rest.

    `only`: of nodes of these types. `runs(statement)`: whether it is one that matters. Names in scope are those of a
    function, or of a class's method.
    """
    made: list[Edit] = []
    for unit in _units(statement):
        scope = _Scope(unit, file, rare)
        by_node = {id(node): list(_of_node(node, scope)) for node in _running(unit, runs) if isinstance(node, only)}
        made += [edit for some in by_node.values() for edit in some if _stores(edit) <= scope.stored]
        made += [edit for same in _repeated(unit) for edit in _at_all(same, by_node)]
    made = [edit for edit in made if (edit.weight > USUAL) == rare and not _same(edit.old, edit.new)]
    for edit in made:
        for old, new in edit.parts:
            for tree in new if isinstance(new, list) else [new]:
                locate(tree, old)
    return sorted(made, key=lambda e: e.weight)


def _stores(edit: Edit) -> set[str]:
    """The names that its statements bind: one that the function only reads is global, and would no longer be."""
    some = [one for _, new in edit.parts for one in (new if isinstance(new, list) else [new])]
    return {name for one in some if isinstance(one, ast.stmt) for name in _names_in(one, ast.Store)}


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
    for child in _code_children(statement):
        if not isinstance(child, ast.stmt) or runs(child):
            yield from _running(child, runs)


def locate(tree: ast.AST, like: ast.AST) -> None:
    """Give what is new in the tree the place of another node; below nodes that have one nothing is new."""
    place = {name: getattr(like, name) for name in PLACE if hasattr(like, name)}
    todo = [tree]
    while todo:
        node = todo.pop()
        if "lineno" not in node.__dict__:
            if "lineno" in node._attributes:
                node.__dict__.update(place)
            for value in [node.__dict__.get(name) for name in node._fields]:
                if isinstance(value, ast.AST):
                    todo.append(value)
                elif isinstance(value, list):
                    todo += [one for one in value if isinstance(one, ast.AST)]


PLACE = ("lineno", "col_offset", "end_lineno", "end_col_offset")


def _same(old: ast.AST, new: New) -> bool:
    return type(old) is type(new) and isinstance(new, ast.AST) and ast.dump(old) == ast.dump(new)


def _repeated(statement: ast.AST) -> Iterator[list[ast.AST]]:
    """Equal values that a simple statement has several of: a slip that is copied is in all of them."""
    for simple in _code(statement):
        if isinstance(simple, ast.Assign | ast.AugAssign | ast.Return | ast.Expr):
            of: dict[str, list[ast.AST]] = {}
            for node in ast.walk(simple):
                if isinstance(node, ast.Name | ast.Attribute | ast.Subscript | ast.BinOp | ast.Call) and isinstance(
                    getattr(node, "ctx", ast.Load()), ast.Load
                ):
                    of.setdefault(ast.dump(node), []).append(node)
            yield from (same for same in of.values() if len(same) > 1)


def _at_all(same: list[ast.AST], by_node: Mapping[int, list[Edit]]) -> Iterator[Edit]:
    """The edits that all of these nodes have, in all of them at once."""
    first, *others = [by_node.get(id(node), []) for node in same]
    for edit in first if all(others) else ():
        if isinstance(edit.new, list) or edit.also or edit.operator.startswith("the sign"):
            continue
        text = ast.dump(edit.new)
        like = [next((e for e in some if e.operator == edit.operator and not isinstance(e.new, list)
                      and not e.also and ast.dump(e.new) == text), None) for some in others]  # fmt: skip
        also = tuple((e.old, e.new) for e in like if e is not None)
        if len(also) == len(others):
            yield Edit(edit.operator, edit.weight + 0.05, edit.old, edit.new, also)


def _code(statement: ast.AST) -> Iterator[ast.AST]:
    """All nodes but docstrings, annotations, decorators and imports."""
    for child in _code_children(statement):
        yield child
        yield from _code(child)


def _code_children(node: ast.AST) -> Iterator[ast.AST]:
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            text = isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant)
            if isinstance(child, ast.AST) and not text and not isinstance(child, ast.Import | ast.ImportFrom):
                yield child


class _Scope:
    """What a function's names are, and where its values stand."""

    def __init__(self, statement: ast.stmt, file: File, rare: bool) -> None:
        self.file, self.numpy, self.rare = file, file.numpy, rare
        self.words = file.words if rare else ()
        nodes = list(_code(statement))
        called = {n.func.id for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        stored = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        arguments = {n.arg for n in nodes if isinstance(n, ast.arg)}
        self.names = sorted((stored | arguments) - called - {"self", "_"})
        self.stored = stored | arguments
        self.values: set[int] = set()
        self.assigned: dict[str, list[ast.expr]] = {}
        self.steps = [n for n in nodes if isinstance(n, ast.AugAssign)]
        self.parents = {id(child): n for n in [statement, *nodes] for child in ast.iter_child_nodes(n)}
        self.uses: dict[str, list[ast.Name]] = {}
        self.loops = {name for n in nodes if isinstance(n, ast.For) for name in _names_in(n.target)} - {"_"}
        self.blocks = [block for n in [statement, *nodes] for block in _blocks(n)]
        self.lengths = {ast.unparse(n) for n in nodes if isinstance(n, ast.Call) and ast.unparse(n.func) == "len"}
        self.attributes: dict[str, set[str]] = {}
        divisors = [n.right for n in nodes if isinstance(n, ast.BinOp) and isinstance(n.op, ast.Div)]
        self.divisors = list({ast.unparse(n): n for n in divisors if not isinstance(n, ast.Constant)}.values())[:6]
        self.entries: dict[str, int] = {}
        """By what is indexed: the largest number that it is indexed by."""
        for n in nodes:
            if isinstance(n, ast.Subscript) and isinstance(n.slice, ast.Constant) and isinstance(n.slice.value, int):
                text = ast.unparse(n.value)
                self.entries[text] = max(n.slice.value, self.entries.get(text, 0))
        donors: dict[str, ast.expr] = {}
        for n in nodes:
            self.values.update(map(id, _values(n)))
            if isinstance(n, ast.Assign) and len(n.targets) == 1:
                self.assigned.setdefault(ast.unparse(n.targets[0]), []).append(n.value)
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load):
                self.uses.setdefault(n.id, []).append(n)
            if (
                isinstance(n, ast.Attribute)
                and isinstance(n.value, ast.Name)
                and not (self.is_module(n) or self._is_called(n))
            ):
                self.attributes.setdefault(n.value.id, set()).add(n.attr)
                donors.setdefault(ast.unparse(n), _template(ast.unparse(n)))
            if isinstance(n, ast.Subscript) and isinstance(n.value, ast.Name) and _is_word(n.slice):
                for word in self.words:
                    donors.setdefault(f"{n.value.id}[{word!r}]", _template(f"{n.value.id}[{word!r}]"))
        donors |= {text: _template(text) for text in sorted(self.lengths)}
        self.unread = [name for name in self.names if name not in self.uses]
        self.donors = list(donors.items())[:MOST_DONORS]

    def _is_called(self, node: ast.AST) -> bool:
        parent = self.parents.get(id(node))
        return isinstance(parent, ast.Call) and parent.func is node

    def loop_of(self, node: ast.AST) -> ast.AST | None:
        """The innermost loop around the node."""
        around = self.parents.get(id(node))
        while around is not None and not isinstance(around, ast.For):
            around = self.parents.get(id(around))
        return around

    def is_module(self, node: ast.AST) -> bool:
        """`np`, `np.linalg`, `cv2`: a name that is none of the function's, and what it has."""
        while isinstance(node, ast.Attribute):
            node = node.value
        return isinstance(node, ast.Name) and node.id in MODULES | {self.numpy}


MOST_DONORS = 24
"""Attributes and entries that may be missing beside a value."""
MODULES = {"math", "cv2", "scipy", "optimize", "linalg", "itertools", "functools"}


def _blocks(n: ast.AST) -> Iterator[list[ast.stmt]]:
    for block in (getattr(n, "body", None), getattr(n, "orelse", None)):
        if isinstance(block, list) and block:
            yield block


def _values(n: ast.AST) -> list[ast.expr]:
    """Return the values that a node computes with: operands, arguments, what is assigned or returned."""
    if isinstance(n, ast.BinOp):
        return [n.left, n.right]
    if isinstance(n, ast.Call):
        return [
            *(a for a in n.args if not isinstance(a, ast.Starred)),
            *([n.func.value] if isinstance(n.func, ast.Attribute) else []),
        ]
    if isinstance(n, ast.Assign | ast.AugAssign | ast.Return) and n.value is not None:
        return [n.value]
    if isinstance(n, ast.Tuple | ast.List) and isinstance(n.ctx, ast.Load):
        return [e for e in n.elts if not isinstance(e, ast.Starred)]
    if isinstance(n, ast.Compare):
        return [n.left, *n.comparators]
    return []


Found = Iterator[tuple[Any, ...]]
"""(what was wrong, how far-fetched, what stands there instead, other parts)."""


def _of_node(node: ast.AST, scope: _Scope) -> Iterator[Edit]:
    if isinstance(getattr(node, "ctx", None), ast.Store | ast.Del) and not isinstance(node, ast.Tuple | ast.List):
        return
    for kind, rule in RULES:
        if isinstance(node, kind):
            yield from (Edit(words, weight, node, new, *also) for words, weight, new, *also in rule(node, scope))
    if isinstance(node, ast.expr):
        yield from (Edit(words, weight, node, new) for words, weight, new in _rewritten(node, scope))
    if id(node) in scope.values and isinstance(node, ast.expr) and not (_is_text(node) or scope.is_module(node)):
        yield from (Edit(words, weight, node, new) for words, weight, new in _wrapped(node, scope))
    for block in _blocks(node):
        if not isinstance(node, ast.ClassDef):
            yield from _moved(block)
            yield from _companion(block, scope)
            yield from () if scope.rare else _lost(block, scope)


def _is_word(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _is_text(node: ast.AST) -> bool:
    """Whether it is a text, None or a slice: nothing is computed with these."""
    return isinstance(node, ast.Slice) or (isinstance(node, ast.Constant) and not isinstance(node.value, int | float))


# ------------------------------------------------------------------------------------------ templates


@cache
def _template(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


def fill(text: str, **parts: ast.expr) -> Any:
    """The expression `text`, its names A, B and so on replaced by nodes."""
    return _filled(_template(text), parts)


def _filled(tree: Any, parts: Mapping[str, ast.expr]) -> Any:
    if isinstance(tree, ast.Name):
        return parts.get(tree.id, tree)
    if isinstance(tree, list):
        return [_filled(one, parts) for one in tree]
    if not (isinstance(tree, ast.AST) and tree._fields):
        return tree
    return type(tree)(**{name: _filled(getattr(tree, name), parts) for name in tree._fields})


WRAPS: tuple[tuple[str, float, str], ...] = (
    ("a square root is missing", 1.15, "NP.sqrt(A)"),
    ("a square is missing", 1.15, "A**2"),
    ("the sign is wrong", 1.02, "-A"),
    ("the absolute value is missing", 1.3, "NP.abs(A)"),
    ("a bound of 0 is missing", 1.1, "NP.maximum(0, A)"),
    ("a division by the length is missing", 1.1, "A / NP.linalg.norm(A, axis=-1, keepdims=True)"),
    ("a transpose is missing", 1.05, "A.T"),
    ("degrees are used as radians", 1.6, "NP.radians(A)"),
    ("a copy is missing", 1.4, "A.copy()"),
    ("an axis is missing", 1.4, "A[:, None]"),
    ("an axis is missing", 1.4, "A[..., None]"),
    ("the order is reversed", 1.8, "A[::-1]"),
    ("the channels are reversed", 1.8, "A[..., ::-1]"),
    ("a factor 2 is missing", 1.2, "2 * A"),
    ("a factor 2 is too many", 1.2, "A / 2"),
    ("pi is missing", 1.3, "A / NP.pi"),
    ("pi is too many", 1.3, "NP.pi * A"),
    ("a factor 4 is missing", 1.5, "4 * A"),
    ("it is its complement", 1.6, "1 - A"),
    ("it is inverted", 1.8, "1 / A"),
    ("half a step is off", 1.6, "A + 0.5"),
    ("half a step is off", 1.6, "A - 0.5"),
    ("one step is off", 1.7, "A + 1"),
    ("one step is off", 1.7, "A - 1"),
    ("it is negated", 1.6, "~A"),
    ("it is cut to whole numbers", 1.8, "A.astype(float)"),
    ("rows and columns are swapped", 1.8, "A.transpose(1, 0, 2)"),
    ("the sum over an axis is missing", 1.8, "NP.sum(A, axis=-1)"),
    ("the inverse is wanted", 1.6, "NP.linalg.inv(A)"),
    ("the length is wanted", 1.9, "NP.linalg.norm(A, axis=-1)"),
    ("it is bounded", 2.2, "NP.clip(A, 0, 1)"),
    ("it is encoded", 2.2, "A ** (1 / 2.2)"),
    ("it is encoded", 2.2, "A**2.2"),
)
"""What may be missing around a value: in words, how far-fetched, and what it is then."""


ASKING = ("isfinite", "isnan", "isinf")


MOST_DIMENSIONS = 4
"""Whole numbers up to this one count axes, powers and factors; larger ones are steps or sizes."""


def _is_setting(node: ast.expr) -> bool:
    """A number of steps, or a library's constant: with another sign it switches something off, by accident."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int) and node.value > MOST_DIMENSIONS
    return isinstance(node, ast.Attribute) and node.attr.isupper()


def _wrapped(node: ast.expr, scope: _Scope) -> Found:
    numpy, parent = _template(scope.numpy), scope.parents.get(id(node))
    called = ast.unparse(parent.func).rpartition(".")[2] if isinstance(parent, ast.Call) else ""
    if called in ASKING or called == "range":
        return  # a value that becomes NaN there, or a loop that never runs, is an accident
    if isinstance(parent, ast.Assign) and isinstance(node, ast.Name):  # any change there makes a copy, too
        yield "a copy is missing", 0.9, fill("A.copy()", A=node)
    signed = isinstance(node, ast.UnaryOp) or _is_setting(node)
    for words, weight, text in WRAPS:
        number = isinstance(node, ast.Constant) and any(sign in text for sign in ("NP", "[", ".", "**"))
        if not number and not (signed and text == "-A"):
            yield words, weight, fill(text, A=node, NP=numpy)
    if isinstance(node, ast.Compare | ast.BinOp) and (
        isinstance(node, ast.Compare) or isinstance(node.op, ast.BitAnd)
    ) and not isinstance(parent, ast.BinOp):  # fmt: skip
        for name in scope.names:
            yield f"the condition `{name} > 0` is missing", 1.4, fill("A & (B > 0)", A=node, B=_name(name))
    if scope.rare:
        yield from _beside(node, parent, scope)
    elif not isinstance(parent, ast.Call | ast.Compare) and not isinstance(node, ast.Constant):
        yield from _with_names(node, scope.unread, -UNREAD)


UNREAD = 1.35
"""By so much less far-fetched is it that a name is missing which nothing reads."""


def _with_names(node: ast.expr, names: Sequence[str], more: float = 0.0) -> Found:
    for name in names:
        yield f"the factor {name} is missing", 2.4 + more, fill("A * B", A=node, B=_name(name))
        yield f"the divisor {name} is missing", 2.4 + more, fill("A / B", A=node, B=_name(name))
        yield f"the term {name} is missing", 2.6 + more, fill("A + B", A=node, B=_name(name))
        yield f"the term {name} is missing", 2.6 + more, fill("A - B", A=node, B=_name(name))


def _beside(node: ast.expr, parent: ast.AST | None, scope: _Scope) -> Found:
    """A factor, a divisor or a term that is missing beside the value."""
    if isinstance(parent, ast.Compare):
        for name in scope.names:
            yield "another value is compared", 2.3, _name(name)
    elif not isinstance(parent, ast.Call) and not isinstance(node, ast.Constant):
        yield from _with_names(node, [name for name in scope.names if name not in scope.unread])
    if isinstance(node, ast.Constant):
        return
    for text, donor in scope.donors:
        if text != ast.unparse(node):
            for form in ("A - B", "A + B"):
                yield f"the term `{text}` is missing", 2.5, fill(form, A=node, B=donor)
            if not isinstance(parent, ast.Call):
                yield f"the factor `{text}` is missing", 2.5, fill("A * B", A=node, B=donor)
                yield f"the divisor `{text}` is missing", 2.5, fill("A / B", A=node, B=donor)


def _names_in(tree: ast.AST, use: type[ast.expr_context] = ast.expr_context) -> set[str]:
    """Return the names in the tree; those that are read or stored alone, if `use` is ast.Load or ast.Store."""
    return {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, use)}


def _name(name: str) -> ast.expr:
    return _template(name)


REWRITINGS: tuple[tuple[str, float, str, str], ...] = (
    ("the brackets are missing", 1.2, "-A + B", "-(A + B)"),
    ("the brackets are missing", 1.2, "-A - B", "-(A - B)"),
    ("the brackets are missing", 1.1, "~A & B", "~(A & B)"),
    ("the brackets are missing", 1.1, "~A | B", "~(A | B)"),
    ("the brackets are too many", 1.1, "~(A & B)", "~A & B"),
    ("the brackets are too many", 1.1, "~(A | B)", "~A | B"),
    ("the brackets are too many", 1.1, "-(A + B)", "-A + B"),
    ("the brackets are too many", 1.1, "-(A - B)", "-A - B"),
    ("the brackets are too many", 1.2, "(A + B) * C", "A * C + B"),
    ("the brackets are too many", 1.2, "(A + B) / C", "A / C + B"),
    ("the brackets are too many", 1.2, "(A - B) * C", "A * C - B"),
    ("the brackets are too many", 1.2, "(A - B) / C", "A / C - B"),
    ("the sum is taken too early", 1.1, "(A + B) @ C", "A @ C + B"),
    ("the sum is taken too early", 1.1, "(A - B) @ C", "A @ C - B"),
    ("`&` binds more tightly than the comparisons", 0.9, "A > B & C > D", "(A > B) & (C > D)"),
    ("`&` binds more tightly than the comparisons", 0.9, "A > B & C < D", "(A > B) & (C < D)"),
    ("`&` binds more tightly than the comparisons", 0.9, "A < B & C < D", "(A < B) & (C < D)"),
    ("`&` binds more tightly than the comparisons", 0.9, "A <= B & C <= D", "(A <= B) & (C <= D)"),
    ("`|` binds more tightly than the comparisons", 0.9, "A < B | C <= D", "(A < B) | (C <= D)"),
    ("`and` is for single values, `&` for arrays", 0.9, "A and B", "A & B"),
    ("`or` is for single values, `|` for arrays", 0.9, "A or B", "A | B"),
    ("`not` is for single values, `~` for arrays", 0.9, "not A", "~A"),
    ("`is` asks for the same object, `==` for the same value", 0.9, "A is B", "A == B"),
    ("`is` asks for the same object, `==` for the same value", 0.9, "A is not B", "A != B"),
    ("`^` is no power", 0.9, "A ^ B", "A ** B"),
    ("all are one and the same list", 0.9, "[A] * B", "[A for _ in range(B)]"),
    ("it counts from another number", 1.5, "enumerate(A)", "enumerate(A, 1)"),
    ("it counts from another number", 1.3, "enumerate(A, B)", "enumerate(A)"),
    ("the first is left out", 1.2, "range(A, B)", "range(B)"),
    ("it begins one too early", 1.1, "range(A, B)", "range(A + 1, B)"),
    ("it ends one too early", 1.1, "range(A, B)", "range(A, B + 1)"),
    ("it ends one too late", 1.1, "range(A, B)", "range(A, B - 1)"),
    ("it ends one too early", 1.1, "range(A)", "range(A + 1)"),
    ("it ends one too late", 1.1, "range(A)", "range(A - 1)"),
    ("it counts from 1", 1.1, "NP.arange(A, B)", "NP.arange(B)"),
    ("it counts from 1", 1.1, "NP.arange(1, A + 1)", "NP.arange(A)"),
    ("both ends are in it", 1.1, "NP.linspace(A, B, C)", "NP.linspace(A, B - 1, C)"),
    ("both ends are in it", 1.1, "NP.linspace(A, B, C)", "NP.linspace(A, B, C, endpoint=False)"),
    ("infinity is wanted", 1.2, "NP.zeros(A)", "NP.full(A, NP.inf)"),
    ("NaN is wanted", 1.2, "NP.zeros(A)", "NP.full(A, NP.nan)"),
    ("NaN is wanted", 1.2, "NP.zeros_like(A)", "NP.full_like(A, NP.nan, dtype=float)"),
    ("infinity is wanted", 1.2, "NP.zeros_like(A)", "NP.full_like(A, NP.inf, dtype=float)"),
    ("NaN is wanted", 1.1, "NP.inf", "NP.nan"),
    ("infinity is wanted", 1.1, "NP.nan", "NP.inf"),
    ("infinity is wanted", 1.1, "-NP.inf", "NP.inf"),
    ("the rotation vector is wanted", 0.9, "A.from_euler(B, C)", "A.from_rotvec(C)"),
    ("the rotation vector is wanted", 1.0, "A.from_quat(B)", "A.from_rotvec(B)"),
    ("the rotation vector is wanted", 1.0, "A.as_euler(B)", "A.as_rotvec()"),
    ("infinity is wanted", 1.2, "A > 0", "A < NP.inf"),
    ("infinity is wanted", 1.2, "A < 0", "A < NP.inf"),
    ("it is doubled, not squared", 1.1, "2 * A", "A ** 2"),
    ("it is doubled, not squared", 1.1, "A * 2", "A ** 2"),
    ("it is squared, not doubled", 1.1, "A ** 2", "2 * A"),
    ("it is squared, not cubed", 1.5, "A ** 2", "A ** 3"),
    ("other entries are wanted", 1.2, "A[..., :B]", "A[..., B:]"),
    ("other entries are wanted", 1.2, "A[..., B:]", "A[..., :B]"),
    ("other entries are wanted", 1.2, "A[:, :B]", "A[:, B:]"),
    ("other entries are wanted", 1.2, "A[:, B:]", "A[:, :B]"),
    ("other entries are wanted", 1.5, "A[B:C]", "A[B:C + 1]"),
    ("other entries are wanted", 1.5, "A[B:C]", "A[B:C - 1]"),
    ("other entries are wanted", 1.5, "A[B:C]", "A[B + 1:C]"),
    ("it is not divided by its last entry", 1.2, "A[:, :2]", "A[:, :2] / A[:, 2:]"),
    ("it is not divided by its last entry", 1.2, "A[..., :2]", "A[..., :2] / A[..., 2:]"),
    ("the number is not exact", 1.3, "NP.float32", "NP.float64"),
)
"""What may be written for what: in words, how far-fetched, the pattern, and what is right. A, B and so on are any
expressions, NP is NumPy."""


@cache
def _patterns() -> Mapping[type, list[tuple[str, float, ast.expr, str]]]:
    """The rewritings by the kind of node that they are for."""
    made: dict[type, list[tuple[str, float, ast.expr, str]]] = {}
    for words, weight, pattern, right in REWRITINGS:
        tree = _template(pattern)
        made.setdefault(type(tree), []).append((words, weight, tree, right))
    return made


def _rewritten(node: ast.expr, scope: _Scope) -> Found:
    for words, weight, pattern, right in _patterns().get(type(node), ()):
        parts: dict[str, ast.expr] = {}
        if _matches(pattern, node, parts, scope.numpy):
            yield words, weight, fill(right, **parts, NP=_template(scope.numpy))


def _matches(pattern: Any, node: Any, parts: dict[str, ast.expr], numpy: str) -> bool:
    """Whether the node has the pattern's form; `parts` are what its letters stand for."""
    if isinstance(pattern, ast.Name) and len(pattern.id) == 1 and isinstance(node, ast.expr):
        return pattern.id not in parts and not isinstance(node, ast.Slice | ast.Starred) and not parts.update(
            {pattern.id: node})  # fmt: skip
    if isinstance(pattern, ast.Name) and pattern.id == "NP":
        return isinstance(node, ast.Name) and node.id == numpy
    if isinstance(pattern, list):
        return (
            isinstance(node, list)
            and len(pattern) == len(node)
            and all(_matches(p, n, parts, numpy) for p, n in zip(pattern, node, strict=True))
        )
    if not isinstance(pattern, ast.AST):
        return bool(pattern == node)
    return type(pattern) is type(node) and all(
        _matches(value, getattr(node, name, None), parts, numpy)
        for name, value in ast.iter_fields(pattern) if name != "ctx"
    )  # fmt: skip


# ------------------------------------------------------------------------------------------ expressions

OTHER_SIGN: dict[type, tuple[str, type]] = {
    ast.Add: ("the sign is wrong", ast.Sub),
    ast.Sub: ("the sign is wrong", ast.Add),
    ast.Mult: ("it is multiplied instead of divided", ast.Div),
    ast.Div: ("it is divided instead of multiplied", ast.Mult),
    ast.BitAnd: ("`and` stands for `or`", ast.BitOr),
    ast.BitOr: ("`or` stands for `and`", ast.BitAnd),
    ast.FloorDiv: ("it is divided without remainder", ast.Div),
    ast.MatMult: ("it is a product of matrices", ast.Mult),
    ast.Mod: ("the remainder is taken", ast.FloorDiv),
}


def _binary(n: ast.BinOp, scope: _Scope) -> Found:
    a, b = n.left, n.right
    if type(n.op) in OTHER_SIGN:
        words, other = OTHER_SIGN[type(n.op)]
        yield words, 1.0, ast.BinOp(a, other(), b)
    yield f"`{_short(b)}` is too many", 1.1, a
    if not isinstance(n.op, ast.Div | ast.Pow):
        yield f"`{_short(a)}` is too many", 1.1, b
    if isinstance(n.op, ast.Sub):
        yield f"`{_short(a)}` is too many", 1.5, ast.UnaryOp(ast.USub(), b)
    if isinstance(n.op, ast.Sub | ast.Div | ast.MatMult | ast.Pow):
        yield "the operands are swapped", 1.1, ast.BinOp(b, n.op, a)
    if isinstance(n.op, ast.Add) and not isinstance(a, ast.BinOp):  # of lists the order counts
        yield "the operands are swapped", 1.6, ast.BinOp(b, n.op, a)
    if isinstance(a, ast.BinOp) and not isinstance(n.op, ast.Pow | ast.MatMult):
        yield _brackets(n, 1.0, ast.BinOp(a.left, a.op, ast.BinOp(a.right, n.op, b)))
    if isinstance(b, ast.BinOp):
        yield _brackets(n, 1.1, ast.BinOp(ast.BinOp(a, n.op, b.left), b.op, b.right))
    if isinstance(a, ast.Call) and len(a.args) == 1:
        yield "the brackets end too early", 1.3, ast.Call(a.func, [ast.BinOp(a.args[0], n.op, b)], a.keywords)
    if isinstance(n.op, ast.MatMult):
        yield "the matrix is not transposed, or on the wrong side", 1.2, fill("B @ A.T", A=a, B=b)
    if isinstance(n.op, ast.Mult):
        yield from _product(a, b, scope)


def _brackets(old: ast.expr, weight: float, new: ast.expr) -> tuple[str, float, ast.expr]:
    many = len(ast.unparse(new)) < len(ast.unparse(old))
    return "the brackets are too many" if many else "the brackets are missing", weight, new


def _product(a: ast.expr, b: ast.expr, scope: _Scope) -> Found:
    yield "it is multiplied, not raised to a power", 1.7, ast.BinOp(a, ast.Pow(), b)
    yield "a product of matrices is wanted", 1.6, ast.BinOp(a, ast.MatMult(), b)
    if isinstance(a, ast.Name) and isinstance(b, ast.Name) and a.id == b.id:
        for name in scope.names:
            yield f"`{a.id}` stands for `{name}`", 1.5, fill("A * A", A=_name(name))


def _short(node: ast.AST) -> str:
    text = ast.unparse(node)
    return text if len(text) <= 40 else text[:37] + "..."


REVERSED: dict[type, tuple[tuple[float, type], ...]] = {
    ast.Lt: ((1.0, ast.Gt), (1.8, ast.LtE)),
    ast.LtE: ((1.0, ast.GtE), (1.8, ast.Lt)),
    ast.Gt: ((1.0, ast.Lt), (1.8, ast.GtE)),
    ast.GtE: ((1.0, ast.LtE), (1.8, ast.Gt)),
    ast.Eq: ((1.0, ast.NotEq),),
    ast.NotEq: ((1.0, ast.Eq),),
    ast.In: ((1.6, ast.NotIn),),
    ast.NotIn: ((1.6, ast.In),),
}


def _compare(n: ast.Compare, scope: _Scope) -> Found:
    if len(n.ops) == 1:
        for weight, other in REVERSED.get(type(n.ops[0]), ()):
            yield "the comparison is reversed", weight, ast.Compare(n.left, [other()], n.comparators)


def _both(n: ast.BoolOp, scope: _Scope) -> Found:
    yield "`and` and `or` are mixed up", 1.0, ast.BoolOp(ast.Or() if isinstance(n.op, ast.And) else ast.And(), n.values)
    for k, value in enumerate(n.values):
        rest = n.values[:k] + n.values[k + 1 :]
        yield f"the condition `{_short(value)}` is too many", 1.3, rest[0] if len(rest) == 1 else ast.BoolOp(n.op, rest)
    for name in scope.names if isinstance(n.op, ast.And) else ():
        yield f"the condition `{name} > 0` is missing", 1.4, ast.BoolOp(n.op, [*n.values, fill("A > 0", A=_name(name))])


def _unary(n: ast.UnaryOp, scope: _Scope) -> Found:
    yield "the sign is wrong" if isinstance(n.op, ast.USub) else "it is negated", 1.0, n.operand


def _choice(n: ast.IfExp, scope: _Scope) -> Found:
    yield "the two cases are swapped", 1.1, ast.IfExp(n.test, n.orelse, n.body)
    yield "a condition is too many", 1.5, n.body
    yield "a condition is too many", 1.5, n.orelse


EXCHANGED = (
    ("sqrt", "square"), ("minimum", "maximum"), ("min", "max"), ("argmin", "argmax"), ("any", "all"),
    ("sin", "cos"), ("sin", "tan"), ("cos", "tan"), ("arccos", "arcsin"), ("arctan", "tan"), ("acos", "asin"),
    ("floor", "round"), ("mean", "sum"), ("zeros", "ones"), ("zeros_like", "ones_like"), ("radians", "degrees"),
    ("deg2rad", "rad2deg"), ("isfinite", "isinf"), ("isfinite", "isnan"), ("vstack", "hstack"),
    ("logical_and", "logical_or"), ("sum", "prod"), ("floor", "rint"), ("nanmin", "nanmax"), ("sum", "max"),
    ("minimum", "fmin"), ("maximum", "fmax"), ("min", "nanmin"), ("max", "nanmax"), ("argmin", "nanargmin"),
    ("min", "minimum"), ("max", "maximum"), ("inner", "outer"), ("outer", "multiply"), ("dot", "cross"),
    ("empty", "zeros"), ("empty_like", "zeros_like"), ("isinf", "isnan"), ("ceil", "floor"), ("append", "extend"),
)  # fmt: skip
SIMILAR: dict[str, list[str]] = {}
for _a, _b in EXCHANGED:
    SIMILAR.setdefault(_a, []).append(_b)
    SIMILAR.setdefault(_b, []).append(_a)
OVER_AN_AXIS = {
    "sum", "norm", "mean", "min", "max", "argmin", "argmax", "any", "all", "prod", "stack", "concatenate", "flip",
    "cumsum", "nanmin", "nanmax", "argsort", "sort", "median", "repeat", "roll",
}  # fmt: skip
SHARED = "an array is changed in place"
"""What may be wrong in a function that is right where its arguments are nobody else's."""
WITHOUT_KEEPDIMS = {"stack", "concatenate", "flip", "cumsum", "argsort", "sort", "repeat", "roll"}


def _call(n: ast.Call, scope: _Scope) -> Found:
    called = n.func.attr if isinstance(n.func, ast.Attribute) else n.func.id if isinstance(n.func, ast.Name) else ""
    yield from _other_functions(n, called, scope)
    for i in range(len(n.args)):
        for j in range(i + 1, len(n.args)):
            yield "arguments are swapped", 1.2, ast.Call(n.func, _swapped(n.args, i, j), n.keywords)
    if len(n.args) == 1 and isinstance(one := n.args[0], ast.BinOp):
        yield "the brackets end too late", 1.05, ast.BinOp(ast.Call(n.func, [one.left], n.keywords), one.op, one.right)
    inner = [*n.args[:3], *([n.func.value] if isinstance(n.func, ast.Attribute) else [])]
    for one in inner:
        if not isinstance(one, ast.Constant) and ast.unparse(one) not in (scope.numpy, "math", f"{scope.numpy}.linalg"):
            yield f"`{called}` is too many", 1.3, one
    for other in SIMILAR.get(called, ()):
        yield f"`{called}` stands for `{other}`", 1.0, ast.Call(_called(n.func, other), n.args, n.keywords)
    for k, keyword in enumerate(n.keywords):
        rest = n.keywords[:k] + n.keywords[k + 1 :]
        weight = 0.9 if keyword.arg == "dtype" else 1.5
        yield f"`{keyword.arg}` is too many", weight, ast.Call(n.func, n.args, rest)
    if called in OVER_AN_AXIS:
        yield from _axes(n, called)
        yield from _axes_and_uses(n, called, scope)
    yield from _called_by_name(n, called, scope)


def _called_by_name(n: ast.Call, called: str, scope: _Scope) -> Found:
    """What certain functions are called with."""
    if called == "reshape":
        yield "the order is by columns", 1.6, ast.Call(n.func, n.args, [*n.keywords, _keyword("order", "F")])
    if called == "meshgrid":
        yield "rows and columns are swapped", 1.3, ast.Call(n.func, n.args, [_keyword("indexing", "ij")])
    if called == "range":
        yield "there are too few steps", 0.9, fill("range(100)")
    if called in TYPED and all(k.arg != "dtype" for k in n.keywords):
        yield (
            "it holds whole numbers",
            1.3,
            ast.Call(n.func, n.args, [*n.keywords, ast.keyword("dtype", _name("float"))]),
        )
    if called == "enumerate" and scope.rare:
        for name in scope.names:
            yield "it counts from another number", 2.1, fill("A(B, len(C))", A=n.func, B=n.args[0], C=_name(name))
    for k, one in enumerate(n.args):
        if isinstance(one, ast.Call | ast.Attribute | ast.Subscript) and not isinstance(n.func, ast.Attribute):
            yield (
                f"`{_short(one)}` is too many",
                1.1,
                ast.Call(n.func, [*n.args[:k], ast.List([], ast.Load()), *n.args[k + 1 :]], n.keywords),
            )
    if called in ("einsum", "partial") and n.args:
        yield from _einsum(n)


TYPED = {"zeros_like", "ones_like", "empty_like", "full", "full_like", "array", "asarray", "arange"}


def _einsum(n: ast.Call) -> Found:
    """Two letters of one operand swapped, or two operands."""
    for k, one in enumerate(n.args):
        if isinstance(one, ast.Constant) and isinstance(one.value, str) and "->" in one.value:
            terms = re.findall(r"[^,>-]+", one.value)
            for t, term in enumerate(terms):
                letters = [i for i, letter in enumerate(term) if letter.isalpha()]
                for i, j in itertools.combinations(letters, 2):
                    other = "".join(_swapped(term, i, j))
                    texts = [*terms[:t], other, *terms[t + 1 :]]
                    text = f"{','.join(texts[:-1])}->{texts[-1]}"
                    yield (
                        "the indices are swapped",
                        1.0,
                        ast.Call(n.func, [*n.args[:k], ast.Constant(text), *n.args[k + 1 :]], n.keywords),
                    )


def _other_functions(n: ast.Call, called: str, scope: _Scope) -> Found:
    """What else the file calls on the same name, and its own functions of as many arguments."""
    base = n.func.value.id if isinstance(n.func, ast.Attribute) and isinstance(n.func.value, ast.Name) else ""
    for other in sorted(scope.file.methods.get(base, frozenset()) - {called}):
        yield f"`{other}` is wanted, not `{called}`", 1.6, ast.Call(_called(n.func, other), n.args, n.keywords)
        if len(n.args) > 1:
            yield f"`{other}` is wanted, not `{called}`", 1.6, ast.Call(_called(n.func, other), n.args[-1:], [])
    if isinstance(n.func, ast.Name) and called in scope.file.arity:
        for other, count in scope.file.arity.items():
            if other != called and count == scope.file.arity[called]:
                weight = 1.0 if other.partition("_")[0] == called.partition("_")[0] else 1.7
                yield f"`{other}` is wanted, not `{called}`", weight, ast.Call(_name(other), n.args, n.keywords)


def _axes(n: ast.Call, called: str) -> Found:
    others = [k for k in n.keywords if k.arg not in ("axis", "keepdims")]
    plain = n.args if len(n.args) < 2 or not isinstance(n.args[1], ast.Constant) else n.args[:1]
    if called == "norm" and len(n.args) == 2:
        plain = n.args[:1]
    for axis in (-1, 0, 1, 2):
        for keepdims in (False,) if called in WITHOUT_KEEPDIMS else (False, True):
            words = [_keyword("axis", axis), *([_keyword("keepdims", True)] if keepdims else [])]
            yield (
                "it is over the wrong axis, or over all",
                0.8 + 0.1 * (axis == 2),
                ast.Call(n.func, plain, [*others, *words]),
            )


def _axes_and_uses(n: ast.Call, called: str, scope: _Scope) -> Found:
    """Over an axis, and one more axis where what was assigned is used: an array for each row in place of one number."""
    assignment = scope.parents.get(id(n))
    if not (isinstance(assignment, ast.Assign) and isinstance(target := assignment.targets[0], ast.Name)):
        return
    uses = [u for u in scope.uses.get(target.id, ()) if u.lineno > n.lineno][:4]
    for words, weight, over in _axes(n, called):
        for use in () if any(k.arg == "keepdims" for k in over.keywords) else uses:
            yield words, weight + 0.5, over, ((use, fill("A[..., None]", A=use)),)


def _keyword(name: str, value: Any) -> ast.keyword:
    return ast.keyword(name, _template(repr(value)))


def _called(func: ast.expr, name: str) -> ast.expr:
    made = copy.copy(func)
    setattr(made, "attr" if isinstance(func, ast.Attribute) else "id", name)
    return made


def _swapped(items: Sequence[Any], i: int, j: int) -> list[Any]:
    made = list(items)
    made[i], made[j] = made[j], made[i]
    return made


def _attribute(n: ast.Attribute, scope: _Scope) -> Found:
    if n.attr == "T":
        yield "it is transposed", 0.8, n.value
    if isinstance(n.value, ast.Name) and n.attr in (others := scope.attributes.get(n.value.id, set())):
        for other in sorted(others - {n.attr}):
            if _alike(n.attr, other) != scope.rare:
                weight = 1.2 if _alike(n.attr, other) else 2.1
                yield f"`{n.attr}` stands for `{other}`", weight, ast.Attribute(n.value, other, n.ctx)
    if ast.unparse(n) == f"{scope.numpy}.inf" and isinstance(scope.parents.get(id(n)), ast.Compare):
        yield "0 is wanted", 1.5, _template("0")


def _subscript(n: ast.Subscript, scope: _Scope) -> Found:
    yield "the index is too many", 1.9, n.value
    if isinstance(n.slice, ast.Name | ast.Compare):
        yield "the others are wanted", 1.2, fill("A[~B]", A=n.value, B=n.slice)
    if (other := {"(0, 0)": "(1, 1)", "(1, 1)": "(0, 0)"}.get(ast.unparse(n.slice))) is not None:
        yield "the other entry of the diagonal is wanted", 0.8, ast.Subscript(n.value, _template(other), n.ctx)
    if isinstance(n.slice, ast.Constant | ast.UnaryOp) and not _is_text(n.slice):
        yield "a column is wanted, not a row", 1.1, fill("A[:, B]", A=n.value, B=n.slice)
        for least in ("min", "max", "sum"):
            text = f"NP.{least}(A, axis=0)"
            yield "one of several is used", 1.5, fill(text, A=n.value, NP=_template(scope.numpy))
    if isinstance(n.slice, ast.Slice) and n.slice.step is None:
        for end in filter(None, (n.slice.lower, n.slice.upper)):
            for text in ("A[::B]", "A[:, :B]", "A[B:]", "A[:B]", "A[-B:]"):
                yield "other entries are wanted", 1.5, fill(text, A=n.value, B=end)
    yield from _index(n, scope)


def _index(n: ast.Subscript, scope: _Scope) -> Found:
    if isinstance(n.slice, ast.Tuple) and len(n.slice.elts) == 2:
        first, second = n.slice.elts
        if isinstance(first, ast.Slice) and first.lower is first.upper is None:
            yield "a row is wanted, not a column", 1.1, ast.Subscript(n.value, second, n.ctx)
    if isinstance(n.slice, ast.Constant) and isinstance(n.slice.value, str):
        for word in scope.words:
            if word != n.slice.value:
                yield "another entry is wanted", 2.2, ast.Subscript(n.value, _template(repr(word)), n.ctx)


def _sequence(n: ast.Tuple | ast.List, scope: _Scope) -> Found:
    """Another order: two swapped, or one put elsewhere."""
    make = type(n)
    count = len(n.elts)
    if count > 3:
        yield "the order is reversed", 1.1, make(n.elts[::-1], n.ctx)
    for i in range(count):
        for j in range(i + 1, count):
            yield "the order is wrong", 1.0, make(_swapped(n.elts, i, j), n.ctx)
    for i in range(count if 2 < count <= 6 else 0):
        rest = n.elts[:i] + n.elts[i + 1 :]
        for j in range(count):
            if abs(i - j) > 1:
                yield "the order is wrong", 1.2, make([*rest[:j], n.elts[i], *rest[j:]], n.ctx)


def _constant(n: ast.Constant, scope: _Scope) -> Found:
    value = n.value
    if isinstance(value, bool):
        yield "it is the opposite", 1.0, _template(repr(not value))
    elif value is None and isinstance(scope.parents.get(id(n)), ast.Call):
        for name in scope.names:
            yield f"`{name}` is missing", 1.0, _name(name)
    elif isinstance(value, int | float):
        yield from _number(n, value, scope)
    elif isinstance(value, str) and isinstance(scope.parents.get(id(n)), ast.Compare):
        for word in scope.words:
            if word != value:
                yield "another word is wanted", 2.2, _template(repr(word))


def _number(node: ast.Constant, value: float, scope: _Scope) -> Found:
    parent = scope.parents.get(id(node))
    if isinstance(parent, ast.Call) and ast.unparse(parent.func) == "range":
        # A loop that never runs mends nothing.
        others: tuple[float, ...] = (value + 1, value - 1) if value > 1 else (0, value + 1)
    elif isinstance(value, int):
        others = (0, 1, 2, value + 1, value - 1, -value, 3, 4, 2 * value, value / 2, 100)
    else:
        others = (0.0, 1.0, value / 10, value * 10, 1e-3 * value, 2 * value, value / 2, -value)
        if abs(value - 3.14159265) < 0.2:
            yield "pi is not exact", 0.9, fill("NP.pi", NP=_template(scope.numpy))
    if isinstance(parent, ast.Compare) and value == 0:
        yield "infinity is wanted", 1.5, fill("NP.inf", NP=_template(scope.numpy))
    around = scope.parents.get(id(parent)) if isinstance(parent, ast.Tuple) else parent
    index = isinstance(around, ast.Subscript)
    used = scope.entries.get(ast.unparse(around.value), 0) if isinstance(around, ast.Subscript) else 0
    for other in dict.fromkeys((*others, *range(used + 2 if used > 2 else 0))):
        if other != value:
            small = 1.04 if {value, other} == {0, 1} else 1.2 if other in (0, 1, 2) else 1.8
            beside = 1.1 if index and (abs(other - value) == 1 or 0 <= other <= used + 1) else small
            yield "another number is wanted", beside, _template(repr(other))


def _one_of_a_loop(n: ast.expr, scope: _Scope) -> Found:
    """The loop's variable is wanted, not what stands there; or what it counts begins further on."""
    if isinstance(n, ast.Name):
        for text, donor in scope.donors if n.id in scope.loops and not scope.rare else ():
            yield f"the term `{text}` is missing", 1.6, fill("B + A", A=n, B=donor)
    elif not scope.rare and not scope.is_module(n) and not scope._is_called(n):
        for name in sorted(scope.loops - _names_in(n)):
            yield f"`{name}` is wanted", 1.9, _name(name)


def _name_for_another(n: ast.Name, scope: _Scope) -> Found:
    if n.id not in scope.names:
        return
    for other in scope.names:
        if other != n.id and _alike(n.id, other) != scope.rare:
            yield f"`{n.id}` stands for `{other}`", 1.2 if _alike(n.id, other) else 2.1, _name(other)


def _alike(a: str, b: str) -> bool:
    """x and y, xx and yy, p1 and p2, near and far, x and xd: of one kind by their spelling."""
    pairs = {"near far", "row col", "width height", "origins directions", "origin direction", "w h"}
    if f"{a} {b}" in pairs or f"{b} {a}" in pairs or (len(a) == len(b) == 1):
        return True
    if a.startswith(b) or b.startswith(a):
        return abs(len(a) - len(b)) <= 2
    letters = [(x, y) for x, y in zip(a, b, strict=False) if x != y]
    return len(a) == len(b) and (len(letters) == 1 or (len(letters) == len(a) and len(set(letters)) == 1))


# ------------------------------------------------------------------------------------------ statements


def _assign(n: ast.Assign, scope: _Scope) -> Found:
    if len(n.targets) != 1:
        return
    target = n.targets[0]
    for divisor in scope.divisors:
        yield (
            f"the divisor `{_short(divisor)}` is missing",
            1.4,
            ast.Assign([target], fill("A / B", A=n.value, B=divisor)),
        )
    yield "this line is too many", 2.0, [ast.copy_location(ast.Pass(), n)]
    used = sorted(_names_in(n.value).intersection(scope.names))
    for one, two in itertools.combinations(used, 2) if len(used) <= MOST_NAMES else ():
        yield (
            f"`{one}` and `{two}` are swapped",
            1.5,
            ast.Assign([target], _renamed(n.value, {one: two, two: one})),
        )
    for other in scope.assigned.get(ast.unparse(target), ()):
        if other is not n.value:
            yield "elsewhere it is computed otherwise", 1.6, ast.Assign([target], other)
    if isinstance(target, ast.Name | ast.Subscript):
        for op in (ast.Add(), ast.BitAnd(), ast.BitOr(), ast.Mult(), ast.Sub()):
            yield "each time replaces the one before", 1.5, ast.AugAssign(target, op, n.value)
        if isinstance(target, ast.Subscript) and ast.unparse(target.slice) in (":", "..."):
            yield SHARED, 0.95, ast.Assign([_stored(target.value)], n.value)
        if isinstance(target, ast.Name):
            for least in ("minimum", "maximum"):
                text = f"NP.{least}(A, B)"
                value = fill(text, A=_name(target.id), B=n.value, NP=_template(scope.numpy))
                yield "each time replaces the one before", 1.5, ast.Assign([target], value)


def _copied(n: ast.Assign, scope: _Scope) -> Found:
    """What is a copy, and should be none; or is none, and should be one."""
    target = n.targets[0]
    if isinstance(target, ast.Subscript) and isinstance(copied := target.value, ast.Subscript):
        place = ast.Subscript(copied.value, fill("A[B]", A=copied.slice, B=target.slice), ast.Store())
        yield "a copy of the entries is changed, not the array", 0.9, ast.Assign([place], n.value)
    if isinstance(n.value, ast.Tuple) and all(isinstance(one, ast.Name) for one in n.value.elts):
        copies = [fill("A.copy()", A=one) for one in n.value.elts]
        yield "a copy is missing", 0.9, ast.Assign(n.targets, ast.Tuple(copies, ast.Load()))


MOST_NAMES = 6
"""Names of an expression, up to which two of them are swapped."""


def _lambda(n: ast.Lambda, scope: _Scope) -> Found:
    """A function made in a loop, which reads the loop's variable when it is called: by then, the last one."""
    named: set[str] = set()
    around: ast.AST | None = n
    while (around := scope.parents.get(id(around))) is not None:
        if isinstance(around, ast.For):
            named |= _names_in(around, ast.Store)
    own = {argument.arg for argument in n.args.args}
    if late := sorted((_names_in(n.body) & named) - own):
        arguments = copy.copy(n.args)
        arguments.args = [*n.args.args, *(ast.arg(name) for name in late)]
        arguments.defaults = [*n.args.defaults, *map(_name, late)]
        yield (
            "the loop's variable is read when the function is called, not when it is made",
            0.8,
            ast.Lambda(arguments, n.body),
        )


def _stored(target: ast.expr) -> ast.expr:
    made = copy.copy(target)
    made.ctx = ast.Store()  # type: ignore[attr-defined]
    return made


def _augmented(n: ast.AugAssign, scope: _Scope) -> Found:
    if isinstance(n.target, ast.Name):
        value = ast.BinOp(_name(n.target.id), n.op, n.value)
        yield SHARED, 0.75, ast.Assign([n.target], value)
    yield "this line is too many", 1.7, [ast.copy_location(ast.Pass(), n)]
    if type(n.op) in OTHER_SIGN:
        words, other = OTHER_SIGN[type(n.op)]
        yield words, 1.0, ast.AugAssign(n.target, other(), n.value)
    yield "it is added up, not replaced", 1.6, ast.Assign([n.target], n.value)


def _expression(n: ast.Expr, scope: _Scope) -> Found:
    one = n.value
    if isinstance(one, ast.Compare) and isinstance(one.ops[0], ast.Eq):
        yield "`==` stands for `=`", 0.8, ast.Assign([_stored(one.left)], one.comparators[0])
    if isinstance(one, ast.Call):
        named = [one.func.value] if isinstance(one.func, ast.Attribute) and not scope.is_module(one.func) else one.args
        for name in named[:1]:
            if isinstance(name, ast.Name):
                yield "what it returns is not used", 1.1, ast.Assign([_stored(name)], one)
    yield "this line is too many", 1.7, [ast.copy_location(ast.Pass(), n)]


def _if(n: ast.If, scope: _Scope) -> Found:
    yield "the condition is the wrong way round", 1.1, ast.If(ast.UnaryOp(ast.Not(), n.test), n.body, n.orelse)
    yield "the condition is too many", 1.5, list(n.body)
    yield "the condition never holds", 1.5, list(n.orelse) or [ast.copy_location(ast.Pass(), n)]
    if n.orelse:
        yield "the two cases are swapped", 1.1, ast.If(n.test, n.orelse, n.body)
        yield "the other case is too many", 1.3, ast.If(n.test, n.body, [])
    if len(n.body) > 1:
        yield "the last line belongs behind the condition", 1.5, [ast.If(n.test, n.body[:-1], n.orelse), n.body[-1]]
    if any(isinstance(o, ast.In | ast.NotIn) for t in ast.walk(n.test) if isinstance(t, ast.Compare) for o in t.ops):
        yield "results are kept between calls", 0.9, list(n.body)


def _loop(n: ast.For | ast.While, scope: _Scope) -> Found:
    if isinstance(n.body[-1], ast.Return):
        shorter = copy.copy(n)
        shorter.body = n.body[:-1] or [ast.copy_location(ast.Pass(), n)]
        yield "the return is one level too deep: it ends the loop", 0.8, [shorter, n.body[-1]]
    for step in scope.steps:
        if step not in n.body:
            longer = copy.copy(n)
            longer.body = [*n.body, step]
            yield f"`{_short(step)}` is missing in the loop", 2.2, longer
    if len(n.body) > 1:
        shorter = copy.copy(n)
        shorter.body = n.body[:-1]
        yield "the last line belongs behind the loop", 2.0, [shorter, n.body[-1]]
        for one in [s for s in n.body[:3] if isinstance(s, SIMPLE)]:
            shorter = copy.copy(n)
            shorter.body = [s for s in n.body if s is not one]
            yield "the line belongs before the loop", 1.5, [one, shorter]


def _jump(n: ast.stmt, scope: _Scope) -> Found:
    yield "it ends too early", 1.2, [ast.copy_location(ast.Pass(), n)]
    other = ast.Continue() if isinstance(n, ast.Break) else ast.Break()
    word = "continue" if isinstance(n, ast.Break) else "break"
    yield f"`{word}` is wanted", 1.0, [ast.copy_location(other, n)]


def _function(n: ast.FunctionDef, scope: _Scope) -> Found:
    """What a function keeps from one call to the next: a default value that is changed, a cache around it."""
    arguments = n.args.args[len(n.args.args) - len(n.args.defaults) :]
    for argument, default in zip(arguments, n.args.defaults, strict=True):
        if isinstance(default, ast.List | ast.Dict | ast.Set | ast.Call):
            new = ast.copy_location(ast.Assign([_stored(_name(argument.arg))], default), n.body[0])
            longer = copy.copy(n)
            longer.body = [new, *n.body]
            yield "the default value is kept between calls", 1.3, [longer]
    if not isinstance(n.body[-1], ast.Return) and n.name != "__init__":
        for name in sorted(_names_in(n, ast.Store)):
            longer = copy.copy(n)
            longer.body = [*n.body, ast.copy_location(ast.Return(_name(name)), n.body[-1])]
            yield f"`return {name}` is missing", 1.2, [longer]
    if n.decorator_list:
        plain = copy.copy(n)
        plain.decorator_list = []
        yield "results are kept between calls", 1.5, [plain]


SIMPLE = ast.Assign | ast.AugAssign | ast.Expr


def _moved(block: list[ast.stmt]) -> Iterator[Edit]:
    """A statement that belongs elsewhere: into the loop behind it, into the one before it, behind its neighbour."""
    for k, (one, after) in enumerate(itertools.pairwise(block)):
        if isinstance(one, SIMPLE) and isinstance(after, SIMPLE):
            back: list[ast.stmt] = [copy.copy(one)]
            front: list[ast.stmt] = [copy.copy(after)]
            yield Edit("two lines are in the wrong order", 1.8, one, front, ((after, back),))
        for later in block[k + 1 : k + 5] if isinstance(one, ast.Assign) else ():
            if later is not after or not isinstance(after, SIMPLE):
                gone: list[ast.stmt] = [ast.copy_location(ast.Pass(), one)]
                yield Edit("the line comes too early", 1.6, one, gone, ((later, [later, one]),))
        if isinstance(one, ast.For | ast.While) and isinstance(after, SIMPLE):
            nothing: list[ast.stmt] = [ast.copy_location(ast.Pass(), after)]
            last = one.body[-1]
            yield Edit("the line belongs into the loop", 1.7, after, nothing, ((last, [last, after]),))
        if isinstance(after, ast.For | ast.While):
            for before in [s for s in block[max(0, k - 5) : k + 1] if isinstance(s, SIMPLE)]:
                for loop in [n for n in ast.walk(after) if isinstance(n, ast.For | ast.While)]:
                    first = loop.body[0]
                    yield Edit("the line belongs into the loop", 1.4, first, [before, first], moved=before)
        if isinstance(one, ast.Return):
            passed: list[ast.stmt] = [ast.copy_location(ast.Pass(), one)]
            yield Edit("it returns too early", 0.9, one, passed)


def _lost(block: list[ast.stmt], scope: _Scope) -> Iterator[Edit]:
    """A line that a block of the same kind has, in this one's names.

    What is missing is mostly written elsewhere in the text (Barr and others, The plastic surgery hypothesis, 2014).
    """
    forms = [_form(one) for one in block]
    here = set(map(ast.unparse, block))
    seen: set[str] = set()
    for other in scope.blocks:
        theirs = [_form(one) for one in other]
        if other is block or not set(forms) & set(theirs):
            continue
        names = _counterparts(scope.loop_of(other[0]), scope.loop_of(block[0]))
        for a, b in itertools.product(other, block):
            if _form(a) == _form(b) and len(_all_names(a)) > 2 and ast.unparse(a) not in here:
                names |= {x.id: y.id for x, y in zip(_all_names(a), _all_names(b), strict=True) if x.id != y.id}
        for k, one in enumerate(other):
            line = _renamed(one, names) if ast.unparse(one) not in here else one
            text = ast.unparse(line)
            if not isinstance(one, SIMPLE) or text in here or text in seen:
                continue
            seen.add(text)
            behind = [one for f in theirs[k + 1 :] for one, mine in zip(block, forms, strict=True) if f == mine]
            before = [one for f in theirs[:k] for one, mine in zip(block, forms, strict=True) if f == mine]
            at = [*behind[:1], *before[-1:], block[0]][0]
            first = bool(behind or not before)
            yield Edit(f"`{_short(line)}` is missing", 1.2, at, [line, at] if first else [at, line])


def _companion(block: list[ast.stmt], scope: _Scope) -> Iterator[Edit]:
    """A line like one that is there, for another name: as a rule where two entries are exchanged."""
    for one in block:
        exchanged = isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Tuple)
        for base in _changed_in_place(one) if scope.rare != exchanged else ():
            for name in scope.names:
                if name != base:
                    like = _renamed(one, {base: name})
                    yield Edit(f"`{_short(like)}` is missing", 0.9 if exchanged else 2.1, one, [one, like])


def _form(one: ast.AST) -> str:
    """The statement's form, whatever its names are."""
    return re.sub(r"Name\(id='\w+'", "Name(", ast.dump(one)) if isinstance(one, SIMPLE) else repr(id(one))


def _all_names(tree: ast.AST) -> list[ast.Name]:
    return [n for n in ast.walk(tree) if isinstance(n, ast.Name)]


def _counterparts(theirs: ast.AST | None, mine: ast.AST | None) -> dict[str, str]:
    """The names of one loop in place of another's."""
    if isinstance(theirs, ast.For) and isinstance(mine, ast.For):
        pairs = zip(_all_names(theirs.target), _all_names(mine.target), strict=False)
        return {a.id: b.id for a, b in pairs if a.id != b.id}
    return {}


def _renamed(one: ast.AST, names: Mapping[str, str]) -> Any:
    """A copy with other names."""
    made = copy.deepcopy(one)
    for n in _all_names(made):
        n.id = names.get(n.id, n.id)
    return made


def _changed_in_place(one: ast.stmt) -> set[str]:
    """The names of arrays and values that a line changes."""
    if isinstance(one, ast.AugAssign):
        return {n.id for n in _all_names(one.target)[:1]}
    if isinstance(one, ast.Assign) and (stored := [n for t in one.targets for n in ast.walk(t)
                                                   if isinstance(n, ast.Subscript | ast.Name)]):  # fmt: skip
        return {n.id for n in _all_names(stored[0])[:1]} & _names_in(one.value)
    return set()


RULES: tuple[tuple[Any, Callable[[Any, _Scope], Found]], ...] = (
    (ast.BinOp, _binary),
    (ast.Compare, _compare),
    (ast.BoolOp, _both),
    (ast.UnaryOp, _unary),
    (ast.IfExp, _choice),
    (ast.Call, _call),
    (ast.Attribute, _attribute),
    (ast.Subscript, _subscript),
    (ast.Tuple | ast.List, _sequence),
    (ast.Constant, _constant),
    (ast.Name, _name_for_another),
    (ast.Subscript | ast.Attribute | ast.Name, _one_of_a_loop),
    (ast.Assign, _assign),
    (ast.Assign, _copied),
    (ast.AugAssign, _augmented),
    (ast.Expr, _expression),
    (ast.If, _if),
    (ast.For | ast.While, _loop),
    (ast.Break | ast.Continue, _jump),
    (ast.FunctionDef, _function),
    (ast.Lambda, _lambda),
)
"""Which nodes a rule is for, and the rule."""
