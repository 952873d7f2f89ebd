"""Ask a submission everything in its sandbox; a function that ends the process costs its own exercise alone."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin.compare import Comparison, SequentialComparison
from raytwin.compare.finding import notes
from raytwin.images.image import Image
from raytwin.renderers.scene_exchange import as_json
from raytwin.teach.contract.composed_tracer import NEEDED, compose
from raytwin.teach.contract.stage import Function
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.grade.questions import Question
from raytwin.teach.grade.result import Result
from raytwin.teach.grade.rubric import Rubric
from raytwin.teach.sandbox.lock import HOLDS
from raytwin.teach.sandbox.sandbox import MAX_PRINTED, Answer, Code, Sandbox, probe

MAX_RENDERS = 64
"""Renders of one picture at a sampled light level; what is undecided then is not passed."""
ALARMS_PER_PICTURE = 1e-5
"""Share of the correct pictures that fail by chance."""
SAME_NUMBERS = "each call of `render` drew the same random numbers: use np.random.default_rng() without a seed"


class _PartFailed(Exception):
    """A function that a picture is composed of has no usable answer; that answer becomes the picture's."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer


def call_all(result: Result, code: Code, rubric: Rubric, asked: list[Question]) -> tuple[Result, str]:
    """Make all calls in one process, in an order shuffled by the seed; return the result so far and why nothing ran.

    Where a stage ends the process, a new one starts without that stage, so no mistake costs another exercise. A
    process that was killed from outside (the machine's memory ran out) has a second chance.
    """
    hidden = (Path(rubric.folder), Path.cwd())
    left = [asked[i] for i in np.random.default_rng(result.seed).permutation(len(asked))]
    seconds, killed, printed, problem = rubric.limits.seconds, False, "", ""
    while left:
        limits = msgspec.structs.replace(rubric.limits, seconds=max(0.1, seconds))
        with Sandbox(code, limits, hidden) as child:
            while left and not child.problem.problem:
                one = left.pop()
                ask(one, child, code.kind)
        seconds -= child.spent
        printed = (printed + child.printed)[:MAX_PRINTED]
        ended = child.problem
        if not ended.problem:
            break
        if not child.functions:  # it did not even begin
            problem = ended.problem
            for other in left:
                other.answer = ended
            break
        if "SIGKILL" in ended.problem and not killed:
            killed = True
            left.append(one)
            continue
        for other in (o for o in left if o.exercise.stage == one.exercise.stage):
            other.answer = ended
        left = [o for o in left if o.exercise.stage != one.exercise.stage]
    for stage in {one.exercise.stage for one in asked}:
        _one_says_so([one for one in asked if one.exercise.stage == stage])
    locks = tuple(f"{n}: {why}" for n, why in probe().items() if why != HOLDS)
    return msgspec.structs.replace(result, printed=printed, notes=child.notes, open_locks=locks), problem


def _one_says_so(asked: Sequence[Question]) -> None:
    """The first of a function's calls that changed its arguments fails for it."""
    for one in asked:
        if said := LESSONS[one.exercise.stage].changes(one.answer.changed):
            one.answer = replace(one.answer, arrays=(), problem=said, sort="error")
            return


def ask(one: Question, child: Sandbox, kind: str, ours: Sequence[str] = ()) -> None:
    """Fill in the answer of a submission of this kind. A picture of which there is no function is made of parts.

    `ours`: functions that are not the submission's own.
    """
    stage, arguments, parts = one.exercise.stage, one.case.args, NEEDED.get(one.exercise.stage, ())
    if kind == "command":
        arguments = (as_json(arguments[0]),)
    if one.reference is not None:
        one.answer, one.verdict = render_until_certain(lambda: child.call(stage, *arguments), one.reference)
    elif kind == "python" and stage not in child.functions and parts and set(parts) <= set(child.functions):
        one.answer, one.made_of = _composed(child, stage, arguments[0], ours)
    else:
        one.answer = child.call(stage, *arguments)
    # A second array describes the format of an image file; a function's own claim about that counts for nothing.
    count = len(one.answer.arrays)
    if one.scene is not None and not one.answer.problem and (count == 0 or (count > 1 and kind == "python")):
        one.answer = replace(one.answer, arrays=(), problem=_not_one(count), sort="error")


def _not_one(count: int) -> str:
    return f"it returned {count} arrays, where one is wanted"


def _composed(child: Sandbox, stage: str, scene: dict[str, Any], ours: Sequence[str]) -> tuple[Answer, str]:
    """The picture of our tracer with the submission's parts, each called in its process; and what it is made of."""
    own = [name for name in NEEDED[stage] if name not in ours]
    made_of = f"{stage} is not written: this is made of your {' and '.join(own)}, the rest is ours"
    seconds = 0.0

    def part(name: str) -> Function:
        def call(*arguments: Any) -> np.ndarray:
            nonlocal seconds
            answer = child.call(name, *arguments)
            seconds += answer.seconds
            if not answer.problem and (said := _misfit(name, arguments, answer)):
                answer = Answer(problem=said, sort="error")
            if answer.problem:
                raise _PartFailed(replace(answer, problem=f"{name}: {answer.problem}"))
            return answer.arrays[0]

        return call

    try:
        with np.errstate(all="ignore"):
            picture = getattr(compose({name: part(name) for name in own}), stage)(scene)
        return Answer((np.asarray(picture, float),), seconds), made_of
    except _PartFailed as failed:
        return replace(failed.answer, seconds=seconds), made_of
    except (ValueError, TypeError, IndexError, MemoryError) as error:  # arrays that do not fit one another
        said = f"your {' and '.join(NEEDED[stage])} do not fit together: {error}"
        return Answer((), seconds, said, "error"), made_of


def _misfit(name: str, arguments: tuple[Any, ...], answer: Answer) -> str:
    """What is wrong with a part's shape: a column (N, 1) for (N,) would broadcast to N x N values in the grader."""
    if len(answer.arrays) != 1:
        return _not_one(len(answer.arrays))
    got = answer.arrays[0]
    wanted = {
        "back_project": lambda: (arguments[3], arguments[2], 3),
        "intersect_sphere": lambda: arguments[0].shape[:1],
        "shade": lambda: arguments[0].shape,
    }[name]()
    fits = got.shape == wanted if name == "intersect_sphere" else got.size == math.prod(wanted)
    return "" if fits else f"it returned an array {got.shape}, where {wanted} is wanted"


def render_until_certain(call: Callable[[], Answer], reference: Image) -> tuple[Answer, Comparison | None]:
    """The mean of all renders, and the verdict on them; None where a call gave no picture of the reference's shape."""
    check = SequentialComparison(reference, false_alarm_rate=ALARMS_PER_PICTURE)
    total, seconds, renders = np.zeros(reference.shape), 0.0, 0
    different: set[bytes] = set()
    while not check.decided and renders < MAX_RENDERS:
        answer = call()
        seconds += answer.seconds
        if answer.problem or [a.shape for a in answer.arrays[:1]] != [reference.shape]:
            return replace(answer, seconds=seconds), None
        picture = np.asarray(answer.arrays[0], np.float64)
        total, renders = total + picture, renders + 1
        different.add(sha256(picture.tobytes()).digest())
        with np.errstate(over="ignore"):
            check.add(Image(picture.astype(np.float32), samples=0))
    verdict = check.conclude()
    if verdict.verdict == "undecided" and len(different) < renders:
        verdict = verdict.judged("undecided", *notes([f"undecided: {SAME_NUMBERS}"]))
    return replace(answer, arrays=(total / renders,), seconds=seconds), verdict
