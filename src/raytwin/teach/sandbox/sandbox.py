"""Runs a submission in a process that it cannot leave, and takes numbers from it: a submission is hostile until shown
otherwise.

    with Sandbox(code, limits) as child:
        answer = child.call("render", scene)        # arrays, or what went wrong

child.py is the process; it locks itself in (lock.py) before any of the submission's code runs, and answers over a pipe
(wire.py). Which locks hold on this machine is probed once (`probe`). Everything here works without them, too, on any
system: what is lost is said.
"""

import contextlib
import functools
import math
import os
import queue
import secrets
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Literal

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.images.image_input import ENDINGS
from raytwin.scene_folders import REFERENCES
from raytwin.teach.sandbox import wire
from raytwin.teach.sandbox.importable import importable
from raytwin.teach.sandbox.lock import HOLDS, LOCKS
from raytwin.teach.sandbox.work_folder import MEGA, copy_files, excess, remove

POLL = 0.1
"""Seconds between two looks at the clock and at the working folder."""
MAX_PRINTED = 16_384
"""Bytes that are kept of what a submission prints."""
FORGED = "it wrote into the grader's pipe"
PENDING = object()
"""No answer yet."""
CLOCK_FACTOR = 10
"""A submission is ended when its time by the clock exceeds a limit of seconds this many times.

Asleep it uses no processor, and on a busy machine it waits for one: the clock cannot tell one from the other.
"""


class Limits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits of one submission.

    Each of its processes may take `memory_mb`, write files of `file_mb`, and compute for `seconds_a_call` in a call and
    for `seconds` (`cpu_seconds`, if that is less) in all. By the clock, all may take `CLOCK_FACTOR` times as long.
    """

    seconds: float = 60.0
    seconds_a_call: float = 20.0
    cpu_seconds: int = 60
    memory_mb: int = 1024
    file_mb: int = 64
    folder_mb: int = 128
    processes: int = 32
    answer_mb: int = 64


@dataclass(frozen=True)
class Code:
    """What is run: `source` of the Python file `file`, or a notebook's `cells` (name, text); a `command` with {scene}
    and {out}; or images.

    `folder` is copied for it, links left out; None: nothing but the source. `packages`: what it may import beside the
    standard library, NumPy and SciPy, as a rubric names it.
    """

    kind: Literal["python", "command", "images"] = "python"
    source: str = ""
    file: str = "submission.py"
    cells: tuple[tuple[str, str], ...] = ()
    command: tuple[str, ...] = ()
    folder: Path | None = None
    asked: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()

    def followed_by(self, text: str) -> "Code":
        """Return the Python with a text of raytwin's own behind it, in the same module."""
        return replace(self, cells=(*(self.cells or ((self.file, self.source),)), ("raytwin", text)))


@dataclass(frozen=True, eq=False)
class Answer:
    """Arrays; or `problem`, in words, and of which sort: `error` (it raised), `limit` (too much of something), `broken`
    (ended, or no answer). `changed`: numbers of the arguments that the function changed in place."""

    arrays: tuple[np.ndarray, ...] = ()
    seconds: float = 0.0
    problem: str = ""
    sort: Literal["", "error", "limit", "broken", "missing"] = ""
    changed: tuple[int, ...] = ()


