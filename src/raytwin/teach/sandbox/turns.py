"""Turns of submissions that share a limit: the system counts all threads of an ordinary user together."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from raytwin.teach.sandbox.sandbox import Answer

REFUSALS = ("BlockingIOError", "can't start new thread", "Resource temporarily unavailable")
"""What Python says where the system refuses a process or a thread."""


def share_a_limit() -> bool:
    """Whether RLIMIT_NPROC counts what neighbours start: root's submissions have a user each, or no limit."""
    return os.name == "posix" and os.getuid() != 0


def refused(answer: Answer) -> bool:
    """Whether a process or a thread was refused that others than the submission may have taken."""
    return share_a_limit() and any(text in answer.problem for text in REFUSALS)


@contextlib.contextmanager
def turn(alone: bool = False) -> Iterator[None]:
    """Wait for a turn beside this user's other submissions, or `alone`, where those share a limit."""
    with contextlib.ExitStack() as held:
        if share_a_limit():
            path = Path(tempfile.gettempdir()) / f"raytwin-turns-{os.getuid()}"
            with contextlib.suppress(OSError, ImportError):  # another's file, or no locks here: no turns are taken
                import fcntl

                descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
                held.callback(os.close, descriptor)
                fcntl.flock(descriptor, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        yield
