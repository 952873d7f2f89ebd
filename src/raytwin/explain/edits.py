"""Slips of the pen, as changes of a syntax tree: a term dropped, a sign turned, an axis forgotten, two names mixed up.

Applied to the textbook they are mistakes, to a student's text they are repairs: each has its way back. What may stand
for what is in forms.py. Here is what depends on the text around: its names, numbers, arguments, lines and loops.
"""

import ast
import copy
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from raytwin.explain.edit import Edit, all_names, blocks, changed, code, code_children, form, names_in, renamed
from raytwin.explain.forms import (
    COPIED,
    COUNTERPARTS,
    FAR,
    RARE,
    SIMILAR,
    USUAL,
    filled,
    is_text,
    rewritten,
    rows_for,
    same,
    template,
)  # fmt: skip

Found = Iterator[tuple[Any, ...]]
"""(what was wrong, weight, what stands there instead)."""
MODULES = {"math", "cv2", "scipy", "optimize", "linalg", "itertools", "functools"}
SIMPLE = ast.Assign | ast.AugAssign | ast.Expr
SHARED = "an array is changed in place"
REPLACED = "the new value overwrites the old one"
OVER_AN_AXIS = {
    "stack", "concatenate", "flip", "cumsum", "argsort", "sort", "repeat", "roll", "sum", "norm", "mean", "min", "max",
    "argmin", "argmax", "any", "all", "prod", "nanmin", "nanmax", "median",
}  # fmt: skip
TYPED = {"zeros_like", "ones_like", "empty_like", "full", "full_like", "array", "asarray", "arange"}
"""Functions that make whole numbers of whole numbers."""
MISSING_BESIDE = ("term", "A + B"), ("term", "A - B"), ("term", "B - A"), ("factor", "A * B"), ("divisor", "A / B")
"""What may be missing beside a value A, and what it is then."""
MOST_DIMENSIONS = 4
"""Largest whole number that may count axes, powers or factors; larger ones are steps or sizes."""
BETWEEN_CALLS = "results are kept between calls"
TOO_MANY = "remove this line"
MAX_NAMES = 6
"""Most names of an expression of which two are swapped."""
SECOND_PLACE_WEIGHT = 0.05
"""Weight added to a change of several places: one of a single place is preferred."""
MAX_LINES_COPIED = 6
"""Most lines that are compared as one copied block."""


@dataclass(frozen=True)
class File:
    """What a statement's file has: its name for NumPy, the texts it reads entries by, and its own functions.

    `arity`: function -> its arguments.
    """

    numpy: str = "np"
    words: tuple[str, ...] = ()
    arity: Mapping[str, int] = field(default_factory=dict)
    own_words: frozenset[str] = frozenset()
    """All words of the text."""


NO_FILE = File()
"""Nothing is known of the file."""


def edits(
    statement: ast.stmt,
    file: File = NO_FILE,
    rare: bool = False,
    runs: Callable[[ast.stmt], bool] = lambda one: True,
) -> list[Edit]:
    """Return single slips of a top-level statement, the lightest first: with `rare` those above RARE, else the others.

    `runs(statement)`: whether it is one that matters. Names in scope are those of a function, or of a class's method.
    """
    made: list[Edit] = []
    for unit in _units(statement):
        scope = Scope(unit, file)
        nodes = list(_running(unit, runs))
        by_node = {id(node): [Edit(words, weight, node, new) for words, weight, new in _of_node(node, scope)]
                   for node in nodes}  # fmt: skip
        of_blocks = [edit for n in nodes for block in blocks(n) for edit in _in_block(block)]
        made += [e for e in itertools.chain(*by_node.values(), of_blocks) if _binds_own_names(e, scope)]
        groups = [*_repeated(unit), *_counterparts(scope)]
        made += [e for group in groups for e in _at_all(group, by_node) if not e.operator.startswith("the sign")]
    made = [edit for edit in made if (edit.weight > RARE) == rare and not same(edit.old, edit.new)]
    return sorted(made, key=lambda e: e.weight)


