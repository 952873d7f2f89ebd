"""What may be written for what: tables of forms that stand in the place of an expression, around it or beside it.

In a form A, B, C and D are any expressions, N is a number, V a name or a comparison, S any index or slice; NP is NumPy.
"""

import ast
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

from raytwin.diagnose.edit import fill, is_text, same, short, template
from raytwin.diagnose.scope import Found, Scope

BOTH_WAYS: tuple[tuple[str, float, str, str], ...] = (
    ("the brackets are wrong", 1.1, "-A + B", "-(A + B)"),
    ("the brackets are wrong", 1.1, "-A - B", "-(A - B)"),
    ("the brackets are wrong", 1.1, "~A & B", "~(A & B)"),
    ("the brackets are wrong", 1.1, "~A | B", "~(A | B)"),
    ("the comparison is reversed", 1.0, "A < B", "A > B"),
    ("the comparison is reversed", 1.0, "A <= B", "A >= B"),
    ("the comparison is reversed", 1.0, "A == B", "A != B"),
    ("the comparison is reversed", 1.8, "A < B", "A <= B"),
    ("the comparison is reversed", 1.8, "A > B", "A >= B"),
    ("the comparison is reversed", 1.6, "A in B", "A not in B"),
    ("doubled stands for squared, or squared for doubled", 1.1, "2 * A", "A ** 2"),
    ("the other entry of the diagonal is wanted", 0.8, "A[0, 0]", "A[1, 1]"),
    ("other entries are wanted", 1.2, "A[..., :B]", "A[..., B:]"),
    ("other entries are wanted", 1.2, "A[:, :B]", "A[:, B:]"),
)
"""What may be written for one another: in words, how far-fetched, and two forms."""
REWRITINGS: tuple[tuple[Any, ...], ...] = (
    *BOTH_WAYS,
    *((words, weight, right, wrong) for words, weight, wrong, right in BOTH_WAYS),
    ("the sign is wrong", 1.0, "-A", "A"),
    ("it is negated", 1.0, "~A", "A"),
    ("it is negated", 1.0, "not A", "A"),
    ("`{A}` is too many", 1.5, "A - B", "-B"),
    ("the brackets are wrong", 1.2, "(A + B) * C", "A * C + B"),
    ("the brackets are wrong", 1.2, "(A + B) / C", "A / C + B"),
    ("the brackets are wrong", 1.2, "(A - B) * C", "A * C - B"),
    ("the brackets are wrong", 1.2, "(A - B) / C", "A / C - B"),
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
    ("the two cases are swapped", 1.1, "A if B else C", "C if B else A"),
    ("a condition is too many", 1.5, "A if B else C", "A", "C"),
    ("`^` is no power", 0.9, "A ^ B", "A ** B"),
    ("it is multiplied, not raised to a power", 1.7, "A * B", "A ** B"),
    ("doubled stands for squared, or squared for doubled", 1.1, "A * 2", "A ** 2"),
    ("it is squared, not cubed", 1.5, "A ** 2", "A ** 3"),
    ("a product of matrices is wanted", 1.6, "A * B", "A @ B"),
    ("the matrix is not transposed, or on the wrong side", 1.2, "A @ B", "B @ A.T"),
    ("it is transposed", 0.8, "A.T", "A"),
    ("all are one and the same list", 0.9, "[A] * B", "[A for _ in range(B)]"),
    ("it counts from another number", 1.5, "enumerate(A)", "enumerate(A, 1)"),
    ("it counts from another number", 1.3, "enumerate(A, B)", "enumerate(A)"),
    ("the first is left out", 1.2, "range(A, B)", "range(B)"),
    ("it begins one too early", 1.1, "range(A, B)", "range(A + 1, B)"),
    ("it ends one too early", 1.1, "range(A, B)", "range(A, B + 1)"),
    ("it ends one too late", 1.1, "range(A, B)", "range(A, B - 1)"),
    ("it ends one too early", 1.1, "range(A)", "range(A + 1)"),
    ("it ends one too late", 1.1, "range(A)", "range(A - 1)"),
    ("there are too few steps", 0.9, "range(A)", "range(100)"),
    ("it counts from 1", 1.1, "NP.arange(A, B)", "NP.arange(B)"),
    ("it counts from 1", 1.1, "NP.arange(1, A + 1)", "NP.arange(A)"),
    ("both ends are in it", 1.1, "NP.linspace(A, B, C)", "NP.linspace(A, B - 1, C)",
     "NP.linspace(A, B, C, endpoint=False)"),
    ("rows and columns are swapped", 1.3, "NP.meshgrid(A, B)", "NP.meshgrid(A, B, indexing='ij')"),
    ("the order is by columns", 1.6, "A.reshape(B, C)", "A.reshape(B, C, order='F')"),
    ("the order is by columns", 1.6, "A.reshape(B, C, D)", "A.reshape(B, C, D, order='F')"),
    ("rows and columns are mixed up", 1.1, "A.reshape(B, C).T", "A.reshape(C, B)"),
    ("rows and columns are mixed up", 1.1, "A.reshape(B, C, D).transpose(1, 0, 2)", "A.reshape(C, B, D)"),
    ("five steps, the default, are too few for a strong lens", 0.8, "cv2.undistortPoints(A, B, C)",
     "cv2.undistortPoints(A, B, C, criteria=(3, 100, 1e-12))",
     "cv2.undistortPointsIter(A, B, C, None, None, (3, 100, 1e-12))"),
    ("five steps, the default, are too few for a strong lens", 0.8, "cv2.undistortPoints(A, B, C, P=D)",
     "cv2.undistortPoints(A, B, C, P=D, criteria=(3, 100, 1e-12))",
     "cv2.undistortPointsIter(A, B, C, None, D, (3, 100, 1e-12))"),
    ("infinity is wanted", 1.2, "NP.zeros(A)", "NP.full(A, NP.inf)"),
    ("NaN is wanted", 1.2, "NP.zeros(A)", "NP.full(A, NP.nan)"),
    ("NaN is wanted", 1.2, "NP.zeros_like(A)", "NP.full_like(A, NP.nan, dtype=float)"),
    ("infinity is wanted", 1.2, "NP.zeros_like(A)", "NP.full_like(A, NP.inf, dtype=float)"),
    ("NaN is wanted", 1.1, "NP.inf", "NP.nan"),
    ("infinity is wanted", 1.1, "NP.nan", "NP.inf"),
    ("infinity is wanted", 1.1, "-NP.inf", "NP.inf"),
    ("infinity is wanted", 1.2, "A > 0", "A < NP.inf"),
    ("infinity is wanted", 1.2, "A < 0", "A < NP.inf"),
    ("the rotation vector is wanted", 0.9, "A.from_euler(B, C)", "A.from_rotvec(C)"),
    ("the rotation vector is wanted", 1.0, "A.from_quat(B)", "A.from_rotvec(B)"),
    ("the rotation vector is wanted", 1.0, "A.as_euler(B)", "A.as_rotvec()"),
    ("the index is too many", 1.9, "A[S]", "A"),
    ("the others are wanted", 1.2, "A[V]", "A[~V]"),
    ("a column is wanted, not a row", 1.1, "A[N]", "A[:, N]"),
    ("a row is wanted, not a column", 1.1, "A[:, S]", "A[S]"),
    ("one of several is used", 1.5, "A[N]", "NP.min(A, axis=0)", "NP.max(A, axis=0)", "NP.sum(A, axis=0)"),
    ("other entries are wanted", 1.5, "A[:B]", "A[::B]", "A[:, :B]", "A[B:]", "A[-B:]"),
    ("other entries are wanted", 1.5, "A[B:]", "A[::B]", "A[:, :B]", "A[:B]", "A[-B:]"),
    ("other entries are wanted", 1.5, "A[B:C]", "A[B:C + 1]", "A[B:C - 1]", "A[B + 1:C]", "A[:, :C]", "A[B:]", "A[:C]"),
    ("it is not divided by its last entry", 1.2, "A[:, :2]", "A[:, :2] / A[:, 2:]"),
    ("it is not divided by its last entry", 1.2, "A[..., :2]", "A[..., :2] / A[..., 2:]"),
    ("the number is not exact", 1.3, "NP.float32", "NP.float64"),
)  # fmt: skip
"""What may be written for what: in words, how far-fetched, the form, and what may be right instead."""

