"""What may be written for what: forms of an expression, and what may be correct in its place.

`A -> B` stands for one way, `A <-> B` for both; `;` separates several forms. In a form A, B, C and D are any
expressions, F is what is called, N a number, V a name or a comparison, S any index or slice, NP is NumPy. `<<` and `>>`
are any two operators. A form that is `A` alone matches every value; its way back ("remove ...") follows from "... is missing".
"""

# ruff: noqa: E501 (a form per line)

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

COPIED, USUAL, RARE, FAR = 0.85, 1.1, 1.6, 2.2
"""Weights: larger is less likely. COPIED: the text itself shows the slip, by a line beside it or a name never read."""

FORMS: Mapping[float, str] = {
    COPIED: """
        use the other entry of the diagonal: A[0, 0] <-> A[1, 1]
        `&` binds more tightly than the comparisons: A > B & C > D -> (A > B) & (C > D)
        `&` binds more tightly than the comparisons: A > B & C < D -> (A > B) & (C < D)
        `&` binds more tightly than the comparisons: A < B & C < D -> (A < B) & (C < D)
        `&` binds more tightly than the comparisons: A <= B & C <= D -> (A <= B) & (C <= D)
        `|` binds more tightly than the comparisons: A < B | C <= D -> (A < B) | (C <= D)
        `and` is for single values, `&` for arrays: A and B -> A & B
        `or` is for single values, `|` for arrays: A or B -> A | B
        `not` is for single values, `~` for arrays: not A -> ~A
        `is` asks for the same object, `==` for the same value: A is B -> A == B
        `is` asks for the same object, `==` for the same value: A is not B -> A != B
        `^` is not a power: A ^ B -> A ** B
        the matrix should not be transposed: A.T -> A
        all entries are the same list: [A] * B -> [A for _ in range(B)]
        there are too few steps: range(A) -> range(100)
        five steps, the default, are too few for a strong lens: cv2.undistortPoints(A, B, C) -> cv2.undistortPoints(A, B, C, criteria=(3, 100, 1e-12))
        five steps, the default, are too few for a strong lens: cv2.undistortPoints(A, B, C) -> cv2.undistortPointsIter(A, B, C, None, None, (3, 100, 1e-12))
        five steps, the default, are too few for a strong lens: cv2.undistortPoints(A, B, C, P=D) -> cv2.undistortPoints(A, B, C, P=D, criteria=(3, 100, 1e-12))
        five steps, the default, are too few for a strong lens: cv2.undistortPoints(A, B, C, P=D) -> cv2.undistortPointsIter(A, B, C, None, D, (3, 100, 1e-12))
        use the rotation vector: A.from_euler(B, C) -> A.from_rotvec(C)
    """,
    USUAL: """
        the sign is wrong: A + B <-> A - B
        the sign is wrong: -A -> A
        it is multiplied instead of divided: A * B -> A / B
        it is divided instead of multiplied: A / B -> A * B
        `&` should be `|`: A & B -> A | B
        `|` should be `&`: A | B -> A & B
        `and` and `or` are mixed up: A and B <-> A or B
        `//` drops the fraction: A // B -> A / B
        `@` multiplies matrices, not entries: A @ B -> A * B
        `%` gives the remainder: A % B -> A // B
        remove `{B}`: A << B -> A
        remove `{A}`: A + B -> B
        remove `{A}`: A - B -> B
        remove `{A}`: A * B -> B
        remove `{A}`: A & B -> B
        remove `{A}`: A @ B -> B
        the operands are swapped: A - B -> B - A
        the operands are swapped: A / B -> B / A
        the operands are swapped: A @ B -> B @ A
        the brackets are wrong: (A << B) >> C -> A << (B >> C)
        the brackets are wrong: A << (B >> C) -> (A << B) >> C
        the brackets are wrong: -A + B <-> -(A + B)
        the brackets are wrong: -A - B <-> -(A - B)
        the brackets are wrong: ~A & B <-> ~(A & B)
        the brackets are wrong: ~A | B <-> ~(A | B)
        the brackets are wrong: (A + B) * C -> A * C + B
        the brackets are wrong: (A + B) / C -> A / C + B
        the brackets are wrong: (A - B) * C -> A * C - B
        the brackets are wrong: (A - B) / C -> A / C - B
        the brackets end too early: F(A) << B -> F(A << B)
        the brackets end too late: F(A << B) -> F(A) << B
        the sum is taken too early: (A + B) @ C -> A @ C + B
        the sum is taken too early: (A - B) @ C -> A @ C - B
        use the inverse: A @ B -> NP.linalg.inv(A) @ B ; A @ NP.linalg.inv(B)
        the matrix is not transposed, or on the wrong side: A @ B -> B @ A.T
        doubling and squaring are confused: 2 * A <-> A ** 2
        doubling and squaring are confused: A * 2 -> A ** 2
        the comparison is reversed: A < B <-> A > B
        the comparison is reversed: A <= B <-> A >= B
        the comparison is reversed: A == B <-> A != B
        the negation is wrong: ~A -> A
        the negation is wrong: not A -> A
        the two cases are swapped: A if B else C -> C if B else A
        the first index is left out: range(A, B) -> range(B)
        the range begins one too early: range(A, B) -> range(A + 1, B)
        the range ends one too early: range(A, B) -> range(A, B + 1)
        the range ends one too late: range(A, B) -> range(A, B - 1)
        the range ends one too early: range(A) -> range(A + 1)
        the range ends one too late: range(A) -> range(A - 1)
        counting starts at 1: NP.arange(A, B) -> NP.arange(B)
        counting starts at 1: NP.arange(1, A + 1) -> NP.arange(A)
        counting starts at the wrong number: enumerate(A, B) -> enumerate(A)
        both ends are included: NP.linspace(A, B, C) -> NP.linspace(A, B - 1, C) ; NP.linspace(A, B, C, endpoint=False)
        rows and columns are mixed up: A.reshape(B, C).T -> A.reshape(C, B)
        rows and columns are mixed up: A.reshape(B, C, D).transpose(1, 0, 2) -> A.reshape(C, B, D)
        rows and columns are swapped: NP.meshgrid(A, B) -> NP.meshgrid(A, B, indexing='ij')
        this should be infinity: NP.zeros(A) -> NP.full(A, NP.inf)
        this should be infinity: NP.zeros_like(A) -> NP.full_like(A, NP.inf, dtype=float)
        this should be infinity: NP.nan -> NP.inf
        this should be infinity: -NP.inf -> NP.inf
        this should be infinity: A > 0 -> A < NP.inf
        this should be infinity: A < 0 -> A < NP.inf
        this should be NaN: NP.zeros(A) -> NP.full(A, NP.nan)
        this should be NaN: NP.zeros_like(A) -> NP.full_like(A, NP.nan, dtype=float)
        this should be NaN: NP.inf -> NP.nan
        the mask selects the wrong entries: A[V] -> A[~V]
        take a column, not a row: A[N] -> A[:, N]
        take a row, not a column: A[:, S] -> A[S]
        the slice takes the wrong entries: A[..., :B] <-> A[..., B:]
        the slice takes the wrong entries: A[:, :B] <-> A[:, B:]
        it is not divided by its last entry: A[:, :2] -> A[:, :2] / A[:, 2:]
        it is not divided by its last entry: A[..., :2] -> A[..., :2] / A[..., 2:]
        float32 has too few digits: NP.float32 -> NP.float64
        a square root is missing: A -> NP.sqrt(A)
        a square is missing: A -> A ** 2
        the sign is wrong: A -> -A
        a bound of 0 is missing: A -> NP.maximum(0, A)
        a division by the length is missing: A -> A / NP.linalg.norm(A, axis=-1, keepdims=True)
        a transpose is missing: A -> A.T
        a factor 2 is missing: A -> 2 * A
        remove a factor 2: A -> A / 2
        a division by pi is missing: A -> A / NP.pi
        remove a division by pi: A -> NP.pi * A
    """,
    RARE: """
        remove `{A}`: A - B -> -B
        the operands are swapped: A + B -> B + A
        the comparison is reversed: A < B <-> A <= B
        the comparison is reversed: A > B <-> A >= B
        the comparison is reversed: A in B <-> A not in B
        the value should not depend on a condition: A if B else C -> A ; C
        remove the condition `{A}`: A and B -> B
        remove the condition `{B}`: A and B -> A
        it is multiplied, not raised to a power: A * B -> A ** B
        it is squared, not cubed: A ** 2 -> A ** 3
        `*` multiplies entries, not matrices: A * B -> A @ B
        counting starts at the wrong number: enumerate(A) -> enumerate(A, 1)
        the entries are stored column by column: A.reshape(B, C) -> A.reshape(B, C, order='F')
        the entries are stored column by column: A.reshape(B, C, D) -> A.reshape(B, C, D, order='F')
        only one of several entries is used: A[N] -> NP.min(A, axis=0) ; NP.max(A, axis=0) ; NP.sum(A, axis=0)
        the slice takes the wrong entries: A[:B] -> A[::B] ; A[:, :B] ; A[B:] ; A[-B:]
        the slice takes the wrong entries: A[B:] -> A[::B] ; A[:, :B] ; A[:B] ; A[-B:]
        the slice takes the wrong entries: A[B:C] -> A[B:C + 1] ; A[B:C - 1] ; A[B + 1:C] ; A[:, :C] ; A[B:] ; A[:C]
        the absolute value is missing: A -> NP.abs(A)
        degrees are used as radians: A -> NP.radians(A)
        a copy is missing: A -> A.copy()
        an axis is missing: A -> A[:, None] ; A[..., None]
        a factor 4 is missing: A -> 4 * A
        use 1 minus the value: A -> 1 - A
        it is off by half a step: A -> A + 0.5 ; A - 0.5
        it is off by one step: A -> A + 1 ; A - 1
        the negation is wrong: A -> ~A
        use the inverse: A -> NP.linalg.inv(A)
    """,
    FAR: """
        remove the index: A[S] -> A
        the order is reversed: A -> A[::-1]
        the channels are reversed: A -> A[..., ::-1]
        use 1 divided by the value: A -> 1 / A
        whole numbers have lost the fraction: A -> A.astype(float)
        rows and columns are swapped: A -> A.transpose(1, 0, 2)
        the sum over an axis is missing: A -> NP.sum(A, axis=-1)
        use the length: A -> NP.linalg.norm(A, axis=-1)
        limit the value to 0 to 1: A -> NP.clip(A, 0, 1)
        use the gamma curve or its inverse: A -> A ** (1 / 2.2) ; A ** 2.2
    """,
}  # fmt: skip

