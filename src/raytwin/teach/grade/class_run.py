"""Many submissions: a result each, written atomically under its key, so that a run that was interrupted goes on.

    jobs = jobs_of(folder, rubric_path)
    for result in run(jobs, out, Workers(jobs=4)): ...

Existing results are reused. No submission costs another its result: whatever fails, in the grader or its machine,
becomes a result of the student concerned.
"""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from raytwin.errors import InputError
from raytwin.images.image_input import ENDINGS
from raytwin.parallel import Workers, map_parallel
from raytwin.progress import Progress, silent
from raytwin.safe_write import replacing
from raytwin.teach.grade.grade_submission import Job, grade_submission, job_of
from raytwin.teach.grade.points import with_points
from raytwin.teach.grade.questions import references_of
from raytwin.teach.grade.result import Result
from raytwin.teach.grade.rubric import Rubric, read_rubric
from raytwin.teach.grade.submission_code import CODE
from raytwin.teach.sandbox.sandbox import plain

RESULTS_FOLDER = "results"
"""The folder of what came of each job; it makes a run go on where it stopped."""


def jobs_of(submissions: Path, rubric_path: Path, whole: bool = False) -> list[Job]:
    """Return a job for each file or folder in `submissions` (or for itself, where it is one submission: `whole`).

    Raises InputError for faults of the rubric and its references, before anything is graded.
    """
    rubric = read_rubric(rubric_path)
    references_of(rubric, rubric_path)
    if not submissions.exists():
        raise InputError(submissions, "submissions: files, or folders, of students", "no such folder")
    if not (submissions.is_dir() or submissions.is_file()):
        raise InputError(submissions, "submissions: files, or folders, of students", "a device or a pipe")
    paths = (
        [submissions]
        if whole or _is_one(submissions, rubric)
        else sorted((p for p in submissions.iterdir() if _counts(p)), key=lambda p: (p.name.casefold(), p.name))
    )
    if not paths:
        raise InputError(submissions, "submissions: files, or folders, of students", "an empty folder")
    return [job_of(name, path, rubric_path, rubric) for name, path in zip(_names(paths), paths, strict=True)]


def _names(paths: Sequence[Path]) -> list[str]:
    """Students' names, all different and printable: bytes that are no UTF-8 and control characters become escapes."""
    short = [p.stem if p.is_file() else p.name for p in paths]
    # Where two names differ by their ending alone, the ending tells them apart.
    names = [p.name if short.count(n) > 1 else n for n, p in zip(short, paths, strict=True)]
    if len(set(names)) < len(names):
        names = [p.name for p in paths]
    return ["".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in n) for n in names]


def _is_one(path: Path, rubric: Rubric) -> bool:
    return path.is_file() or any((path / f"{rubric.file}{ending}").is_file() for ending in CODE)


def _counts(path: Path) -> bool:
    if path.name.startswith(".") or path.is_symlink():
        return False
    return (
        path.is_dir() or path.suffix in CODE or path.suffix.lower() not in (*ENDINGS, ".toml", ".json", ".csv", ".md")
    )


def run(
    jobs: Sequence[Job],
    out: Path,
    workers: Workers,
    again: bool = False,
    progress: Progress = silent,
) -> list[Result]:
    """Return the results of one rubric's jobs, in their order; each is written to `out`/results/KEY.json as it comes.

    What the grader failed on before is graded again.
    """
    rubric = read_rubric(jobs[0].rubric)
    found = {} if again else {job.key: stored(out, job.key) for job in jobs}
    done = {key: result for key, result in found.items() if result is not None and not result.grader_fault}
    todo = [job for job in jobs if job.key not in done]
    progress("grade", len(done), len(jobs))
    for one in map_parallel(grade_submission, todo, workers):
        result = one.result if one.error is None else _fault(one.thing, one.error)
        with replacing(out / RESULTS_FOLDER / f"{one.thing.key}.json") as temporary:
            temporary.write_bytes(msgspec.json.encode(result))
        done[one.thing.key] = result
        progress("grade", len(done), len(jobs))
    return [with_points(done[job.key], rubric) for job in jobs]


def stored(out: Path, key: str) -> Result | None:
    """The result in `out`/results/KEY.json; None where there is none that can be read."""
    try:
        return msgspec.json.decode((out / RESULTS_FOLDER / f"{key}.json").read_bytes(), type=Result)
    except (OSError, msgspec.DecodeError):
        return None


def _fault(job: Job, error: Exception) -> Result:
    name = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
    problem = plain(f"the grader's own fault: {name}{error}")
    return Result(job.student, job.key, "", (), problem=problem, grader_fault=True)
