"""Print how much prose there is per line of source: `python docs/prose.py`, also at the end of `docs/build.py`.

Prose: lines of README.md and of the pages in docs/ (tables that a measurement writes left out), and of the docstrings
in src/raytwin. Source: lines of Python in src/raytwin. Blank lines count nowhere.
"""

import ast
from collections.abc import Iterable
from pathlib import Path

from tables import BLOCK

ROOT = Path(__file__).resolve().parent.parent
GOAL = 0.15
"""Lines of prose per line of source."""


def filled_lines(text: str) -> int:
    """Return how many lines are not blank."""
    return sum(bool(line.strip()) for line in text.splitlines())


def docstrings(source: str) -> Iterable[str]:
    """Yield the docstrings of a module, its classes and functions."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def shares(root: Path = ROOT) -> tuple[float, float]:
    """Return the lines of pages, and of pages and docstrings, per line of source."""
    pages = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    written = sum(filled_lines(BLOCK.sub("", page.read_text(encoding="utf-8"))) for page in pages)
    sources = [path.read_text(encoding="utf-8") for path in sorted((root / "src").rglob("*.py"))]
    within = sum(filled_lines(text) for source in sources for text in docstrings(source))
    lines = sum(map(filled_lines, sources))
    return written / lines, (written + within) / lines


def summary() -> str:
    """Return the shares in a line."""
    pages, prose = shares()
    return f"prose: {100 * prose:.1f} % of the lines of source, {100 * pages:.1f} % in pages (goal {100 * GOAL:.0f} %)"


if __name__ == "__main__":
    print(summary())
