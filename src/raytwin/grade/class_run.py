"""Many submissions: a result each, written atomically under its key, so that a run that was interrupted goes on.

    jobs = jobs_of(folder, rubric_path)
    for result in run(jobs, out, Workers(jobs=4)): ...

A job that is done already is not done again; a shard does its own, and whoever comes last (without a shard) collects.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import msgspec

from raytwin import files
from raytwin.errors import InputError
from raytwin.grade.grade_submission import CODE, Job, assess, job_of
from raytwin.grade.result import Result
from raytwin.grade.rubric import Rubric, read_rubric
from raytwin.image_input import ENDINGS
from raytwin.parallel import Done, Workers, map_parallel
from raytwin.progress import Progress, silent

RESULTS = "results"
"""The folder of what came of each job; it makes a run go on where it stopped."""


def jobs_of(submissions: Path, rubric_path: Path, whole: bool = False) -> list[Job]:
    """One for each file or folder in `submissions` (or for itself, where it is one submission: `whole`), by name."""
    rubric = read_rubric(rubric_path)
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
    names = [p.stem if p.is_file() else p.name for p in paths]
    # Where two names differ by their ending alone, the ending tells them apart.
    told = [p.name if names.count(n) > 1 else n for n, p in zip(names, paths, strict=True)]
    return [job_of(name, path, rubric_path, rubric) for name, path in zip(told, paths, strict=True)]


def _is_one(path: Path, rubric: Rubric) -> bool:
    return path.is_file() or any((path / f"{rubric.file}{ending}").is_file() for ending in CODE)


def _counts(path: Path) -> bool:
    if path.name.startswith(".") or path.is_symlink():
        return False
    return (
        path.is_dir() or path.suffix in CODE or path.suffix.lower() not in (*ENDINGS, ".toml", ".json", ".csv", ".md")
    )


def run(
    jobs: Sequence[Job], out: Path, workers: Workers, again: bool = False, progress: Progress = silent
) -> list[Result]:
    """The results of the share, in the jobs' order; written to `out`/results/KEY.json as they come."""
    mine = workers.share(jobs)
    done = {} if again else {j.key: r for j in mine if (r := _read(out, j.key)) is not None}
    todo = [j for j in mine if j.key not in done]
    progress("grade", len(done), len(mine))
    # The share is taken; a Dask worker's disk may be another one: it sends what the caller writes.
    here = Workers(workers.jobs, workers.dask)
    for found in map_parallel(partial(work, out=None if workers.dask else str(out)), todo, here):
        done[found.thing.key] = _result(out, found, written=not workers.dask)
        progress("grade", len(done), len(mine))
    return [done[j.key] for j in mine]


def work(job: Job, out: str | None) -> bytes:
    """What a worker does: the result as JSON; written under its key, where there is a folder to write it to."""
    made = msgspec.json.encode(assess(job))
    if out is not None:
        _write(Path(out), job.key, made)
    return made


def _result(out: Path, found: Done, written: bool) -> Result:
    if found.error is None:
        if not written:
            _write(out, found.thing.key, found.result)
        return msgspec.json.decode(found.result, type=Result)
    if isinstance(found.error, InputError):
        raise found.error  # the rubric's, or the machine's: no submission's
    # Ours: told with the student's name, and tried again next time, since it is not written.
    problem = f"the grader's own fault: {type(found.error).__name__}: {found.error}"
    return Result(found.thing.student, found.thing.key, "", (), problem=problem)


def collect(jobs: Sequence[Job], out: Path) -> list[Result]:
    """The results that are there, whoever made them."""
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
