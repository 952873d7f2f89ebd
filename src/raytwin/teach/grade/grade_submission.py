"""One submission graded by one rubric: (submission, rubric, seed) -> Result. The same function on every machine.

The submission runs in a sandbox and gives arrays. Everything else happens here, where none of its code runs: cases and
scenes are drawn from the seed, numbers compared, causes named.
"""

import os
import time
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from raytwin.errors import InputError
from raytwin.teach.grade.excerpt import with_own_text
from raytwin.teach.grade.job import Job
from raytwin.teach.grade.marks import marked
from raytwin.teach.grade.points import with_points
from raytwin.teach.grade.questions import questions_of
from raytwin.teach.grade.result import Result
from raytwin.teach.grade.rubric import read_rubric
from raytwin.teach.grade.sandboxed_calls import call_all
from raytwin.teach.grade.submission_code import code_of
from raytwin.teach.sandbox.sandbox import Answer, plain
from raytwin.teach.sandbox.turns import refused, turn


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
