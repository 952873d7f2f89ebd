"""What the terminal shows: text whose names cannot move its cursor, change its colours or fake a line.

A verdict has its colour where the terminal has colours.
"""

import os
import re
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
    """Print lines.

    File, scene and student names are a stranger's text: only `say` prints in this package.
    """
    shown = VERDICT.sub(lambda word: typer.style(word[1], COLOURS[word[1]], bold=True), printable(str(text)))
    typer.echo(shown, err=err, color=False if "NO_COLOR" in os.environ else None)


def worst_code(codes: Iterable[int]) -> int:
    """Return the exit code of many comparisons: one that failed is a failure, whatever else could not be decided."""
    known = set(codes)
    return 1 if 1 in known else max(known, default=0)
