"""A second look at what is wrong: the line to look at, found by repairing the text, and the fingerprint of the numbers.

It runs after grading, in a sandbox of its own, and changes no points. What the sandbox answers is compared here with
what is right.
"""

import dataclasses
import inspect
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin.contract.check_function import is_right
from raytwin.contract.repair_function import further_probes, probes
from raytwin.contract.stage import Case, Stage
from raytwin.contract.stage_table import LESSONS
from raytwin.diagnose.repair import A_CALL, Answers, Candidate, Cells, Repair, attempt, kind_of, repair
from raytwin.grade.fingerprint import PROBE_SEED, fingerprint
from raytwin.grade.follow_through import code_with
from raytwin.grade.result import Marked, Result
from raytwin.grade.rubric import Rubric
from raytwin.sandbox.sandbox import Code, Sandbox

SECONDS, IN_ALL = 4.0, 8.0
"""Seconds of computing: for one function, and for a submission."""
CALLED = "raytwin_attempt"
DRIVER = f"""
from typing import Any

{inspect.getsource(attempt)}

def {CALLED}(function, codes, lengths, names, arguments, seconds):
    import numpy
    ends = numpy.cumsum(lengths)
    parts = [codes[end - n : end].tobytes() for end, n in zip(ends, lengths)]
    shapes, numbers = [], []
    for made in attempt(globals(), function, parts, names, arguments, seconds):
        shapes.append(-1 if made is None else len(made))
        for array in made or ():
            shapes += [array.ndim, *array.shape]
            numbers.append(array.ravel())
    return numpy.array(shapes, int), numpy.concatenate([numpy.zeros(0), *numbers])
"""
"""Runs in the sandbox, behind the submission's own text and in its module."""


def looked_again(result: Result, rubric: Rubric, code: Code, replaced: Sequence[str] = ()) -> Result:
    """The result, with the lines to look at among its exercises' sentences, as far as the rubric's `hints` go, and
    fingerprints of what no cause is named for.

    Of pictures only those are tried of which no cause is proved; functions that are right by their own tests are not.
    `replaced`: functions that failed, of which right ones take the place when pictures are repaired.
    """
    wrong = [e for e in result.exercises if e.status in ("fail", "error") and not _is_known(e)]
    unnamed = [e.stage for e in wrong if not (e.faults or e.fingerprint)]
    if not ((rubric.hints or unnamed) and wrong and code.kind == "python" and (code.source or code.cells)):
        return result
    cells: Cells = code.cells or (("", code.source),)
    innocent = [e.stage for e in result.exercises if e.status == "pass" and LESSONS[e.stage].name not in PICTURES]
    found: dict[str, Repair] = {}
    prints: dict[str, str] = {}
    left = IN_ALL
    for pictures in (False, True):
        some = [e for e in wrong if (e.stage in PICTURES) == pictures]
        ours = tuple(replaced) if pictures else ()
        if not some:
            continue
        asked = (*dict.fromkeys(e.stage for e in some), CALLED)
        own = dataclasses.replace(code_with(code, ours).followed_by(DRIVER), asked=asked)
        with Sandbox(own, rubric.limits, (Path(rubric.folder), Path.cwd())) as child:
            if not ours:
                prints |= {stage: _fingerprint(child, LESSONS[stage]) for stage in asked if stage in unnamed}
            began = _clock(child)
            for exercise in some if rubric.hints else ():
                if exercise.stage in child.functions and CALLED in child.functions and exercise.stage not in found:
                    until = min(_clock(child) + SECONDS, began + left)
                    known = [r.candidate for r in found.values() if r.candidate is not None and not ours]
                    stage, seed = LESSONS[exercise.stage], result.seed
                    if (
                        made := _repair(stage, seed, cells, child, until, [*innocent, *ours], known, rubric.seen)
                    ) is not None:
                        found[exercise.stage] = made
            left -= _clock(child) - began
    exercises = tuple(
        _with_hint(e, found.get(e.stage), rubric.hints, e.fingerprint or prints.get(e.stage, "")) if e in wrong else e
        for e in result.exercises
    )
    return msgspec.structs.replace(result, exercises=exercises)


