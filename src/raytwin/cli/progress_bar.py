"""Progress on standard error: bars where it is a terminal; and in the end what took how long."""

import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from raytwin.cli.terminal import say
from raytwin.progress import Stages

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
