"""A subject's functions in a process of their own: what ends, blocks or moves that process leaves raytwin as it is.

The process is the user's own, with all the user's rights: `grade` locks submissions in, `compare` does not. It is this
file, run as a script, with one end of a socket; what a subject prints goes where raytwin's output goes.
"""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

HINT = "the line to look at"
"""Asked for in place of a function's name."""
POLL = 0.2
"""Seconds between two looks at a process that has not answered: a process it left behind may hold the socket open."""


@dataclass(eq=False)
class SubjectProcess:
    """The submission `text`, loaded in a process that is started when needed, and anew where it has ended."""

    text: str
    _process: "subprocess.Popen[bytes] | None" = None
    _connection: Connection | None = None
    _described: dict[str, Any] = field(default_factory=dict)
    _finalizer: Callable[[], Any] = lambda: None

    def describe(self) -> dict[str, Any]:
        """Return `made` (what `render` is made of, in words) and `functions`: name -> what it takes.

        Raises InputError where the submission cannot be used, SubjectEnded where loading it ends the process.
        """
        if self._process is None or self._process.poll() is not None:
            self._start()
        return self._described

    def call(self, name: str, arguments: tuple[Any, ...], options: dict[str, Any]) -> Any:
        """Return what the function does; raise what it raises, as an exception of that name."""
        self.describe()
        return self._ask((name, arguments, options))

    def hint(self, name: str) -> str:
        """Return the line of a wrong function to look at, and what is wrong there; empty where none is found."""
        return str(self.call(HINT, (name,), {}))

    def close(self) -> None:
        """End the process, and whatever it started: also done when nobody holds this any more, and when Python ends."""
        self._finalizer()
        self._process = self._connection = None

    def _start(self) -> None:
        self.close()
        ours, theirs = socket.socketpair()
        with ours, theirs:
            self._connection = Connection(os.dup(ours.fileno()))
            self._process = subprocess.Popen(
                [sys.executable, "-P", __file__, str(theirs.fileno())], stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()], start_new_session=True,
            )  # fmt: skip
        self._finalizer = weakref.finalize(self, _end, self._process, self._connection)
        self._described = self._ask((sys.path, self.text))

    def _ask(self, request: tuple[Any, ...]) -> Any:
        from raytwin.errors import InputError, SubjectEnded

        assert self._connection is not None
        assert self._process is not None
        try:
            self._connection.send(request)
            while not self._connection.poll(POLL):
                if self._process.poll() is not None and not self._connection.poll():
                    raise EOFError
            kind, answer = self._connection.recv()
        except (EOFError, OSError):
            code = self._process.wait()
            how = f"exit code {code}" if code >= 0 else f"signal {signal.Signals(-code).name}"
            self.close()
            raise SubjectEnded(self.text, "an answer", f"a process that ended with {how} before it gave one") from None
        except KeyboardInterrupt:
            self.close()
            raise
        if kind == "input":
            raise InputError(*answer)
        if kind == "error":
            raise type(answer[0], (Exception,), {})(answer[1])
        return answer


def _end(process: "subprocess.Popen[bytes]", connection: Connection) -> None:
    with contextlib.suppress(OSError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    connection.close()


class SubjectFunction:
    """One function of a SubjectProcess. `takes`: which of seed and samples it takes."""

    def __init__(self, process: SubjectProcess, name: str, takes: set[str]) -> None:
        self._process, self.__name__, self.takes = process, name, takes

    def hint(self) -> str:
        return self._process.hint(self.__name__)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return self._process.call(self.__name__, arguments, options)


# ------------------------------------------------------------------------------------------ within the process


def main(connection: Connection) -> None:
    """Load what is asked for, then answer calls until the other end closes."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    sys.path[:], text = connection.recv()
    functions: dict[str, Callable[..., Any]] = {}
    _answer(connection, lambda: _loaded(text, functions))
    with contextlib.suppress(EOFError):
        while True:
            name, arguments, options = connection.recv()
            _answer(connection, lambda: _called(functions, name, arguments, options))  # noqa: B023 (called at once)


def _end_with(parent: int) -> None:
    """End this process, and what it started, once its parent has gone: it may be in a loop that never ends."""
    while os.getppid() == parent:
        time.sleep(1)
    os.killpg(0, signal.SIGKILL)


def _answer(connection: Connection, work: Callable[[], Any]) -> None:
    from raytwin.errors import InputError

    try:
        answer = "made", work()
    except InputError as error:
        answer = "input", error.fields
    except (Exception, SystemExit) as error:  # theirs, whatever it is
        answer = "error", (type(error).__name__, str(error))
    connection.send(answer)


def _loaded(text: str, functions: dict[str, Callable[..., Any]]) -> dict[str, Any]:
    """Fill in the functions; return what SubjectProcess.describe tells of them."""
    from raytwin.renderers.user_renderers import takes_of
    from raytwin.teach.contract.composed_tracer import PARTS
    from raytwin.teach.contract.loading import is_unwritten
    from raytwin.teach.contract.submission import load

    submission = load(text)
    render, made = submission.picture()
    functions |= {n: f for n, f in submission.stages.items() if n in PARTS and not is_unwritten(f)} | {"render": render}
    return {"made": made, "functions": {name: takes_of(f) for name, f in functions.items()}}


def _called(functions: dict[str, Callable[..., Any]], name: str, arguments: tuple[Any, ...], options: Any) -> Any:
    if name != HINT:
        return _plain(functions[name](*arguments, **options))
    from raytwin.teach.contract.check import DEFAULT_HINTS
    from raytwin.teach.contract.check_function import repair_function
    from raytwin.teach.contract.stage_table import CONTRACT

    found = repair_function(CONTRACT[arguments[0]], functions[arguments[0]])
    return found.hint(DEFAULT_HINTS) if found else ""


def _plain(made: Any) -> Any:
    """What can be sent: an Image, for a path or a Bitmap too, a tuple of arrays, or an array."""
    import numpy as np

    from raytwin.images.image import Image
    from raytwin.images.image_input import as_image, is_bitmap

    if isinstance(made, Image) or made is None:
        return made
    if isinstance(made, str | os.PathLike) or is_bitmap(made):
        return as_image(made).image
    return tuple(map(_plain, made)) if isinstance(made, tuple) else np.asarray(made)


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])))
