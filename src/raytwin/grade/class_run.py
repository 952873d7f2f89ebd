"""Many submissions: a result each, written atomically under its key, so that a run that was interrupted goes on.

    jobs = jobs_of(folder, rubric_path)
    for result in run(jobs, out, Workers(jobs=4)): ...

Existing results are reused. A shard does its own jobs, and a last run without a shard collects all. No submission costs
another its result: whatever fails, in the grader or its machine, becomes a result of the student concerned.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import msgspec

from raytwin import files
from raytwin.errors import InputError
from raytwin.grade.grade_submission import grade_submission
from raytwin.grade.job import Job, job_of
from raytwin.grade.questions import references_of
from raytwin.grade.result import Result
from raytwin.grade.rubric import Rubric, read_rubric
from raytwin.grade.submission_code import CODE
from raytwin.image_input import ENDINGS
from raytwin.parallel import Done, Workers, map_parallel
from raytwin.progress import Progress, silent
from raytwin.sandbox.sandbox import plain

RESULTS = "results"
"""The folder of what came of each job; it makes a run go on where it stopped."""


def jobs_of(submissions: Path, rubric_path: Path, whole: bool = False) -> list[Job]:
    """Return a job for each file or folder in `submissions` (or for itself, where it is one submission: `whole`).

    Raises InputError for faults of the rubric and its references, before anything is graded.
    """
    rubric = read_rubric(rubric_path)
    references_of(rubric)
    if not submissions.exists():
        raise InputError(submissions, "submissions: files, or folders, of students", "no such folder")
    if not (submissions.is_dir() or submissions.is_file()):
        raise InputError(submissions, "submissions: files, or folders, of students", "a device or a pipe")
    paths = (
        [submissions]
        if whole or _is_one(submissions, rubric)
        else sorted(p for p in submissions.iterdir() if _counts(p))
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
    each: Callable[[Result], None] | None = None,
) -> list[Result]:
    """Return the results of the share, in the jobs' order; each is written to `out`/results/KEY.json as it comes.

    What the grader failed on before is graded again. `each` is called with every new result as it comes.
    """
    mine = workers.share(jobs)
    found = {} if again else {j.key: _read(out, j.key) for j in mine}
    done = {key: result for key, result in found.items() if result is not None and not result.grader_fault}
    todo = [j for j in mine if j.key not in done]
    progress("grade", len(done), len(mine))
    # The share is taken; a Dask worker's disk may be another one: it sends what the caller writes.
    here = Workers(workers.jobs, workers.dask)
    for one in map_parallel(partial(work, out=None if workers.dask else str(out)), todo, here):
        done[one.thing.key] = _result(out, one, written=not workers.dask)
        if each is not None:
            each(done[one.thing.key])
        progress("grade", len(done), len(mine))
    return [done[j.key] for j in mine]


def work(job: Job, out: str | None) -> bytes:
    """Return the result as JSON, after writing it under its key, if there is a folder to write it to."""
    made = msgspec.json.encode(grade_submission(job))
    if out is not None:
        _write(Path(out), job.key, made)
    return made


def _result(out: Path, found: Done, written: bool) -> Result:
    if found.error is None:
        if not written:
            _write(out, found.thing.key, found.result)
        return msgspec.json.decode(found.result, type=Result)
    name = "" if isinstance(found.error, InputError) else f"{type(found.error).__name__}: "
    problem = plain(f"the grader's own fault: {name}{found.error}")
    result = Result(found.thing.student, found.thing.key, "", (), problem=problem, grader_fault=True)
    _write(out, found.thing.key, msgspec.json.encode(result))
    return result


def collect(jobs: Sequence[Job], out: Path) -> list[Result]:
    """Return the results that are there, whoever made them."""
    return [r for j in jobs if (r := _read(out, j.key)) is not None]


def _read(out: Path, key: str) -> Result | None:
    path = out / RESULTS / f"{key}.json"
    try:
        return msgspec.json.decode(path.read_bytes(), type=Result)
    except (OSError, msgspec.DecodeError):
        return None


def _write(out: Path, key: str, made: bytes) -> None:
    with files.replacing(out / RESULTS / f"{key}.json") as temporary:
        temporary.write_bytes(made)