def is_setting(node: ast.expr) -> bool:
    """A number of steps, or a library's constant: with another sign it switches something off, by accident."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int) and node.value > MOST_DIMENSIONS
    return isinstance(node, ast.Attribute) and node.attr.isupper()


class Scope:
    """The names of a function, and where its values stand."""

    def __init__(self, unit: ast.stmt, file: File) -> None:
        self.file, self.numpy = file, template(file.numpy)
        nodes = list(code(unit))
        called = {n.func.id for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        self.stored = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        self.stored |= {n.arg for n in nodes if isinstance(n, ast.arg)}
        self.names = sorted(self.stored - called - {"self", "_"})
        self.parents = {id(child): n for n in [unit, *nodes] for child in ast.iter_child_nodes(n)}
        self.values = {id(value) for n in nodes for value in _values(n)}
        read = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
        self.unread = [name for name in self.names if name not in read]
        self.loops = {name for n in nodes if isinstance(n, ast.For) for name in names_in(n.target)} - {"_"}
        self.arguments = {n.arg for n in nodes if isinstance(n, ast.arg)}
        self.stores = [n for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
        divisors = (n.right for n in nodes if isinstance(n, ast.BinOp) and isinstance(n.op, ast.Div))
        self.divisors = {ast.unparse(n): n for n in divisors if not isinstance(n, ast.Constant)}
        self.attributes: dict[str, set[str]] = {}
        self.entries: dict[str, int] = {}
        """By what is indexed: the largest number that it is indexed by."""
        self.donors = dict.fromkeys(self._donors(nodes))
        lists: list[Sequence[ast.AST]] = [block for n in [unit, *nodes] for block in blocks(n)]
        lists += [n.elts for n in nodes if isinstance(n, ast.Tuple | ast.List)]
        self.parallel = list(_parallel(lists))

    def _donors(self, nodes: Iterable[ast.AST]) -> Iterator[str]:
        for n in nodes:
            if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name):
                if not (self.is_module(n) or self.is_called(n)):
                    self.attributes.setdefault(n.value.id, set()).add(n.attr)
                    yield ast.unparse(n)
            elif isinstance(n, ast.Subscript) and isinstance(n.slice, ast.Constant):
                text, index = ast.unparse(n.value), n.slice.value
                if isinstance(index, int):
                    self.entries[text] = max(index, self.entries.get(text, 0))
                elif isinstance(n.value, ast.Name):
                    yield from (f"{text}[{word!r}]" for word in self.file.words)

    def is_called(self, node: ast.AST) -> bool:
        parent = self.parents.get(id(node))
        return isinstance(parent, ast.Call) and parent.func is node

    def indexed(self, node: ast.AST) -> ast.Subscript | None:
        """What the node is an index of, alone or beside others; or the entry whose array it is."""
        parent = self.parents.get(id(node))
        around = self.parents.get(id(parent)) if isinstance(parent, ast.Tuple) else parent
        return around if isinstance(around, ast.Subscript) else None

    def loops_around(self, node: ast.AST) -> Iterator[ast.For]:
        """The loops around the node, the innermost first."""
        around = self.parents.get(id(node))
        while around is not None:
            if isinstance(around, ast.For):
                yield around
            around = self.parents.get(id(around))

    def is_module(self, node: ast.AST) -> bool:
        """`np`, `np.linalg`, `cv2`: a name that is none of the function's, and what it has."""
        while isinstance(node, ast.Attribute):
            node = node.value
        return isinstance(node, ast.Name) and node.id in MODULES | {self.file.numpy}


def _of_node(node: ast.AST, scope: Scope) -> Found:
    if isinstance(getattr(node, "ctx", None), ast.Store | ast.Del) and not isinstance(node, ast.Tuple | ast.List):
        return
    if isinstance(node, ast.expr):
        yield from rewritten(node, scope.numpy)
    for kind, operator in OPERATORS:
        if isinstance(node, kind):
            yield from operator(node, scope)


# ------------------------------------------------------------------------------------------ expressions


