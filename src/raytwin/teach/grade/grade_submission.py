"""One submission graded by one rubric: (submission, rubric, seed) -> Result. The same function on every machine.

A `Job` is what a worker is given. The submission runs in a sandbox and gives arrays. Everything else happens here,
where none of its code runs: cases and scenes are drawn from the seed, numbers compared, causes named.
"""

import contextlib
import hashlib
import os
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from raytwin.errors import InputError
from raytwin.images.cache import made_by
from raytwin.teach.grade.marks import marked
from raytwin.teach.grade.points import with_points
from raytwin.teach.grade.questions import questions_of
from raytwin.teach.grade.result import Result
from raytwin.teach.grade.rubric import Rubric, read_rubric
from raytwin.teach.grade.sandboxed_calls import call_all
from raytwin.teach.grade.submission_code import code_of, submission_files
from raytwin.teach.sandbox.sandbox import Answer, plain
from raytwin.teach.sandbox.work_folder import MEGA

GRADING_ROOMS = (
    "array_types.py", "errors.py", "judging.py", "notebook.py", "rungs.py", "safe_write.py", "scene_folders.py",
    "compare", "explain", "images", "renderers", "scene", "teach", "tracer",
)  # fmt: skip
"""What decides points and sentences. A result of other code is not reused; a change of a page regrades nobody."""
GRADER = tuple(Path(__file__).parents[2] / room for room in GRADING_ROOMS)
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
    result = with_points(marked(result, rubric, asked, problem, code), rubric)
    result = msgspec.structs.replace(result, seconds=round(time.perf_counter() - began, 4))
    return result, any(refused(one.answer) for one in asked)


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