EXCHANGED = (
    "sqrt square", "minimum maximum", "min max", "argmin argmax", "any all", "sin cos", "sin tan", "cos tan",
    "arccos arcsin", "arctan tan", "acos asin", "floor round", "mean sum", "zeros ones", "zeros_like ones_like",
    "radians degrees", "deg2rad rad2deg", "isfinite isinf", "isfinite isnan", "vstack hstack", "logical_and logical_or",
    "sum prod", "floor rint", "nanmin nanmax", "sum max", "minimum fmin", "maximum fmax", "min nanmin", "max nanmax",
    "argmin nanargmin", "min minimum", "max maximum", "inner outer", "outer multiply", "dot cross", "empty zeros",
    "empty_like zeros_like", "isinf isnan", "ceil floor", "append extend",
)  # fmt: skip
"""Functions that are called for one another."""
SIMILAR: dict[str, list[str]] = {}
for _pair in EXCHANGED:
    for _one, _other in (_pair.split(), _pair.split()[::-1]):
        SIMILAR.setdefault(_one, []).append(_other)
COUNTERPARTS = {frozenset(pair.split()) for pair in (
    "x y", "u v", "w h", "i j", "1 2", "near far", "row col", "rows cols", "width height", "origins directions",
    "origin direction",
)}  # fmt: skip
"""Names, and letters in names, that are mixed up."""

