"""What the terminal shows: text whose names cannot move its cursor, change its colours or fake a line, and progress.

A verdict has its colour where the terminal has colours. Progress is on standard error: bars where it is a terminal.
"""

import os
import re
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager

import typer

from raytwin.progress import Stages

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


# ------------------------------------------------------------------------------------------ progress

STARTED = time.perf_counter()
"""When the program began, by the clock of `perf_counter`."""


@contextmanager
def show_progress() -> Iterator[Stages]:
    """The callback that every job takes."""
    if not sys.stderr.isatty():
        yield Stages()
        return
    from rich.console import Console
    from rich.progress import Progress, TaskID

    with Progress(console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield Stages(show)


def print_seconds(stages: Stages, verbose: bool, worth: Mapping[str, str] | None = None) -> None:
    """Print the seconds of the stages whose result is worth something, and what; `verbose`: of all, and in all."""
    worth = worth or {}
    shown = {stage: seconds for stage, seconds in stages.seconds.items() if verbose or stage in worth}
    if verbose:
        shown["in all"] = time.perf_counter() - STARTED
    if shown:
        told = {stage: f" ({result})" for stage, result in worth.items()}
        each = (f"{stage} {seconds:.2f} s{told.get(stage, '')}" for stage, seconds in shown.items())
        say(f"  seconds: {', '.join(each)}")