def _around(node: ast.expr, scope: Scope) -> Found:
    """What may be missing around the value, or beside it."""
    parent = scope.parents.get(id(node))
    called = ast.unparse(parent.func).rpartition(".")[2] if isinstance(parent, ast.Call) else ""
    if id(node) not in scope.values or is_text(node) or scope.is_module(node):
        return
    if called in ("isfinite", "isnan", "isinf", "range"):
        return  # a value that becomes NaN there, or a loop that never runs, is an accident
    whole = isinstance(parent, ast.Assign | ast.Return)
    if isinstance(parent, ast.Assign) and isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
        yield "a copy is missing", COPIED, filled("A.copy()", A=node)
    signed = isinstance(node, ast.UnaryOp) or is_setting(node) or scope.indexed(node) is not None
    signed |= isinstance(parent, ast.Compare) and isinstance(parent.ops[0], ast.Eq)  # it would never hold
    squared = isinstance(parent, ast.BinOp) and (isinstance(parent.op, ast.Pow) or same(parent.left, parent.right))
    for words, weight, _, forms in rows_for(None):
        for one in forms:
            number = isinstance(node, ast.Constant) and any(sign in one for sign in ("NP", "[", ".", "**"))
            # The square of what is divided by its own length is 1.
            if not (number or (signed and one == "-A") or (squared and "norm" in one)):
                yield words, weight, filled(one, A=node, NP=scope.numpy)
    tests = isinstance(node, ast.Compare) or (isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd))
    for name in scope.names if tests and not isinstance(parent, ast.BinOp) else ():
        yield f"the condition `{name} > 0` is missing", RARE, filled("A & (B > 0)", A=node, B=template(name))
    if isinstance(parent, ast.Compare):
        yield from (("the wrong value is compared", FAR, template(name)) for name in scope.names)
    alone = not isinstance(parent, ast.Call | ast.Compare)
    for text in [] if isinstance(node, ast.Constant) else dict.fromkeys([*scope.names, *scope.donors]):
        if text != ast.unparse(node) and (alone or text in scope.donors):
            unread = alone and text in scope.unread
            weight = COPIED if unread else RARE if alone and whole and text in scope.names else FAR
            for word, one in MISSING_BESIDE if alone else MISSING_BESIDE[:3]:
                yield f"the {word} `{text}` is missing", weight, filled(one, A=node, B=template(text))


def _conditions(n: ast.BoolOp, scope: Scope) -> Found:
    for name in scope.names if isinstance(n.op, ast.And) else ():
        more = filled("A > 0", A=template(name))
        yield f"the condition `{name} > 0` is missing", RARE, ast.BoolOp(n.op, [*n.values, more])


def _call(n: ast.Call, scope: Scope) -> Found:
    base, _, called = ast.unparse(n.func).rpartition(".")
    for i, j in itertools.combinations(range(len(n.args)), 2):
        yield "two arguments are swapped", USUAL, changed(n, args=_swapped(n.args, i, j))
    for one in [*n.args[:3], *([n.func.value] if isinstance(n.func, ast.Attribute) else [])]:
        if not (isinstance(one, ast.Constant) or scope.is_module(one)):
            yield f"remove `{called}`", USUAL, one
    for other in SIMILAR.get(called, ()):
        yield f"`{called}` should be `{other}`", USUAL, _calling(n, other)
    for other, count in scope.file.arity.items() if not base and called in scope.file.arity else ():
        if other != called and count == scope.file.arity[called]:
            weight = USUAL if other.partition("_")[0] == called.partition("_")[0] else RARE
            yield f"call `{other}`, not `{called}`", weight, _calling(n, other)
    for k, keyword in enumerate(n.keywords):
        weight = COPIED if keyword.arg == "dtype" else USUAL
        rest = n.keywords[:k] + n.keywords[k + 1 :]
        yield f"remove the argument `{keyword.arg}`", weight, changed(n, keywords=rest)
    if called in TYPED and all(k.arg != "dtype" for k in n.keywords):
        weight = COPIED if called.endswith("_like") else USUAL
        typed = changed(n, keywords=[*n.keywords, ast.keyword("dtype", template("float"))])
        yield "the array holds only whole numbers", weight, typed
    if called in OVER_AN_AXIS:
        yield from _axes(n, called)


def _axes(n: ast.Call, called: str) -> Found:
    others = [k for k in n.keywords if k.arg not in ("axis", "keepdims")]
    given = len(n.args) > 1 and (isinstance(n.args[1], ast.Constant) or (called == "norm" and len(n.args) == 2))
    for number, kept in itertools.product((-1, 0, 1, 2), ([], [ast.keyword("keepdims", template("True"))])):
        keywords = [*others, ast.keyword("axis", template(str(number))), *kept]
        args = n.args[:1] if given else n.args
        yield "it runs over the wrong axis, or over all axes", COPIED, changed(n, args=args, keywords=keywords)


def _calling(n: ast.Call, name: str) -> ast.Call:
    """The call, of another function or method."""
    return changed(n, func=changed(n.func, **{"attr" if isinstance(n.func, ast.Attribute) else "id": name}))


