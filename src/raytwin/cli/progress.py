"""Progress on standard error: bars on a terminal, one line a stage elsewhere."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from raytwin.progress import Progress

WORTH_A_LINE = 1.0
"""Seconds: what is done sooner says nothing where there is no terminal."""


@contextmanager
def show_progress() -> Iterator[Progress]:
    """The callback that every job takes."""
    if not sys.stderr.isatty():
        yield lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description:<12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True)) as bars:
        tasks: dict[str, int] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield show


def lines() -> Progress:
    """`calibrate: 14 of 14, 2.3 s`, once a stage is done."""
    started: dict[str, float] = {}

    def show(stage: str, done: int, total: int) -> None:
        now = time.perf_counter()
        begun = started.setdefault(stage, now)
        if done < total:
            return
        del started[stage]
        if now - begun >= WORTH_A_LINE:
            print(f"{stage}: {done} of {total}, {now - begun:.1f} s", file=sys.stderr, flush=True)

    return show
