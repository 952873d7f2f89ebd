"""Progress on standard error: bars on a terminal, one line a stage elsewhere; and in the end what took how long."""

import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from raytwin.cli.terminal import say, say_wrapped
from raytwin.progress import Progress, Stages

WORTH_A_LINE = 5.0
"""Seconds: what is done sooner says nothing where there is no terminal."""

STARTED = time.perf_counter()


@contextmanager
def show_progress() -> Iterator[Stages]:
    """The callback that every job takes."""
    if not sys.stderr.isatty():
        yield Stages(lines())
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    left = TextColumn("left"), TimeRemainingColumn()
    columns = TextColumn("{task.description:<12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), *left
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield Stages(show)


def lines() -> Progress:
    """`detect: 14 of 14, 2.3 s`, once a stage is done."""
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


def print_seconds(stages: Stages, verbose: bool, worth: Mapping[str, str] | None = None) -> None:
    """Print one line of the stages whose result is worth something, or a line per stage, the rest and all of it.

    `worth`: what the result of a stage is worth, beside its seconds. `verbose`: a line per stage of a tenth of a second
    or more, and of those in `worth`.
    """
    worth = worth or {}
    if not verbose:
        parts = [
            f"{stage} {stages.seconds[stage]:.2f} s ({worth[stage]})" for stage in worth if stage in stages.seconds
        ]
        if parts:
            say_wrapped(f"  seconds: {', '.join(parts)}")
        return
    whole = time.perf_counter() - STARTED
    rest = whole - sum(stages.seconds.values())
    found = {k: v for k, v in stages.seconds.items() if k in worth or v >= 0.1}
    for stage, seconds in (found | {"the rest": rest, "in all": whole}).items():
        say(f"  {stage:<10} {seconds:7.2f} s   {worth.get(stage, '')}".rstrip())