class Sandbox:
    """A process with a submission in it. `functions`: those asked for that exist; `printed`: how its output begins."""

    def __init__(self, code: Code, limits: Limits | None = None, hidden: tuple[Path, ...] = ()) -> None:
        self.limits, self.printed = limits or Limits(), ""
        self.functions: tuple[str, ...] = ()
        self.notes: tuple[str, ...] = ()
        self.locks: dict[str, str] = {}
        self._code, self._calls = code, 0
        self.problem = Answer()
        """Why nothing can be called any more: empty where all is well."""
        self.spent = 0.0
        """Seconds in which it was to answer, without those in which it waited for a core."""
        self._clock, self._looked_at = 0.0, 0.0
        self._hidden = tuple(str(Path(h).resolve()) for h in (*hidden, REFERENCES, _package()))

    def __enter__(self) -> "Sandbox":
        self._base = Path(tempfile.mkdtemp(prefix="raytwin-submission-"))
        self._work, self._copy = self._base / "work", self._base / "submission"
        self._work.mkdir(mode=0o700)
        self._copy.mkdir(mode=0o755)
        self._output = (self._base / "printed").open("w+b")  # as long as any file of the submission may be
        try:
            self._start()
        except BaseException:
            self.close()
            raise
        return self

    def _start(self) -> None:
        code = self._code
        if code.folder is not None:
            copy_files(code.folder, self._copy, self.limits.folder_mb * MEGA)
        if code.kind == "python" and code.source:  # so that a traceback finds its lines
            (self._copy / code.file).write_text(code.source, encoding="utf-8")
        child = Path(__file__).with_name("child.py")
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-B", str(child)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._output,
            cwd=self._base,
            env=_environment(self._work),
            start_new_session=os.name == "posix",
        )
        self._inbox: queue.Queue[Any] = queue.Queue(1)
        self._outbox: queue.Queue[Any] = queue.Queue(1)
        most = self.limits.answer_mb * MEGA
        limits = {
            "memory": self.limits.memory_mb * MEGA,
            "cpu": math.ceil(self._cpu_seconds),
            "a_call": self.limits.seconds_a_call,
            "file": self.limits.file_mb * MEGA,
            "processes": self.limits.processes,
            "answer": most - (1 << 16),
        }
        job: dict[str, Any] = {"kind": code.kind, "file": code.file, "command": list(code.command)}
        job["cells"] = [list(cell) for cell in code.cells or ((code.file, code.source),)]
        job |= {"asked": list(code.asked), "hidden": list(self._hidden)}
        job |= {"limits": limits, "folder": str(self._work), "submission": str(self._copy), "endings": list(ENDINGS)}
        job |= importable(code.packages)._asdict()
        job["packages"] = [p for p in dict.fromkeys([*sys.path, str(_package().parent)]) if p and Path(p).is_dir()]
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        threading.Thread(target=self._pump, args=(stdin, stdout, most), daemon=True).start()
        self._inbox.put(job)
        ready = self._wait(self.limits.seconds)
        if self.problem.problem or not self._is_table(ready, {"locks": dict, "pid": int}):
            return
        self.locks = {str(k): str(v) for k, v in ready["locks"].items()}
        self._inbox.put(None)
        loaded = self._wait(self.limits.seconds)
        if self.problem.problem:
            return
        if isinstance(loaded, dict) and isinstance(loaded.get("error"), str):
            self._end(plain(loaded["error"]), "error")
        elif self._is_table(loaded, {"functions": list, "notes": list}):
            self.functions = tuple(n for n in code.asked if n in loaded["functions"])
            self.notes = tuple(plain(n) for n in loaded["notes"][:20])

    def _is_table(self, message: Any, kinds: dict[str, type]) -> bool:
        """Whether a message has these keys with values of these kinds; if not, the process is ended: it was forged."""
        right = isinstance(message, dict) and all(isinstance(message.get(key), kind) for key, kind in kinds.items())
        if not right:
            self._end(FORGED, "broken")
        return right

    def __exit__(self, *_: object) -> None:
        self.close()

    # -------------------------------------------------------------------------------------- calls

    def call(self, function: str, *arguments: Any, most_arrays: int = 8) -> Answer:
        """What `function(*arguments)` returned; no problem of the submission's is an exception here."""
        if self.problem.problem:
            return self.problem
        if function not in self.functions:
            return Answer(problem=f"{function} is not written{self._failed_first()}", sort="missing")
        self._calls += 1
        before = self.spent
        asked = {"call": self._calls, "function": function, "arguments": list(arguments)}
        self._inbox.put(asked | {"most_arrays": most_arrays})
        answer = self._wait(self.limits.seconds_a_call)
        seconds = self.spent - before
        if not self.problem.problem and self._is_table(answer, {"call": int}):
            if isinstance(answer.get("error"), str):
                why = self._failed_first() if answer["error"].startswith("NameError") else ""
                return Answer(seconds=seconds, problem=plain(answer["error"]) + why, sort="error")
            arrays = answer.get("arrays")
            right = isinstance(arrays, list) and all(isinstance(a, np.ndarray) for a in arrays)
            if right and answer["call"] == self._calls:
                changed = answer.get("changed")
                known = tuple(k for k in changed if isinstance(k, int)) if isinstance(changed, list) else ()
                return Answer(tuple(arrays), seconds, changed=known)
            self._end(FORGED, "broken")
        return replace(self.problem, seconds=seconds)

    def _failed_first(self) -> str:
        """What did not run when the submission was loaded: names that are missing come from there."""
        return f". When it was loaded, this failed first: {self.notes[0]}" if self.notes else ""

    @property
    def _cpu_seconds(self) -> float:
        return min(self.limits.seconds, self.limits.cpu_seconds)

    def _pump(self, requests: BinaryIO, answers: BinaryIO, most: int) -> None:
        """Send requests and read answers, in a thread, since either pipe may hang. A request of None: only read."""
        take = wire.exactly(answers)
        try:
            while (request := self._inbox.get()) != "end":
                if request is not None:
                    wire.write(requests, request)
                self._outbox.put(wire.read(take, most))
        except Exception as error:  # whatever a submission wrote: this thread must not die unheard
            self._outbox.put(error)
        finally:
            for stream in (requests, answers):
                with contextlib.suppress(OSError):
                    stream.close()

    def _wait(self, most: float) -> Any:
        """The next answer, that may take `most` seconds; None once there can be none, and then `problem` says why."""
        began, waited = time.monotonic(), self._waited_for_a_core()
        whole = CLOCK_FACTOR * self.limits.seconds
        limit = min(CLOCK_FACTOR * most, whole - self._clock)
        answer = PENDING
        while answer is PENDING and not self.problem.problem:
            with contextlib.suppress(queue.Empty):
                answer = self._outbox.get(timeout=POLL)
            if isinstance(answer, Exception):
                self._end(*self._how_it_ended(answer, most))
            elif answer is PENDING and time.monotonic() - began > limit:
                limit = min(CLOCK_FACTOR * most, whole)
                self._end(f"not done after {limit:g} s of the clock: ended", "limit")
            elif time.monotonic() - self._looked_at > POLL:
                self._looked_at = time.monotonic()
                if exceeded := excess(self._work, self.limits.folder_mb * MEGA):
                    self._end(exceeded, "limit")
        elapsed = time.monotonic() - began
        self._clock += elapsed
        self.spent += max(0.0, elapsed - max(0.0, self._waited_for_a_core() - waited))
        return None if self.problem.problem else answer

    def _waited_for_a_core(self) -> float:
        """Seconds in which its first thread was ready to run and another had the core; 0 where no system says so."""
        with contextlib.suppress(OSError, ValueError, IndexError):
            return int(Path(f"/proc/{self._process.pid}/schedstat").read_text().split()[1]) / 1e9
        return 0.0

    def _how_it_ended(self, error: Exception, most: float) -> tuple[str, Literal["limit", "broken"]]:
        if not isinstance(error, EOFError | OSError):
            return FORGED, "broken"
        with contextlib.suppress(subprocess.TimeoutExpired):
            code = self._process.wait(timeout=1.0)
            if code == -getattr(signal, "SIGXCPU", 0):
                limit = most if self.spent + most <= self._cpu_seconds else self._cpu_seconds
                return f"not done after {limit:g} s of computing: ended", "limit"
            if code < 0:
                named = next((s.name for s in signal.Signals if s == -code), f"signal {-code}")
                return f"the process was ended by {named}", "broken"
            return f"the process ended itself (exit code {code}) without an answer", "broken"
        return "it closed the pipe to the grader", "broken"

    def _end(self, problem: str, sort: Literal["error", "limit", "broken"]) -> None:
        if not self.problem.problem:  # the first reason is the cause of others
            self.problem = Answer(problem=problem, sort=sort)
        self._kill()

    def _kill(self) -> None:
        """The process and all that it has started: nobody leaves the group where seccomp holds."""
        if os.name == "posix":
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
        with contextlib.suppress(OSError):
            self._process.kill()

    def close(self) -> None:
        if hasattr(self, "_process"):
            self._kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=5.0)
            with contextlib.suppress(queue.Full):
                self._inbox.put_nowait("end")
            with contextlib.suppress(queue.Empty):
                self._outbox.get_nowait()
        with self._output as output:
            output.seek(0)
            self.printed = output.read(MAX_PRINTED).decode(errors="replace")
        remove(self._base)


