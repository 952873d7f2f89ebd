"""A limit in seconds for a whole diagnosis."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

SECONDS = 30.0
"""CPU seconds of this thread, so that a busy machine does not change what is found."""

SEARCH = 0.75
"""Share of the seconds after which nothing more is searched: the rest is for checking what was found."""


@dataclass(eq=False)
class Budget:
    """`seconds` from now on by `clock`."""

    seconds: float = SECONDS
    clock: Callable[[], float] = time.thread_time
    began: float = field(init=False)

    def __post_init__(self) -> None:
        self.began = self.clock()

    @property
    def over(self) -> bool:
        """Whether the search has to end."""
        return self.clock() - self.began >= SEARCH * self.seconds

    @property
    def spent(self) -> bool:
        """Whether no time is left at all."""
        return self.clock() - self.began >= self.seconds

    @property
    def words(self) -> str:
        """That the search has ended early; empty where it has not."""
        stopped = f"the search stopped after {SEARCH * self.seconds:g} s: not all known mistakes were tried"
        return stopped if self.over else ""
