"""Slips within an expression: operands, signs, brackets, calls and their axes, indices, numbers, names."""

import ast
import itertools
import re
from collections.abc import Iterator, Sequence
from typing import Any

from raytwin.diagnose.edit import changed, fill, names_in, short, template
from raytwin.diagnose.rewritings import EXCHANGED
from raytwin.diagnose.scope import Found, Scope

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
"""Operator -> what was wrong, and the operator that is right."""
SIMILAR: dict[str, list[str]] = {}
for _a, _b in EXCHANGED:
    SIMILAR.setdefault(_a, []).append(_b)
    SIMILAR.setdefault(_b, []).append(_a)
WITHOUT_KEEPDIMS = {"stack", "concatenate", "flip", "cumsum", "argsort", "sort", "repeat", "roll"}
OVER_AN_AXIS = WITHOUT_KEEPDIMS | {
    "sum", "norm", "mean", "min", "max", "argmin", "argmax", "any", "all", "prod", "nanmin", "nanmax", "median",
}  # fmt: skip
TYPED = {"zeros_like", "ones_like", "empty_like", "full", "full_like", "array", "asarray", "arange"}
"""Functions that make whole numbers of whole numbers."""


def binary(n: ast.BinOp, scope: Scope) -> Found:
    a, b = n.left, n.right
    if type(n.op) in OTHER_SIGN:
        words, other = OTHER_SIGN[type(n.op)]
        yield words, 1.0, ast.BinOp(a, other(), b)
    yield f"`{short(b)}` is too many", 1.1, a
    if not isinstance(n.op, ast.Div | ast.Pow):
        yield f"`{short(a)}` is too many", 1.1, b
    if isinstance(n.op, ast.Sub | ast.Div | ast.MatMult | ast.Pow):
        yield "the operands are swapped", 1.1, ast.BinOp(b, n.op, a)
    if isinstance(n.op, ast.Add) and not isinstance(a, ast.BinOp):  # of lists the order counts
        yield "the operands are swapped", 1.6, ast.BinOp(b, n.op, a)
    if isinstance(a, ast.BinOp) and not isinstance(n.op, ast.Pow | ast.MatMult):
        yield "the brackets are wrong", 1.0, ast.BinOp(a.left, a.op, ast.BinOp(a.right, n.op, b))
    if isinstance(b, ast.BinOp):
        yield "the brackets are wrong", 1.1, ast.BinOp(ast.BinOp(a, n.op, b.left), b.op, b.right)
    if isinstance(a, ast.Call) and len(a.args) == 1:
        yield "the brackets end too early", 1.3, changed(a, args=[ast.BinOp(a.args[0], n.op, b)])
    if isinstance(n.op, ast.MatMult):
        inverse = [fill("NP.linalg.inv(A)", NP=template(scope.numpy), A=one) for one in (a, b)]
        yield "the inverse is wanted", 1.1, ast.BinOp(inverse[0], n.op, b)
        yield "the inverse is wanted", 1.1, ast.BinOp(a, n.op, inverse[1])


def square(n: ast.BinOp, scope: Scope) -> Found:
    """One of several squares, each of another name."""
    if isinstance(n.op, ast.Mult) and isinstance(n.left, ast.Name) and ast.unparse(n.left) == ast.unparse(n.right):
        for name in scope.names:
            yield f"`{n.left.id}` stands for `{name}`", 1.5, fill("A * A", A=template(name))


def conditions(n: ast.BoolOp, scope: Scope) -> Found:
    other = ast.Or() if isinstance(n.op, ast.And) else ast.And()
    yield "`and` and `or` are mixed up", 1.0, ast.BoolOp(other, n.values)
    for k, value in enumerate(n.values):
        rest = n.values[:k] + n.values[k + 1 :]
        yield f"the condition `{short(value)}` is too many", 1.3, rest[0] if len(rest) == 1 else ast.BoolOp(n.op, rest)
    for name in scope.names if isinstance(n.op, ast.And) else ():
        more = fill("A > 0", A=template(name))
        yield f"the condition `{name} > 0` is missing", 1.4, ast.BoolOp(n.op, [*n.values, more])


# ------------------------------------------------------------------------------------------ calls


