"""What the terminal shows: text whose names cannot move its cursor, change its colours or fake a line.

A verdict has its colour where the terminal has colours, and sentences are broken at its width.
"""

import os
import re
import shutil
import textwrap
from collections.abc import Iterable

import typer

COLOURS = {"PASS": "green", "DIFFERS": "green", "FAIL": "red", "ERROR": "red", "UNDECIDED": "yellow"}
"""First word of a line -> its colour."""
VERDICT = re.compile(rf"^({'|'.join(COLOURS)})(?=  )", re.MULTILINE)


def printable(text: str) -> str:
    r"""Replace every character that is not printable by its escape; line ends and tabs stay.

    >>> printable("a\x1b[31mb\n")
    'a\\x1b[31mb\n'
    """
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


def say(text: object, err: bool = False) -> None:
    """Print lines, broken at the terminal's width and indented below their first; a pipe gets them whole.

    File, scene and student names are a stranger's text: only `say` prints in this package.
    """
    shown = printable(str(text))
    if width := shutil.get_terminal_size((0, 0)).columns:
        shown = "\n".join(_broken(line, width) for line in shown.split("\n"))
    shown = VERDICT.sub(lambda word: typer.style(word[1], COLOURS[word[1]], bold=True), shown)
    typer.echo(shown, err=err, color=False if "NO_COLOR" in os.environ else None)


def _broken(line: str, width: int) -> str:
    indent = line[: len(line) - len(line.lstrip())] + "  "
    return textwrap.fill(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def worst_code(codes: Iterable[int]) -> int:
    """Return the exit code of many comparisons: one that failed is a failure, whatever else could not be decided."""
    known = set(codes)
    return 1 if 1 in known else max(known, default=0)
