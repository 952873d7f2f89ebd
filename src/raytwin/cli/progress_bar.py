"""Progress on standard error: bars where it is a terminal; and in the end what took how long."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from raytwin.cli.terminal import say
from raytwin.progress import Stages


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


def print_seconds(stages: Stages, worth: Mapping[str, str]) -> None:
    """Print the seconds of the stages whose result is worth something, and what."""
    told = ((stage, said) for stage, said in worth.items() if stage in stages.seconds)
    say(f"  seconds: {', '.join(f'{stage} {stages.seconds[stage]:.2f} s ({said})' for stage, said in told)}")