def call(n: ast.Call, scope: Scope) -> Found:
    method = isinstance(n.func, ast.Attribute)
    called = ast.unparse(n.func).rpartition(".")[2]
    for i, j in itertools.combinations(range(len(n.args)), 2):
        yield "arguments are swapped", 1.2, changed(n, args=_swapped(n.args, i, j))
    if len(n.args) == 1 and isinstance(one := n.args[0], ast.BinOp):
        yield "the brackets end too late", 1.05, ast.BinOp(changed(n, args=[one.left]), one.op, one.right)
    for one in [*n.args[:3], *([n.func.value] if isinstance(n.func, ast.Attribute) else [])]:
        if not (isinstance(one, ast.Constant) or scope.is_module(one)):
            yield f"`{called}` is too many", 1.3, one
    for other in SIMILAR.get(called, ()):
        yield f"`{called}` stands for `{other}`", 1.0, _calling(n, other)
    for k, keyword in enumerate(n.keywords):
        weight = 0.9 if keyword.arg == "dtype" else 1.2
        yield (
            f"the argument `{keyword.arg}` is too many",
            weight,
            changed(n, keywords=n.keywords[:k] + n.keywords[k + 1 :]),
        )
    if called in TYPED and all(k.arg != "dtype" for k in n.keywords):
        weight = 0.9 if called.endswith("_like") else 1.3
        yield (
            "it holds whole numbers",
            weight,
            changed(n, keywords=[*n.keywords, ast.keyword("dtype", template("float"))]),
        )
    for text in scope.counted if called == "enumerate" else ():
        count = template(f"len({text})")
        yield "it counts from another number", 1.1, changed(n, args=[n.args[0], count], keywords=[])
    for k, one in enumerate(() if method else n.args):
        if isinstance(one, ast.Call | ast.Attribute | ast.Subscript):
            args = [*n.args[:k], ast.List([], ast.Load()), *n.args[k + 1 :]]
            yield f"`{short(one)}` is too many", 1.1, changed(n, args=args)


def library(n: ast.Call, scope: Scope) -> Found:
    """An argument of OpenCV that says what is done to the points, and was done before, or not yet."""
    for k, one in enumerate(n.args) if ast.unparse(n.func).startswith("cv2.") else ():
        none = [template("None"), template(f"{scope.numpy}.eye(3)")]
        for other in map(template, scope.names) if isinstance(one, ast.Call) else none:
            words = f"`{short(other)}` is wanted, not `{short(one)}`"
            yield words, 1.1, changed(n, args=[*n.args[:k], other, *n.args[k + 1 :]])


def other_functions(n: ast.Call, scope: Scope) -> Found:
    """What else the file calls on the same name, and its own functions of as many arguments."""
    base, _, called = ast.unparse(n.func).rpartition(".")
    for other in sorted(scope.file.methods.get(base, frozenset()) - {called}):
        yield f"`{other}` is wanted, not `{called}`", 1.6, _calling(n, other)
        if len(n.args) > 1:
            yield (
                f"`{other}` is wanted, not `{called}`",
                1.6,
                changed(_calling(n, other), args=n.args[-1:], keywords=[]),
            )
    for other, count in scope.file.arity.items() if not base and called in scope.file.arity else ():
        if other != called and count == scope.file.arity[called]:
            weight = 1.0 if other.partition("_")[0] == called.partition("_")[0] else 1.7
            yield f"`{other}` is wanted, not `{called}`", weight, _calling(n, other)


def indices_of_sum(n: ast.Call, scope: Scope) -> Found:
    """Two letters of one operand of `np.einsum` swapped, or two operands."""
    for k, one in enumerate(n.args):
        if isinstance(one, ast.Constant) and isinstance(one.value, str) and "->" in one.value:
            for term in re.finditer(r"\w+", one.value):
                for i, j in itertools.combinations(range(*term.span()), 2):
                    text = ast.Constant("".join(_swapped(one.value, i, j)))
                    yield "the indices are swapped", 1.0, changed(n, args=[*n.args[:k], text, *n.args[k + 1 :]])