Row = tuple[str, float, Any, tuple[str, ...]]


@cache
def rows_for(kind: Any) -> list[Row]:
    """(words, weight, form, what may be correct) of the forms of this kind of node; None: of all values."""
    return [row for row in _rows() if (None if isinstance(row[2], ast.Name) else type(row[2])) is kind]


@cache
def _rows() -> list[Row]:
    rows: list[Row] = []
    for weight, text in FORMS.items():
        for line in text.strip().splitlines():
            words, _, ways = line.strip().partition(": ")
            both = " <-> " in ways
            form, _, others = ways.partition(" <-> " if both else " -> ")
            each = tuple(others.split(" ; "))
            rows.append((words, weight, template(form), each))
            if both or (form == "A" and "is missing" in words):
                back = f"remove {words.removesuffix(' is missing')}" if words.endswith(" is missing") else words
                rows += [(back, weight, template(other), (form,)) for other in each]
    return rows


@cache
def template(text: str) -> Any:
    return ast.parse(text, mode="eval").body


def filled(text: str, **parts: Any) -> Any:
    """The expression `text`, its letters replaced by nodes, `<<` and `>>` by operators."""
    return _filled(template(text), parts)


def _filled(tree: Any, parts: Mapping[str, Any]) -> Any:
    if isinstance(tree, ast.Name):
        return parts.get(tree.id, tree)
    if isinstance(tree, ast.LShift | ast.RShift):
        return parts.get(type(tree).__name__, tree)
    if isinstance(tree, list):
        return [_filled(one, parts) for one in tree]
    if not (isinstance(tree, ast.AST) and tree._fields):
        return tree
    return type(tree)(**{name: _filled(getattr(tree, name), parts) for name in tree._fields})