def _swapped(items: Sequence[Any], i: int, j: int) -> list[Any]:
    made = list(items)
    made[i], made[j] = made[j], made[i]
    return made


def _sequence(n: ast.Tuple | ast.List, scope: Scope) -> Found:
    """Another order: two swapped, one put elsewhere, or all reversed."""
    count = len(n.elts)
    orders = [_swapped(n.elts, i, j) for i, j in itertools.combinations(range(count), 2)]
    orders += [n.elts[::-1]] * (count > 3)
    for i, j in itertools.permutations(range(count), 2) if 2 < count <= 6 else ():
        if abs(i - j) > 1:
            rest = n.elts[:i] + n.elts[i + 1 :]
            orders.append([*rest[:j], n.elts[i], *rest[j:]])
    yield from (("the entries are in the wrong order", USUAL, changed(n, elts=order)) for order in orders)


def _constant(n: ast.Constant, scope: Scope) -> Found:
    value, parent = n.value, scope.parents.get(id(n))
    if isinstance(value, bool):
        yield f"write `{not value}`, not `{value}`", USUAL, template(repr(not value))
    elif value is None and isinstance(parent, ast.Call):
        yield from ((f"`{name}` is missing", USUAL, template(name)) for name in scope.names)
    elif isinstance(value, int | float):
        yield from _number(n, value, parent, scope)
    elif isinstance(value, str) and isinstance(parent, ast.Compare | ast.Subscript):
        kind = "word" if isinstance(parent, ast.Compare) else "entry"
        yield from ((f"this is the wrong {kind}", FAR, template(repr(word))) for word in scope.file.words)


def _number(node: ast.Constant, value: float, parent: ast.AST | None, scope: Scope) -> Found:
    if isinstance(parent, ast.Call) and ast.unparse(parent.func) == "range":
        # A loop that never runs mends nothing.
        others: tuple[float, ...] = (value + 1, value - 1) if value > 1 else (0, value + 1)
    elif isinstance(value, int):
        others = (0, 1, 2, value + 1, value - 1, -value, 3, 4, 2 * value, value / 2, 100)
    else:
        others = (0.0, 1.0, value / 10, value * 10, 1e-3 * value, 2 * value, value / 2, -value)
        if abs(value - 3.14159265) < 0.2:
            yield "pi has too few digits", COPIED, filled("NP.pi", NP=scope.numpy)
    if isinstance(parent, ast.Compare) and value == 0:
        yield "this should be infinity", RARE, filled("NP.inf", NP=scope.numpy)
    around = scope.indexed(node)
    used = 0 if around is None else scope.entries.get(ast.unparse(around.value), 0)
    for other in dict.fromkeys((*others, *range(used + 2 if used > 2 else 0))):
        # A term times 0, or a 0 divided, is a term dropped.
        product = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mult | ast.Div | ast.Pow)
        if other != value and not (other == 0 and product):
            near = around is not None and (abs(other - value) == 1 or 0 <= other <= used + 1)
            weight = USUAL if near or {value, other} <= {0, 1, 2} else RARE
            yield "the number is wrong", weight, template(repr(other))


def _attribute(n: ast.Attribute, scope: Scope) -> Found:
    others = scope.attributes.get(ast.unparse(n.value), set())
    for other in sorted(others - {n.attr}) if n.attr in others else ():
        yield f"`{n.attr}` should be `{other}`", _apart(n.attr, other), changed(n, attr=other)


def _name(n: ast.Name, scope: Scope) -> Found:
    around = [name for loop in scope.loops_around(n) for name in names_in(loop.target)]
    leftover = n.id in scope.loops and n.id not in around
    for other in scope.names if n.id in scope.names else ():
        words, weight = f"`{n.id}` should be `{other}`", _apart(n.id, other)
        if leftover and weight > USUAL:
            words, weight = f"`{n.id}` is left over from a loop: it should be `{other}`", USUAL
        elif other in scope.unread and weight > USUAL:
            words, weight = f"{words}, which is never used", USUAL
        if other != n.id:
            yield words, weight, template(other)


def _apart(a: str, b: str) -> float:
    """Return the weight of one name for the other: least for p1 and p2 or x and y, then for x and xd."""
    letters = {frozenset((x, y)) for x, y in zip(a, b, strict=False) if x != y}
    alike = len(a) == len(b) and len(letters) == 1
    if frozenset((a, b)) in COUNTERPARTS or (alike and letters <= COUNTERPARTS):
        return COPIED
    beginning = (a.startswith(b) or b.startswith(a)) and abs(len(a) - len(b)) <= 2
    return USUAL if alike or len(a) == len(b) == 1 or beginning else FAR