def axis(n: ast.Call, scope: Scope) -> Found:
    """Over another axis; and one more where what was assigned is used: an array for each row in place of one number."""
    assignment = scope.parents.get(id(n))
    target = assignment.targets[0] if isinstance(assignment, ast.Assign) else None
    uses = scope.uses.get(target.id, []) if isinstance(target, ast.Name) else []
    later = [use for use in uses if use.lineno > n.lineno][:4]
    words = "it is over the wrong axis, or over all"
    for weight, over in _axes(n):
        yield words, weight, over
    for weight, over in _axes(n):
        for use in () if any(k.arg == "keepdims" for k in over.keywords) else later:
            yield words, weight + 0.5, over, ((use, fill("A[..., None]", A=use)),)


def _axes(n: ast.Call) -> Iterator[tuple[float, ast.Call]]:
    called = ast.unparse(n.func).rpartition(".")[2]
    if called not in OVER_AN_AXIS:
        return
    others = [k for k in n.keywords if k.arg not in ("axis", "keepdims")]
    given = len(n.args) > 1 and (isinstance(n.args[1], ast.Constant) or (called == "norm" and len(n.args) == 2))
    for number in (-1, 0, 1, 2):
        for kept in ([], [ast.keyword("keepdims", template("True"))])[: 1 if called in WITHOUT_KEEPDIMS else 2]:
            keywords = [*others, ast.keyword("axis", template(str(number))), *kept]
            yield 0.8 + 0.1 * (number == 2), changed(n, args=n.args[:1] if given else n.args, keywords=keywords)


def _calling(n: ast.Call, name: str) -> ast.Call:
    """The call, of another function or method."""
    return changed(n, func=changed(n.func, **{"attr" if isinstance(n.func, ast.Attribute) else "id": name}))


def _swapped(items: Sequence[Any], i: int, j: int) -> list[Any]:
    made = list(items)
    made[i], made[j] = made[j], made[i]
    return made


# ------------------------------------------------------------------------------------------ entries, numbers, names


def attribute(n: ast.Attribute, scope: Scope) -> Found:
    others = scope.attributes.get(ast.unparse(n.value), set())
    for other in sorted(others - {n.attr}) if n.attr in others else ():
        if ((weight := _apart(n.attr, other)) == FAR) == scope.rare:
            yield f"`{n.attr}` stands for `{other}`", weight, changed(n, attr=other)


def sequence(n: ast.Tuple | ast.List, scope: Scope) -> Found:
    """Another order: two swapped, or one put elsewhere."""
    count = len(n.elts)
    if count > 3:
        yield "the order is reversed", 1.1, changed(n, elts=n.elts[::-1])
    for i, j in itertools.combinations(range(count), 2):
        yield "the order is wrong", 1.0, changed(n, elts=_swapped(n.elts, i, j))
    for i, j in itertools.permutations(range(count), 2) if 2 < count <= 6 else ():
        if abs(i - j) > 1:
            rest = n.elts[:i] + n.elts[i + 1 :]
            yield "the order is wrong", 1.2, changed(n, elts=[*rest[:j], n.elts[i], *rest[j:]])


def constant(n: ast.Constant, scope: Scope) -> Found:
    value, parent = n.value, scope.parents.get(id(n))
    if isinstance(value, bool):
        yield "it is the opposite", 1.0, template(repr(not value))
    elif value is None and isinstance(parent, ast.Call):
        yield from ((f"`{name}` is missing", 1.0, template(name)) for name in scope.names)
    elif isinstance(value, int | float):
        yield from _number(n, value, scope)
    elif isinstance(value, str) and isinstance(parent, ast.Compare | ast.Subscript):
        kind = "word" if isinstance(parent, ast.Compare) else "entry"
        for word in scope.words:
            if word != value:
                yield f"another {kind} is wanted", 2.2, template(repr(word))


def _number(node: ast.Constant, value: float, scope: Scope) -> Found:
    parent = scope.parents.get(id(node))
    if isinstance(parent, ast.Call) and ast.unparse(parent.func) == "range":
        # A loop that never runs mends nothing.
        others: tuple[float, ...] = (value + 1, value - 1) if value > 1 else (0, value + 1)
    elif isinstance(value, int):
        others = (0, 1, 2, value + 1, value - 1, -value, 3, 4, 2 * value, value / 2, 100)
    else:
        others = (0.0, 1.0, value / 10, value * 10, 1e-3 * value, 2 * value, value / 2, -value)
        if abs(value - 3.14159265) < 0.2:
            yield "pi is not exact", 0.9, fill("NP.pi", NP=template(scope.numpy))
    if isinstance(parent, ast.Compare) and value == 0:
        yield "infinity is wanted", 1.5, fill("NP.inf", NP=template(scope.numpy))
    around = scope.indexed(node)
    used = 0 if around is None else scope.entries.get(ast.unparse(around.value), 0)
    for other in dict.fromkeys((*others, *range(used + 2 if used > 2 else 0))):
        if other != value:
            small = 1.04 if {value, other} == {0, 1} else 1.2 if other in (0, 1, 2) else 1.8
            beside = 1.1 if around is not None and (abs(other - value) == 1 or 0 <= other <= used + 1) else small
            yield "another number is wanted", beside, template(repr(other))


