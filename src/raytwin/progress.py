"""Report work in progress: one shape of callback for every job."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str, int, int], None]
"""(stage, steps done, steps in all): called often, must be cheap. A stage ends where its steps are all done."""


def silent(stage: str, done: int, total: int) -> None:
    """No progress shown."""


class Stages:
    """A Progress that remembers the seconds of every stage, in order. One that comes again adds to its seconds.

    A stage that begins while another has not ended is a part of that one: it is shown, and not counted twice.
    """

    def __init__(self, show: Progress = silent) -> None:
        self.seconds: dict[str, float] = {}
        self._show, self._open, self._began = show, "", 0.0

    def __call__(self, stage: str, done: int, total: int) -> None:
        if not self._open:
            self._open, self._began = stage, time.perf_counter()
        if stage == self._open and done >= total:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - self._began
            self._open = ""
        self._show(stage, done, total)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """What happens within is the stage `name`; more of it may come later."""
        self(name, 0, 1)
        yield
        self(name, 1, 1)