WRAPS: tuple[tuple[Any, ...], ...] = (
    ("a square root is missing", 1.15, "NP.sqrt(A)"),
    ("a square is missing", 1.15, "A**2"),
    ("the sign is wrong", 1.02, "-A"),
    ("the absolute value is missing", 1.3, "NP.abs(A)"),
    ("a bound of 0 is missing", 1.1, "NP.maximum(0, A)"),
    ("a division by the length is missing", 1.1, "A / NP.linalg.norm(A, axis=-1, keepdims=True)"),
    ("a transpose is missing", 1.05, "A.T"),
    ("degrees are used as radians", 1.6, "NP.radians(A)"),
    ("a copy is missing", 1.4, "A.copy()"),
    ("an axis is missing", 1.4, "A[:, None]", "A[..., None]"),
    ("the order is reversed", 1.8, "A[::-1]"),
    ("the channels are reversed", 1.8, "A[..., ::-1]"),
    ("a factor 2 is missing", 1.2, "2 * A"),
    ("a factor 2 is too many", 1.2, "A / 2"),
    ("pi is missing", 1.3, "A / NP.pi"),
    ("pi is too many", 1.3, "NP.pi * A"),
    ("a factor 4 is missing", 1.5, "4 * A"),
    ("it is its complement", 1.6, "1 - A"),
    ("it is inverted", 1.8, "1 / A"),
    ("half a step is off", 1.6, "A + 0.5", "A - 0.5"),
    ("one step is off", 1.7, "A + 1", "A - 1"),
    ("it is negated", 1.6, "~A"),
    ("it is cut to whole numbers", 1.8, "A.astype(float)"),
    ("rows and columns are swapped", 1.8, "A.transpose(1, 0, 2)"),
    ("the sum over an axis is missing", 1.8, "NP.sum(A, axis=-1)"),
    ("the inverse is wanted", 1.6, "NP.linalg.inv(A)"),
    ("the length is wanted", 1.9, "NP.linalg.norm(A, axis=-1)"),
    ("it is bounded", 2.2, "NP.clip(A, 0, 1)"),
    ("it is encoded", 2.2, "A ** (1 / 2.2)", "A**2.2"),
)
"""What may be missing around a value A: in words, how far-fetched, and what it may be then."""
BESIDE = (
    ("term", 2.6, "A + B"),
    ("term", 2.6, "A - B"),
    ("term", 2.6, "B - A"),
    ("factor", 2.4, "A * B"),
    ("divisor", 2.4, "A / B"),
)
"""What may be missing beside a value A: in words, how far-fetched, and what it is then."""
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
"""Functions that are called for one another."""