def loop_variable(n: ast.expr, scope: Scope) -> Found:
    """The loop's variable is wanted, not what stands there; or what it counts begins further on."""
    if isinstance(n, ast.Name) and n.id in scope.loops and not scope.rare:
        for text in dict.fromkeys([*(f"len({one})" for one in scope.counted), *(text for text, _ in scope.donors)]):
            weight = 1.2 if text.startswith("len(") else 1.6
            yield f"the term `{text}` is missing", weight, fill("B + A", A=n, B=template(text))
    elif not (scope.rare or scope.is_module(n) or scope.is_called(n)):
        yield from ((f"`{name}` is wanted", 1.9, template(name)) for name in sorted(scope.loops - names_in(n)))


WITHIN = "the index counts within a part of the array"
"""What may be wrong in a function that is right where the array has one part."""


def index(n: ast.expr, scope: Scope) -> Found:
    """An index that counts within a part: of the chosen entries, or of a tile that begins further on."""
    around = scope.indexed(n)
    if around is None or around.value is n:
        return
    if isinstance(n, ast.Constant) and isinstance(n.value, int):
        yield from ((f"`{name}` is wanted", 1.1, template(name)) for name in sorted(scope.loops))
    if isinstance(n, ast.Name | ast.Subscript):
        for name in sorted(scope.indices - names_in(n)):
            yield WITHIN, 1.0, fill("A[B]", A=template(name), B=n)
        for name in sorted(scope.loops - names_in(n)):
            yield WITHIN, 1.0, fill("A + B", A=template(name), B=n)


OF_PART = "the entries of another part are wanted"


def part(n: ast.Subscript, scope: Scope) -> Found:
    """The entries that another array is read or written at."""
    yield from ((OF_PART, 1.0, changed(n, slice=other)) for text, other in scope.parts.items()
                if text != ast.unparse(n.slice))  # fmt: skip


def other_name(n: ast.Name, scope: Scope) -> Found:
    suspects, leftover = scope.suspects.get(id(n), set()), scope.is_leftover(n)
    for other in scope.names if n.id in scope.names else ():
        words, weight = f"`{n.id}` stands for `{other}`", _apart(n.id, other)
        if other in suspects:
            words, weight = f"in the copied line {words}", 0.85
        elif leftover and weight > 1:
            words, weight = f"{words}: it is what the loop left", 1.0
        elif other in scope.unread and weight > 1:
            words, weight = f"{words}, which nothing reads", 1.0
        if other != n.id and (weight == FAR) == scope.rare:
            yield words, weight, template(other)


COUNTERPARTS = {frozenset(pair.split()) for pair in (
    "x y", "u v", "w h", "i j", "1 2", "near far", "row col", "rows cols", "width height", "origins directions",
    "origin direction",
)}  # fmt: skip
"""Names, and letters in names, that are mixed up."""
FAR = 2.1
"""How far-fetched it is that names stand for each other which are not alike."""


def _apart(a: str, b: str) -> float:
    """How far-fetched it is that one name stands for the other: least of counterparts (p1 and p2), then of x and xd."""
    letters = [(x, y) for x, y in zip(a, b, strict=False) if x != y]
    if len(a) == len(b) and len(set(letters)) == 1 and len(letters) in (1, len(a)):
        return 1.0 if frozenset(letters[0]) in COUNTERPARTS else 1.2
    if frozenset((a, b)) in COUNTERPARTS:
        return 1.0
    beginning = a.startswith(b) or b.startswith(a)
    return 1.2 if len(a) == len(b) == 1 or (beginning and abs(len(a) - len(b)) <= 2) else FAR
