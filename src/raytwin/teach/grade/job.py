"""What a worker is given: a submission, its rubric and its seed, with the key that its result is stored under."""

import hashlib
import os
from pathlib import Path

import msgspec

from raytwin.errors import InputError
from raytwin.images.cache import made_by
from raytwin.teach.grade.rubric import Rubric
from raytwin.teach.grade.submission_code import submission_files
from raytwin.teach.sandbox.sandbox import plain
from raytwin.teach.sandbox.work_folder import MEGA

GRADING_ROOMS = (
    "array_types.py", "errors.py", "judging.py", "notebook.py", "rungs.py", "safe_write.py", "scene_folders.py",
    "compare", "explain", "images", "renderers", "scene", "teach", "tracer",
)  # fmt: skip
"""What decides points and sentences. A result of other code is not reused; a change of a page regrades nobody."""

GRADER = tuple(Path(__file__).parents[2] / room for room in GRADING_ROOMS)


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
