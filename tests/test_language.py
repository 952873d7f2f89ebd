"""Every constant that is a number has a docstring below it: its unit, or its effect."""

import ast
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1] / "src" / "raytwin"


def bare_constants(tree: ast.Module) -> Iterator[str]:
    """Yield the numbers in capitals without a docstring below them."""
    below = {node.lineno for node in tree.body if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)}
    for node in tree.body:
        match node:
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                if name.isupper() and is_number(node.value) and node.end_lineno + 1 not in below:
                    yield f"{node.lineno}: {name}"


def is_number(value: ast.expr | None) -> bool:
    """Whether it is written with numbers alone: 0.1, 1 << 20, -1e-9."""
    parts = ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop
    return value is not None and all(
        isinstance(node, parts) and type(getattr(node, "value", 0)) in (int, float) for node in ast.walk(value)
    )


def test_every_number_says_its_unit_or_its_effect():
    trees = {path.relative_to(SOURCE).as_posix(): ast.parse(path.read_text("utf-8")) for path in SOURCE.rglob("*.py")}
    assert [f"{path}:{line}" for path, tree in trees.items() for line in bare_constants(tree)] == []