# ------------------------------------------------------------------------------------------ forms


def rewritten(node: ast.expr, scope: Scope) -> Found:
    """What may be right instead of an expression of one of the forms."""
    for words, weight, form, others in _by_kind().get(type(node), ()):
        parts: dict[str, ast.expr] = {}
        if _matches(form, node, parts, scope.numpy):
            said = words.format(**{letter: short(part) for letter, part in parts.items()}) if "{" in words else words
            yield from ((said, weight, fill(other, **parts, NP=template(scope.numpy))) for other in others)


@cache
def _by_kind() -> Mapping[type, list[tuple[str, float, ast.expr, list[str]]]]:
    """The rewritings by the kind of node that they are for; what may be missing around a value may be too many."""
    made: dict[type, list[tuple[str, float, ast.expr, list[str]]]] = {}
    back = [(words.replace("missing", "too many"), weight, form, "A") for words, weight, *forms in WRAPS
            for form in forms if "is missing" in words]  # fmt: skip
    for words, weight, form, *others in (*REWRITINGS, *back):
        tree = template(form)
        made.setdefault(type(tree), []).append((words, weight, tree, others))
    return made


LETTERS: Mapping[str, Any] = {
    **dict.fromkeys("ABCD", ast.expr), "N": ast.Constant | ast.UnaryOp, "V": ast.Name | ast.Compare, "S": ast.expr,
}  # fmt: skip


