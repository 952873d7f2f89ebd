"""One submission graded by one rubric: (submission, rubric, seed) -> Result. The same function on every machine.

A `Job` is what a worker is given. The submission runs in a sandbox and gives arrays. Everything else happens here,
where none of its code runs: cases and scenes are drawn from the seed, numbers compared, causes named.
"""

import contextlib
import hashlib
import os
import shlex
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from raytwin.errors import InputError
from raytwin.images.cache import made_by
from raytwin.images.image_input import ENDINGS
from raytwin.safe_write import check_file
from raytwin.teach.contract.submission import cells
from raytwin.teach.grade.excerpt import with_own_text
from raytwin.teach.grade.marks import marked
from raytwin.teach.grade.points import with_points
from raytwin.teach.grade.questions import questions_of
from raytwin.teach.grade.result import Result
from raytwin.teach.grade.rubric import Rubric, read_rubric
from raytwin.teach.grade.sandboxed_calls import call_all
from raytwin.teach.sandbox.sandbox import Answer, Code, plain
from raytwin.teach.sandbox.work_folder import MEGA

GRADING_ROOMS = (
    "array_types.py", "errors.py", "judging.py", "notebook.py", "rungs.py", "safe_write.py", "scene_folders.py",
    "compare", "explain", "images", "renderers", "scene", "teach", "tracer",
)  # fmt: skip
"""What decides points and sentences. A result of other code is not reused; a change of a page regrades nobody."""
GRADER = tuple(Path(__file__).parents[2] / room for room in GRADING_ROOMS)
CODE = (".py", ".ipynb")
"""Endings of files with Python."""
REFUSALS = ("BlockingIOError", "can't start new thread", "Resource temporarily unavailable")
"""What Python says where the system refuses a process or a thread."""


class Job(msgspec.Struct, frozen=True):
    """`key`: a hash of content, rubric, seed and grader, under which the result is stored. `unreadable`: why the
    submission's files cannot be read, empty where they can."""

    student: str
    path: str
    rubric: str
    seed: int
    key: str
    unreadable: str = ""


def job_of(student: str, path: Path, rubric_path: Path, rubric: Rubric) -> Job:
    """Return the job of one submission, whatever its files are: nobody else's grading depends on them."""
    try:
        content, unreadable = _content_hash(path, rubric.limits.folder_mb * MEGA), ""
    except (InputError, OSError, ValueError) as error:
        content, unreadable = hashlib.sha256(os.fsencode(path)).digest(), plain(error)
    seed = rubric.seed_of(content)
    asked = msgspec.json.encode(rubric.questions).decode()
    parts = [content.hex(), asked, str(seed), made_by(GRADER, ()), student]
    key = hashlib.sha256("\0".join([*parts, unreadable]).encode()).hexdigest()[:24]
    return Job(student, os.fspath(path), str(rubric_path), seed, key, unreadable)


def _content_hash(path: Path, most: int) -> bytes:
    """A hash of all files with their names. InputError above `most` bytes, before anything is read."""
    found = sorted(submission_files(path))
    if (size := sum(file.stat().st_size for file in found)) > most:
        raise InputError(path.name, f"a submission of at most {most // MEGA} MB", f"{size / MEGA:.0f} MB")
    content = hashlib.sha256()
    for file in found:
        name = os.fsencode(file.relative_to(path) if file != path else file.suffix)
        content.update(name + b" " + hashlib.sha256(file.read_bytes()).digest())
    return content.digest()


def grade_submission(job: Job) -> Result:
    """Grade one submission. Whatever it does, there is a result; InputError is for the rubric's faults.

    One to which the system refused a process or a thread is graded again alone: neighbours may have taken it.
    """
    with turn():
        result, again = _graded(job)
    if again:
        with turn(alone=True):
            result, _ = _graded(job)
    return result


def _graded(job: Job) -> tuple[Result, bool]:
    """The result, and whether a process or a thread was refused."""
    began = time.perf_counter()
    rubric = read_rubric(job.rubric)
    result = Result(job.student, job.key, rubric.title, (), seed=job.seed, graded=f"{datetime.now(UTC):%Y-%m-%d %H:%M}")
    asked = list(questions_of(rubric, job.seed))
    try:
        if job.unreadable:
            raise InputError(job.student, "files that can be read", job.unreadable)
        code = code_of(Path(job.path), rubric)
        result, problem = call_all(result, code, rubric, asked)
    except InputError as error:
        for one in asked:
            one.answer = Answer(problem=error.fault, sort="missing")
        said = plain(error).replace(f"{Path(job.path).parent}{os.sep}", "")
        return with_points(marked(result, rubric, asked, said), rubric), False
    result = with_points(with_own_text(marked(result, rubric, asked, problem, code), code), rubric)
    result = msgspec.structs.replace(result, seconds=round(time.perf_counter() - began, 4))
    return result, any(refused(one.answer) for one in asked)


# ------------------------------------------------------------------------------------------ what was handed in


def submission_files(path: Path) -> Iterator[Path]:
    """The file itself, or the files of a folder; hidden folders and links are left out."""
    if path.is_file():
        yield path
    for where, folders, names in os.walk(path, followlinks=False):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        yield from (p for n in names if (p := Path(where, n)).is_file() and not p.is_symlink())


def code_of(path: Path, rubric: Rubric) -> Code:
    """Return what a submission's file or folder holds: Python, a notebook, a program (the rubric's command) or images.

    Raises InputError where it is none of these.
    """
    common: dict[str, Any] = {"asked": rubric.functions, "packages": rubric.packages}
    inside = list(submission_files(path))
    found = sorted(p for p in inside if p.suffix in CODE and p.parent == path)
    shown = sum(p.suffix.lower() in ENDINGS for p in inside)
    if path.is_dir() and shown and (shown == len(inside) or not (found or rubric.command)):
        return Code("images", folder=path, **common)
    if path.is_dir() and rubric.command:
        return Code("command", command=tuple(shlex.split(rubric.command)), folder=path, **common)
    file = path
    if path.is_dir():
        named = [p for p in found if p.stem == rubric.file]
        if len(named or found) != 1:
            got = ", ".join(p.name for p in found) or "none"
            raise InputError(path, f"one file of Python, or {rubric.file}.py beside others", got)
        file = (named or found)[0]
    check_file(file, "a Python file, a notebook, or a folder")  # a pipe would be waited for without end
    if file.suffix not in CODE:
        raise InputError(path, "a Python file, a notebook, or a folder", file.suffix or "a file of another kind")
    folder = path if path.is_dir() else None
    if file.suffix == ".ipynb":
        found_cells = tuple((f"cell {n}", text) for n, text in cells(file))
        return Code(file=file.name, cells=found_cells, folder=folder, **common)
    try:
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(file, "UTF-8 text", type(error).__name__) from None
    return Code(source=text or "\n", file=file.name, folder=folder, **common)


# ------------------------------------------------------------------------------------------ turns


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
