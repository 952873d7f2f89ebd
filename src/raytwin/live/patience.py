"""Calls of a user's function that may never return: the page goes on without their result."""

import threading
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from raytwin.errors import InputError

SECONDS = 20.0
"""Wait for one call of a subject. A picture that takes longer is no live picture: a smaller --size helps."""
MOST_ABANDONED = 3
"""Calls that may run on with nobody waiting. No thread can be stopped from outside, and each takes a core."""

P = ParamSpec("P")
T = TypeVar("T")


class Patience:
    """Run calls in threads of their own. `abandoned`: those that nobody waits for any more."""

    def __init__(self, seconds: float = SECONDS) -> None:
        self.seconds = seconds
        self.abandoned: list[threading.Thread] = []

    @property
    def running(self) -> bool:
        """Whether an abandoned call still runs."""
        self.abandoned = [thread for thread in self.abandoned if thread.is_alive()]
        return bool(self.abandoned)

    def call(self, name: str, function: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> T:
        """Return what the function returns, within `seconds`.

        Raises what it raises, and InputError where it does not return, or where it raises what would end a thread
        without a word (SystemExit, KeyboardInterrupt). `name` is the subject's.
        """
        if self.running and len(self.abandoned) >= MOST_ABANDONED:
            raise InputError(name, "a subject that returns", f"{len(self.abandoned)} calls that still run: restart")
        results: list[T] = []
        errors: list[BaseException] = []

        def work() -> None:
            try:
                results.append(function(*arguments, **options))
            except BaseException as error:
                errors.append(error)

        thread = threading.Thread(target=work, name="subject", daemon=True)
        thread.start()
        thread.join(self.seconds)
        if results:
            return results[0]
        if not errors:
            self.abandoned.append(thread)
            raise InputError(name, f"an image within {self.seconds:g} s (try a smaller --size)", "none yet")
        if isinstance(errors[0], Exception):
            raise errors[0]
        raise InputError(name, "an image (H, W, 3)", f"{type(errors[0]).__name__}: {errors[0]}") from errors[0]