def _hiding(n: ast.For | ast.ListComp | ast.GeneratorExp, scope: Scope) -> Found:
    """The loop's variable has the name of another value, which is wanted behind the loop, or at one place in it."""
    own, target = all_names(n), n.target if isinstance(n, ast.For) else n.generators[0].target
    elsewhere = scope.arguments | {one.id for one in scope.stores if not any(one is other for other in own)}
    for name in sorted(names_in(target) & elsewhere):
        places = [one for one in own if one.id == name]
        read = [one for one in places if isinstance(one.ctx, ast.Load)]
        for kept in [
            *([None] if isinstance(n, ast.For) else []),
            *(read if 1 < len(read) <= MAX_NAMES else []),
        ]:
            made = copy.deepcopy(n)
            for one, like in zip(places, [one for one in all_names(made) if one.id == name], strict=True):
                like.id = name if one is kept else f"{name}_"
            yield f"the loop's `{name}` overwrites the earlier `{name}`", RARE, made


# ------------------------------------------------------------------------------------------ statements


def _assigned(target: ast.expr, value: ast.expr) -> ast.Assign:
    return ast.Assign([changed(target, ctx=ast.Store())], value)


def _assign(n: ast.Assign, scope: Scope) -> Found:
    target, value = n.targets[0], n.value
    yield TOO_MANY, FAR, [ast.Pass()]
    for text, divisor in scope.divisors.items():
        yield f"the divisor `{text}` is missing", RARE, changed(n, value=filled("A / B", A=value, B=divisor))
    used = sorted(names_in(value).intersection(scope.names))
    for one, two in itertools.combinations(used, 2) if len(used) <= MAX_NAMES else ():
        yield f"`{one}` and `{two}` are swapped", RARE, changed(n, value=renamed(value, {one: two, two: one}))
    if isinstance(target, ast.Subscript) and ast.unparse(target.slice) in (":", "..."):
        yield SHARED, COPIED, _assigned(target.value, value)
    if isinstance(target, ast.Subscript) and isinstance(inner := target.value, ast.Subscript):
        place = changed(inner, slice=filled("A[B]", A=inner.slice, B=target.slice))
        yield "a copy of the entries is changed, not the array", COPIED, _assigned(place, value)
    if isinstance(value, ast.Tuple) and all(isinstance(one, ast.Name) for one in value.elts):
        copies = [filled("A.copy()", A=one) for one in value.elts]
        yield "a copy is missing", COPIED, changed(n, value=changed(value, elts=copies))
    if isinstance(target, ast.Name | ast.Subscript):
        in_loop = next(scope.loops_around(n), None) is not None
        for op in (ast.Add(), ast.BitAnd(), ast.BitOr(), ast.Mult(), ast.Sub())[: 5 if in_loop else 1]:
            yield REPLACED, USUAL, ast.AugAssign(target, op, value)
        for least in ("minimum", "maximum") if in_loop else ():
            both = filled(f"NP.{least}(A, B)", A=changed(target, ctx=ast.Load()), B=value, NP=scope.numpy)
            yield REPLACED, USUAL, changed(n, value=both)


def _augmented(n: ast.AugAssign, scope: Scope) -> Found:
    loaded = changed(n.target, ctx=ast.Load())
    if isinstance(n.target, ast.Name):
        yield SHARED, COPIED, ast.Assign([n.target], ast.BinOp(loaded, n.op, n.value))
    yield TOO_MANY, RARE, [ast.Pass()]
    yield "the value is added to the old one instead of replacing it", RARE, ast.Assign([n.target], n.value)
    for words, weight, other in rewritten(ast.BinOp(loaded, n.op, n.value), scope.numpy):
        if isinstance(other, ast.BinOp) and (other.left, other.right) == (loaded, n.value):
            yield words, weight, changed(n, op=other.op)


def _expression(n: ast.Expr, scope: Scope) -> Found:
    one = n.value
    if isinstance(one, ast.Compare) and isinstance(one.ops[0], ast.Eq):
        yield "`==` should be `=`", COPIED, _assigned(one.left, one.comparators[0])
    if isinstance(one, ast.Call):
        named = [one.func.value] if isinstance(one.func, ast.Attribute) and not scope.is_module(one.func) else one.args
        if named and isinstance(named[0], ast.Name):
            yield "the result of the call is not used", USUAL, _assigned(named[0], one)
    yield TOO_MANY, RARE, [ast.Pass()]


