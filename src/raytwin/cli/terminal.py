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
    """Print a line. File, scene and student names are a stranger's text: only `say` prints in this package."""
    shown = VERDICT.sub(lambda word: typer.style(word[1], COLOURS[word[1]], bold=True), printable(str(text)))
    typer.echo(shown, err=err, color=False if "NO_COLOR" in os.environ else None)


def say_wrapped(text: object) -> None:
    """Print sentences, broken at the terminal's width and indented below their first line; a pipe gets them whole."""
    width = shutil.get_terminal_size((0, 0)).columns
    say("\n".join(broken(line, width) if width else line for line in str(text).splitlines()))


def broken(line: str, width: int) -> str:
    r"""Return a line in lines of at most `width` columns, where its words allow.

    >>> broken("  the images agree", 14)
    '  the images\n    agree'
    """
    if len(line) <= width:
        return line
    indent = line[: len(line) - len(line.lstrip())]
    return textwrap.fill(
        line, width, subsequent_indent=f"{indent}  ", break_long_words=False, break_on_hyphens=False,
        drop_whitespace=True, replace_whitespace=False,
    )  # fmt: skip


def worst_code(codes: Iterable[int]) -> int:
    """Return the exit code of many comparisons: one that failed is a failure, whatever else could not be decided."""
    known = set(codes)
    return 1 if 1 in known else max(known, default=0)