PICTURES = ("hit_points", "render")
MOST_PROBES = 3
"""Cases that a fingerprint is taken of."""


def _is_known(exercise: Marked) -> bool:
    return exercise.stage in PICTURES and exercise.sureness == "proved"


def _fingerprint(child: Sandbox, stage: Stage) -> str:
    """A fingerprint of the wrong numbers in cases that are the same for all."""
    cases = stage.cases(PROBE_SEED)[:MOST_PROBES]
    answers = [child.call(stage.name, *case.args) for case in cases]
    got = [a.astype(float) for answer in answers for a in answer.arrays]
    return fingerprint([a for case in cases for a in case.expected], got)


def _with_hint(exercise: Marked, repair: Repair | None, level: int, found: str) -> Marked:
    """Behind a cause that is proved, or a wrong shape; before what is likely, or names none."""
    exercise = msgspec.structs.replace(exercise, fingerprint=found)
    if repair is None:
        return exercise
    hint = repair.hint(level)
    first, rest = exercise.sentences[:1], exercise.sentences[1:]
    shape = any(text.startswith("it returned") for text in first)
    sentences = (*first, hint, *rest) if exercise.sureness == "proved" or shape else (hint, *first, *rest)
    return msgspec.structs.replace(exercise, sentences=sentences, sureness="proved", repair=kind_of(repair.operator))


def _clock(child: Sandbox) -> float:
    """Seconds that were computed there and here."""
    return child.spent + time.process_time()


def _repair(
    stage: Stage, seed: int, cells: Cells, child: Sandbox, until: float, innocent: Sequence[str],
    known: Sequence[Candidate], seen: Mapping[str, int],
) -> Repair | None:  # fmt: skip
    cases = stage.cases(seed)
    right: Callable[[Case, Any], bool] = partial(is_right, stage)

    def is_wrong(case: Case) -> bool:
        answer = child.call(stage.name, *case.args)
        return bool(answer.problem) or not right(case, answer.arrays)

    if not (tried := probes(stage, cases, is_wrong)):
        return None
    run = partial(_run, child, stage.name)
    further = partial(further_probes, stage, seed)
    return repair(cells, stage.name, tried, right, run, lambda: _clock(child) < until, innocent, known, further, seen)


def _run(child: Sandbox, function: str, chosen: Sequence[Candidate], arguments: Sequence[Any]) -> Answers:
    if not chosen:
        return []
    codes = np.frombuffer(b"".join(c.code for c in chosen), np.uint8)
    lengths = np.array([len(c.code) for c in chosen])
    answer = child.call(CALLED, function, codes, lengths, [list(c.names) for c in chosen], list(arguments), A_CALL)
    if answer.problem or len(answer.arrays) != 2:
        return [None] * len(chosen)
    try:
        return _read([int(n) for n in answer.arrays[0].ravel()], answer.arrays[1].astype(float).ravel(), len(chosen))
    except (IndexError, ValueError, OverflowError):  # the submission's own doing
        return [None] * len(chosen)


def _read(shapes: list[int], numbers: np.ndarray, count: int) -> Answers:
    """The arrays of each candidate, from the numbers of all and their shapes."""
    made: Answers = []
    at = start = 0
    for _ in range(count):
        arrays = []
        number, at = shapes[at], at + 1
        for _ in range(min(number, 8)):
            shape, at = shapes[at + 1 : at + 1 + shapes[at]], at + 1 + shapes[at]
            size = int(np.prod(shape))
            arrays.append(numbers[start : start + size].reshape(shape))
            start += size
        made.append(None if number < 0 else tuple(arrays))
    return made