def _condition(n: ast.If, scope: Scope) -> Found:
    yield "the condition is reversed", USUAL, changed(n, test=ast.UnaryOp(ast.Not(), n.test))
    yield "remove the condition", RARE, list(n.body)
    yield "the condition never holds", RARE, list(n.orelse) or [ast.Pass()]
    if n.orelse:
        yield "the two cases are swapped", USUAL, changed(n, body=n.orelse, orelse=n.body)
        yield "remove the other case", USUAL, changed(n, orelse=[])
    if len(n.body) > 1:
        yield "the last line belongs after the condition", RARE, [changed(n, body=n.body[:-1]), n.body[-1]]
    if any(isinstance(one, ast.In | ast.NotIn) for one in ast.walk(n.test)):
        yield BETWEEN_CALLS, COPIED, list(n.body)


def _loop(n: ast.For | ast.While, scope: Scope) -> Found:
    *others, last = n.body
    if isinstance(last, ast.Return):
        words = "the return is one level too deep: it ends the loop"
        yield words, COPIED, [changed(n, body=others or [ast.Pass()]), last]
    if others:
        yield "the last line belongs after the loop", FAR, [changed(n, body=others), last]
        for one in [s for s in n.body[:3] if isinstance(s, SIMPLE)]:
            yield "the line belongs before the loop", RARE, [one, changed(n, body=[s for s in n.body if s is not one])]


def _jump(n: ast.stmt, scope: Scope) -> Found:
    yield "the loop ends too early", USUAL, [ast.Pass()]
    other = ast.Continue() if isinstance(n, ast.Break) else ast.Break()
    yield f"write `{ast.unparse(other)}` instead", USUAL, [other]


def _return(n: ast.Return, scope: Scope) -> Found:
    if next(scope.loops_around(n), None) is None:
        return
    yield "`return` ends the loop here: write `continue`", COPIED, [ast.Continue()]
    if n.value is not None and not isinstance(n.value, ast.Constant):
        for found, test in ((True, n.value), (False, ast.UnaryOp(ast.Not(), n.value))):
            words = f"it returns after the first value: return early only if that is {found}"
            yield words, USUAL, [ast.If(test, [ast.Return(ast.Constant(found))], [])]


def _function(n: ast.FunctionDef, scope: Scope) -> Found:
    """What a function keeps from one call to the next: a default value that is changed, a cache around it."""
    defaults = n.args.defaults
    for argument, default in zip(n.args.args[len(n.args.args) - len(defaults) :], defaults, strict=True):
        if isinstance(default, ast.List | ast.Dict | ast.Set | ast.Call):
            first = ast.copy_location(_assigned(template(argument.arg), default), n.body[0])
            yield "the default value is kept between calls", USUAL, [changed(n, body=[first, *n.body])]
    if n.decorator_list:
        yield BETWEEN_CALLS, RARE, [changed(n, decorator_list=[])]


OPERATORS: tuple[tuple[Any, Callable[[Any, Scope], Found]], ...] = (
    (ast.expr, _around), (ast.BoolOp, _conditions), (ast.Call, _call), (ast.Tuple | ast.List, _sequence),
    (ast.Constant, _constant), (ast.Attribute, _attribute), (ast.Name, _name),
    (ast.For | ast.ListComp | ast.GeneratorExp, _hiding), (ast.Assign, _assign), (ast.AugAssign, _augmented),
    (ast.Expr, _expression), (ast.If, _condition), (ast.For | ast.While, _loop),
    (ast.Break | ast.Continue, _jump), (ast.Return, _return), (ast.FunctionDef, _function),
)  # fmt: skip
"""Which nodes an operator is for, and the operator."""


# ------------------------------------------------------------------------------------------ lines beside one another