LETTERS: Mapping[str, Any] = {
    **dict.fromkeys("ABCDF", ast.expr), "N": ast.Constant | ast.UnaryOp, "V": ast.Name | ast.Compare, "S": ast.expr,
}  # fmt: skip


def matches(form: Any, node: Any, parts: dict[str, Any]) -> bool:
    """Whether the node has the form; `parts`, that has NP, gets what its letters stand for."""
    if isinstance(form, ast.Name) and form.id in LETTERS:
        fits = isinstance(node, LETTERS[form.id]) and (form.id == "S" or not isinstance(node, ast.Slice | ast.Starred))
        return fits and not (form.id == "N" and is_text(node)) and same(parts.setdefault(form.id, node), node)
    if isinstance(form, ast.Name) and form.id == "NP":
        return same(parts["NP"], node)
    if isinstance(form, ast.LShift | ast.RShift):
        parts[type(form).__name__] = node
        return isinstance(node, ast.operator)
    if isinstance(form, list):
        fits = isinstance(node, list) and len(form) == len(node)
        return fits and all(matches(one, other, parts) for one, other in zip(form, node, strict=True))
    if not isinstance(form, ast.AST):
        return bool(form == node)
    fields = ((value, getattr(node, name, None)) for name, value in ast.iter_fields(form) if name != "ctx")
    return type(form) is type(node) and all(matches(value, other, parts) for value, other in fields)


def rewritten(node: ast.expr, numpy: ast.expr) -> Iterator[tuple[str, float, Any]]:
    """What may be correct in place of an expression of one of the forms: (what was wrong, weight, that)."""
    kind: Any = type(node)
    for words, weight, form, others in rows_for(kind):
        parts: dict[str, Any] = {"NP": numpy}
        if matches(form, node, parts):
            said = words.format(**{letter: short(parts[letter]) for letter in "AB" if letter in parts})
            yield from ((said, weight, filled(other, **parts)) for other in others)


def same(old: Any, new: Any) -> bool:
    """Whether two nodes, lists of nodes or values are equal."""
    if type(old) is not type(new):
        return False
    if isinstance(old, list):
        return len(old) == len(new) and all(map(same, old, new))
    if isinstance(old, ast.AST):
        return old is new or all(same(getattr(old, name, None), getattr(new, name, None)) for name in old._fields)
    return bool(old == new)


def short(node: ast.AST) -> str:
    """The node's text, cut for a message."""
    text = ast.unparse(node)
    return text if len(text) <= 40 else text[:37] + "..."


def is_text(node: ast.AST) -> bool:
    """Whether it is a text, None or a slice: nothing is computed with these."""
    return isinstance(node, ast.Slice) or (isinstance(node, ast.Constant) and not isinstance(node.value, int | float))