def _matches(form: Any, node: Any, parts: dict[str, ast.expr], numpy: str) -> bool:
    """Whether the node has the form; `parts` become what its letters stand for."""
    if isinstance(form, ast.Name) and form.id in LETTERS:
        fits = isinstance(node, LETTERS[form.id]) and (form.id == "S" or not isinstance(node, ast.Slice | ast.Starred))
        return fits and not (form.id == "N" and is_text(node)) and same(parts.setdefault(form.id, node), node)
    if isinstance(form, ast.Name) and form.id == "NP":
        return isinstance(node, ast.Name) and node.id == numpy
    if isinstance(form, list):
        fits = isinstance(node, list) and len(form) == len(node)
        return fits and all(_matches(one, other, parts, numpy) for one, other in zip(form, node, strict=True))
    if not isinstance(form, ast.AST):
        return bool(form == node)
    return type(form) is type(node) and all(
        _matches(value, getattr(node, name, None), parts, numpy)
        for name, value in ast.iter_fields(form) if name != "ctx"
    )  # fmt: skip


# ------------------------------------------------------------------------------------------ around a value

ASKING = ("isfinite", "isnan", "isinf")
MOST_DIMENSIONS = 4
"""Whole numbers up to this one count axes, powers and factors; larger ones are steps or sizes."""
WHOLE = 0.9
"""By so much less far-fetched is it that a name is missing beside all that is assigned."""
UNREAD = 1.35
"""By so much less far-fetched is it that a name is missing which nothing reads."""


def is_setting(node: ast.expr) -> bool:
    """A number of steps, or a library's constant: with another sign it switches something off, by accident."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int) and node.value > MOST_DIMENSIONS
    return isinstance(node, ast.Attribute) and node.attr.isupper()


def wrapped(node: ast.expr, scope: Scope) -> Found:
    """What may be missing around the value, or beside it."""
    parent = scope.parents.get(id(node))
    called = ast.unparse(parent.func).rpartition(".")[2] if isinstance(parent, ast.Call) else ""
    if id(node) not in scope.values or is_text(node) or scope.is_module(node) or called in ASKING or called == "range":
        return  # a value that becomes NaN there, or a loop that never runs, is an accident
    if isinstance(parent, ast.Assign) and isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
        # Any change there makes a copy, too.
        yield "a copy is missing", 0.7, fill("A.copy()", A=node)
    signed = isinstance(node, ast.UnaryOp) or is_setting(node) or scope.indexed(node) is not None
    for words, weight, *forms in WRAPS:
        for form in forms:
            number = isinstance(node, ast.Constant) and any(sign in form for sign in ("NP", "[", ".", "**"))
            if not number and not (signed and form == "-A"):
                yield words, weight, fill(form, A=node, NP=template(scope.numpy))
    tests = isinstance(node, ast.Compare) or (isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd))
    for name in scope.names if tests and not isinstance(parent, ast.BinOp) else ():
        yield f"the condition `{name} > 0` is missing", 1.4, fill("A & (B > 0)", A=node, B=template(name))
    if scope.rare and isinstance(parent, ast.Compare):
        yield from (("another value is compared", 2.3, template(name)) for name in scope.names)
    if isinstance(node, ast.Constant):
        return
    alone = not isinstance(parent, ast.Call | ast.Compare)
    whole = isinstance(parent, ast.Assign | ast.Return)
    names = [(name, template(name)) for name in scope.names if name not in scope.unread]
    if scope.rare:
        yield from _beside(node, [*(names if alone and not whole else ()), *scope.donors], alone)
    elif alone:
        yield from _beside(node, [(name, template(name)) for name in scope.unread], alone, UNREAD)
        yield from _beside(node, names if whole else (), alone, WHOLE)


def _beside(node: ast.expr, donors: Iterable[tuple[str, ast.expr]], alone: bool, less: float = 0.0) -> Found:
    """What is missing beside the value: a term, or a factor or divisor where it stands alone."""
    for text, donor in donors:
        if text != ast.unparse(node):
            for word, weight, form in BESIDE if alone else BESIDE[:3]:
                yield f"the {word} `{text}` is missing", weight - less, fill(form, A=node, B=donor)
