"""A limit in seconds for the search for a cause, and what was not tried within it."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

SECONDS = 30.0
"""CPU seconds of this thread, so that a busy machine does not change what is found."""


@dataclass(eq=False)
class Budget:
    """`seconds` from now on by `clock`; `tried` and `untried`: names of mistakes."""

    seconds: float = SECONDS
    clock: Callable[[], float] = time.thread_time
    tried: set[str] = field(default_factory=set)
    untried: set[str] = field(default_factory=set)
    began: float = field(init=False)

    def __post_init__(self) -> None:
        self.began = self.clock()

    @property
    def over(self) -> bool:
        return self.clock() - self.began >= self.seconds

    def cut(self, names: Sequence[str], done: int) -> None:
        """Of the names to be tried only the first `done` were."""
        self.tried.update(names[:done])
        self.untried.update(names[done:])

    @property
    def words(self) -> str:
        """What the search did not try; empty where it tried everything."""
        missed = self.untried - self.tried
        if not missed:
            return ""
        every = len(missed | self.tried)
        return f"the search stopped after {self.seconds:g} s: {len(missed)} of {every} known mistakes were not tried"
