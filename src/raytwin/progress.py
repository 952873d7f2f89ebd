"""How work in progress is told: one shape of callback for every job."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""(stage, steps done, steps in all): called often, must be cheap. A stage ends where its steps are all done."""


def silent(stage: str, done: int, total: int) -> None:
    """No progress shown."""
