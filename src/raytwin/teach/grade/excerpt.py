"""The lines of a submission's own text that its sentences speak of, and a notebook's cells named by what is in them."""

import ast
import re
from collections.abc import Sequence

from msgspec.structs import replace

from raytwin.teach.grade.result import CodeLine, Marked, Result
from raytwin.teach.sandbox.sandbox import Code

LINES_AROUND = 2
"""Lines that are shown before and after the one to look at."""
MAX_LINE_CHARACTERS = 160
"""Characters of a line that are shown."""
LINE_REFERENCE = re.compile(r"(?:(cell \d+), |([^\s,]+\.py), )?line (\d+)")


def with_own_text(result: Result, code: Code) -> Result:
    """Return the result with lines of code, and with cells in words: nobody counts the cells of a notebook."""
    exercises = [replace(m, code=_lines(m, code)) for m in result.exercises]
    if code.cells:
        called = {name: _cell_in_words(text) for name, text in code.cells}
        exercises = [_in_words(m, called) for m in exercises]
        result = replace(result, problem=_said(result.problem, called), notes=_each(result.notes, called))
    return replace(result, exercises=tuple(exercises))


def _lines(m: Marked, code: Code) -> tuple[CodeLine, ...]:
    """The lines that the hint names, or else the error, with their neighbours."""
    found = [place for said in (*m.hints[-1:], *m.sentences) for place in LINE_REFERENCE.findall(said)]
    if m.status == "pass" or not found or (found[0][1] and found[0][1] != code.file.rpartition(" ")[2]):
        return ()
    cell = found[0][0]
    named = {int(n) for where, file, n in found if (where, file) == found[0][:2]}
    text = dict(code.cells).get(cell, "") if code.cells else code.source
    near = {n + k for n in named for k in range(-LINES_AROUND, LINES_AROUND + 1)}
    every = enumerate(text.splitlines(), start=1)
    return tuple(CodeLine(n, line[:MAX_LINE_CHARACTERS], n in named) for n, line in every if n in near)


def _cell_in_words(text: str) -> str:
    """`the cell that defines shade`; of one without definitions, its first line.

    >>> _cell_in_words("import numpy as np"), _cell_in_words("def f(): pass\\ndef g(): pass")
    ('the cell that begins with `import numpy as np`', 'the cell that defines f and g')
    """
    try:
        body = ast.parse(text).body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        body = []
    names = [one.name for one in body if isinstance(one, ast.FunctionDef | ast.ClassDef)]
    if names:
        return f"the cell that defines {' and '.join(names[:2])}"
    first = next((line.strip() for line in text.splitlines() if line.strip()), "")
    return f"the cell that begins with `{first[:40]}`"


def _in_words(m: Marked, called: dict[str, str]) -> Marked:
    parts = tuple(replace(p, problem=_said(p.problem, called)) for p in m.parts)
    same = {"sentences": _each(m.sentences, called), "hints": _each(m.hints, called)}
    return replace(m, parts=parts, mistakes=_each(m.mistakes, called), **same)


def _each(texts: Sequence[str], called: dict[str, str]) -> tuple[str, ...]:
    return tuple(_said(text, called) for text in texts)


def _said(text: str, called: dict[str, str]) -> str:
    text = re.sub(r"(cell \d+), (line \d+)", lambda m: f"{m[2]} of {called.get(m[1], m[1])}", text)
    return re.sub(r"cell \d+", lambda m: called.get(m[0], m[0]), text)