# ------------------------------------------------------------------------------------------ probe


@functools.cache
def probe() -> dict[str, str]:
    """Try every lock: return whether it works on this machine (`lock.HOLDS`), or why it does not."""
    source = "def probe():\n    import numpy.polynomial\n    return 1.0\n"
    with Sandbox(Code(source=source, asked=("probe",))) as child:
        answer = child.call("probe")
    if answer.problem:
        raise InputError("sandbox", "a process that answers", answer.problem)
    return child.locks


def lock_rows(locks: dict[str, str]) -> list[tuple[str, str]]:
    """(lock, whether it holds on this machine and what for), in words."""
    return [(n, f"holds: {what}" if locks.get(n) == HOLDS else f"no: {locks.get(n)}") for n, what in LOCKS.items()]


# ------------------------------------------------------------------------------------------ words and places


def _package() -> Path:
    return Path(__file__).resolve().parents[2]


def _environment(work: Path) -> dict[str, str]:
    kept = {k: os.environ[k] for k in ("PATH", "LD_LIBRARY_PATH", "SYSTEMROOT", "TZ") if k in os.environ}
    one = {f"{n}_NUM_THREADS": "1" for n in ("OPENBLAS", "OMP", "MKL", "NUMEXPR")}
    own = {"HOME": str(work), "TMPDIR": str(work), "MPLCONFIGDIR": str(work), "MPLBACKEND": "Agg", "LC_ALL": "C.UTF-8"}
    return kept | one | own | {"PYTHONIOENCODING": "utf-8:backslashreplace", "RAYTWIN_SANDBOX": secrets.token_hex(4)}


def plain(text: Any) -> str:
    """At most 2000 characters that can be printed: what a submission says is shown in terminals and pages."""
    return "".join(c if c.isprintable() or c == "\n" else " " for c in str(text)[:2000])
