"""The language of the source: sentences begin with their subject, constants say their unit, names are the field's."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[1] / "src" / "raytwin"
PRIVATE = {"told", "tell", "held", "kept"}
"""Words that could mean a message, a record, a check, a cache: the field has a word for each."""


def docstrings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Every text that stands alone: under a definition, or under a constant."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value


def bare_constants(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Numbers in capitals without a docstring below them."""
    texts = {line for line, _ in docstrings(tree)}
    for node in tree.body:
        match node:
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                if name.isupper() and is_number(node.value) and node.end_lineno + 1 not in texts:
                    yield node.lineno, name


def is_number(value: ast.expr | None) -> bool:
    """Whether it is written with numbers alone: 0.1, 1 << 20, -1e-9."""
    parts = ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop
    return value is not None and all(
        isinstance(node, parts) and type(getattr(node, "value", 0)) in (int, float) for node in ast.walk(value)
    )


def bound_names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.alias(asname=str(name)):
                yield node.lineno, name
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name) if name != "kept":
                yield node.lineno, name


def found(tree: ast.Module) -> list[str]:
    """What is wrong in one file."""
    return [
        *(f"{line}: a docstring begins with Of" for line, text in docstrings(tree) if text.lstrip().startswith("Of ")),
        *(f"{line}: {name} has no unit or effect below it" for line, name in bare_constants(tree)),
        *(f"{line}: {n} is no word of the field" for line, n in bound_names(tree) if n.strip("_").lower() in PRIVATE),
    ]


def test_the_source_is_written_in_the_fields_language():
    trees = {path.relative_to(SOURCE).as_posix(): ast.parse(path.read_text("utf-8")) for path in SOURCE.rglob("*.py")}
    assert [f"{path}:{line}" for path, tree in trees.items() for line in found(tree)] == []


@pytest.mark.parametrize(
    ("source", "wrong"),
    [
        ('"""Of the cost."""', 1), ('def f():\n    """Of it."""', 1), ("A = 1 << 20", 1), ("A: int = -3", 1),
        ("def kept():\n    told = 1", 2), ("class Held: ...", 1), ("import x as tell", 1), ("def f(_told): ...", 1),
        ('A = 1\n"""Metres."""', 0), ("A = 1 + B", 0), ("A = 'x'", 0), ("a = 1", 0), ("print(told)", 0),
    ],
)  # fmt: skip
def test_each_pattern_is_found_where_it_is(source, wrong):
    assert len(found(ast.parse(source))) == wrong