def _in_block(block: list[ast.stmt]) -> Iterator[Edit]:
    """A line that belongs elsewhere."""
    into = "the line belongs inside the loop"
    for k, (one, after) in enumerate(itertools.pairwise(block)):
        if isinstance(one, SIMPLE) and isinstance(after, SIMPLE):
            yield Edit("two lines are in the wrong order", USUAL, one, [changed(after)], ((after, [changed(one)]),))
        for later in block[k + 1 : k + 5] if isinstance(one, ast.Assign) else ():
            if later is not after or not isinstance(after, SIMPLE):
                yield Edit("the line should come later", RARE, one, [ast.Pass()], ((later, [later, one]),))
        if isinstance(one, ast.For | ast.While) and isinstance(after, SIMPLE):
            yield Edit(into, RARE, after, [ast.Pass()], ((one.body[-1], [one.body[-1], after]),))
        if isinstance(after, ast.For | ast.While):
            for before in [s for s in block[max(0, k - 5) : k + 1] if isinstance(s, SIMPLE)]:
                for first in [n.body[0] for n in ast.walk(after) if isinstance(n, ast.For | ast.While)]:
                    yield Edit(into, RARE, first, [before, first], moved=before)
        if isinstance(one, ast.Return):
            yield Edit("it returns too early", COPIED, one, [ast.Pass()])


def _parallel(lists: Iterable[Sequence[ast.AST]]) -> Iterator[tuple[list[ast.AST], list[ast.AST]]]:
    """Lines, or entries of a tuple, that have the form of those before them: two runs beside each other."""
    for items in lists:
        forms = [form(one) for one in items]
        for size in range(1, 1 + min(MAX_LINES_COPIED, len(items) // 2)):
            for k in range(len(items) - 2 * size + 1):
                first, second = slice(k, k + size), slice(k + size, k + 2 * size)
                if forms[first] == forms[second]:
                    yield list(items[first]), list(items[second])


# ------------------------------------------------------------------------------------------ in several places


def _repeated(unit: ast.AST) -> Iterator[list[ast.AST]]:
    """Equal values that a simple statement has several of: a slip that is copied is in all of them."""
    for simple in code(unit):
        if isinstance(simple, ast.Return | SIMPLE):
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


def _at_all(nodes: Sequence[ast.AST], by_node: Mapping[int, list[Edit]]) -> Iterator[Edit]:
    """The edits that all of these nodes have in all of them at once: the same, or for other nodes the same by form."""
    equal = all(same(nodes[0], one) for one in nodes)

    def key(edit: Edit) -> tuple[str, str]:
        by_form = re.sub("`.*?`", "", edit.operator), re.sub(r"\w+", "_", edit.after)
        return (edit.operator, edit.after) if equal else by_form

    edits_of = [[e for e in by_node.get(id(n), []) if isinstance(e.new, ast.AST)] for n in nodes]
    first, *others = [{key(e): e for e in reversed(some)} for some in edits_of]
    for name, edit in reversed(first.items()):
        if all(name in some for some in others):
            also = tuple((some[name].old, some[name].new) for some in others)
            yield Edit(edit.operator, edit.weight + SECOND_PLACE_WEIGHT, edit.old, edit.new, also)


# ------------------------------------------------------------------------------------------ a statement's parts


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


def _binds_own_names(edit: Edit, scope: Scope) -> bool:
    """Whether its statements bind none but names of the innermost function around: another's would no longer be it."""
    some = [one for _, new in edit.parts for one in (new if isinstance(new, list) else [new])]
    stored = {name.rstrip("_") for one in some if isinstance(one, ast.stmt) for name in names_in(one, ast.Store)}
    around: ast.AST | None = edit.old
    while stored and not isinstance(around, ast.FunctionDef | ast.Lambda | None):
        around = scope.parents.get(id(around))
    if not stored or around is None:
        return stored <= scope.stored
    return stored <= names_in(around, ast.Store) | {n.arg for n in ast.walk(around) if isinstance(n, ast.arg)}


def _values(n: ast.AST) -> list[ast.expr]:
    """The values that a node computes with: operands, arguments, what is assigned or returned."""
    some: list[ast.expr | None] = []
    if isinstance(n, ast.BinOp):
        some = [n.left, n.right]
    elif isinstance(n, ast.Call):
        some = [*n.args, n.func.value if isinstance(n.func, ast.Attribute) else None]
    elif isinstance(n, ast.Assign | ast.AugAssign | ast.Return):
        some = [n.value]
    elif isinstance(n, ast.Tuple | ast.List) and isinstance(n.ctx, ast.Load):
        some = [*n.elts]
    elif isinstance(n, ast.Compare):
        some = [n.left, *n.comparators]
    return [one for one in some if one is not None and not isinstance(one, ast.Starred)]
