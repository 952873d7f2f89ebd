"""What answers are worth: points of each exercise, what is said about it, and the bonus for speed."""

from dataclasses import replace

import msgspec

from raytwin.contract.check_function import judge
from raytwin.contract.stage_table import LESSONS
from raytwin.diagnose.diagnosis import Diagnosis, diagnose
from raytwin.grade.check_picture import CheckedPicture, check_picture
from raytwin.grade.fingerprint import fingerprint
from raytwin.grade.questions import Question
from raytwin.grade.result import Marked, Part, Picture, Result, Status
from raytwin.grade.rubric import Exercise, Rubric
from raytwin.grade.wrong_picture import wrong_picture

MOST_VIEWS = 3
"""Wrong pictures of a submission that can be looked at pixel by pixel; of the others there is a small one."""


def marked(result: Result, rubric: Rubric, asked: list[Question], problem: str, timed: bool = True) -> Result:
    """Return the result with its exercises marked. `timed`: the answers were computed here, so their seconds count.

    Speed is that of drawn scenes: of a named one a submission may have stored the picture.
    """
    exercises, pictures, speed = [], [], []
    checked = {id(a): check_picture(a) for a in asked if a.scene is not None}
    # One tracer made all pictures, so one cause is looked for in all; where there is none, in an exercise's own.
    together = _cause(list(checked.values()), result.seed)
    for exercise in rubric.exercises:
        mine = [a for a in asked if a.exercise is exercise]
        if mine[0].scene is None:
            one = _mark_stage(exercise, mine)
        else:
            one, wrong = _mark_pictures(exercise, mine, [checked[id(a)] for a in mine], together, result.seed)
            pictures += wrong
        exercises.append(one)
        drawn = [a.answer.seconds for a in mine if a.drawn]
        if timed and rubric.speed is not None and rubric.speed.of == one.name and one.error is not None and drawn:
            speed.append((one.name, sum(drawn) / len(drawn), one.error))
    bonus = 0.0
    if rubric.speed is not None and speed and all(e.status == "pass" for e in exercises if e.name == rubric.speed.of):
        bonus = rubric.speed.earned(speed[0][1])
    return msgspec.structs.replace(
        result,
        exercises=tuple(exercises),
        pictures=tuple(pictures),
        speed=tuple(speed),
        bonus=bonus,
        problem=problem,
        own_seconds=round(sum(a.answer.seconds for a in asked), 4),
    )


def _status(parts: list[Part], asked: list[Question]) -> Status:
    """The most telling of what became of the calls."""
    sorts = [a.answer.sort for a in asked]
    for sort in ("limit", "broken", "missing", "error"):
        if sort in sorts:
            return sort
    return (
        "pass"
        if all(p.passed for p in parts)
        else "error"
        if all(p.problem and p.wrong is None for p in parts)
        else "fail"
    )


def _mark_stage(exercise: Exercise, asked: list[Question]) -> Marked:
    stage = LESSONS[exercise.stage]
    if exercise.tolerance is not None:
        stage = replace(stage, tolerance=exercise.tolerance)
    outcomes = [a.answer.problem or tuple(x.astype(float) for x in a.answer.arrays) for a in asked]
    found = judge(stage, [a.case for a in asked], outcomes)
    parts = [
        Part(
            c.shows,
            c.passed,
            exercise.share(c.passed, c.error, c.wrong),
            c.error,
            c.wrong,
            a.answer.seconds,
            a.answer.problem,
        )
        for c, a in zip(found.cases, asked, strict=True)
    ]
    return Marked(
        name=exercise.name,
        stage=exercise.stage,
        status=_status(parts, asked),
        points=round(exercise.points * sum(p.share for p in parts) / len(parts), 4),
        of=exercise.points,
        visibility=exercise.visibility,
        unit=found.unit,
        tolerance=found.tolerance,
        sentences=(found.sentence,),
        causes=found.causes,
        sureness=found.sureness,
        faults=found.faults or tuple((name, found.sentence) for name in found.causes),
        inputs=found.inputs,
        expected=found.expected,
        got=found.got,
        parts=tuple(parts),
    )


def _cause(checked: list[CheckedPicture], seed: int, most: int = 2) -> Diagnosis | None:
    """Diagnose all pictures together; None if nothing is wrong or there are no numbers."""
    views = [c.view for c in checked if c.view is not None]
    return diagnose(views, seed, most=most) if any(c.view is not None and not c.part.passed for c in checked) else None


def _mark_pictures(
    exercise: Exercise, asked: list[Question], checked: list[CheckedPicture], together: Diagnosis | None, seed: int
) -> tuple[Marked, list[Picture]]:
    parts = [c.part for c in checked]
    status = _status(parts, asked)
    sentences: tuple[str, ...] = tuple(dict.fromkeys(p.problem for p in parts if p.problem))
    found = None
    if any(not c.part.passed and c.view is not None for c in checked):
        found = together
        if together is not None and not together.causes:
            found = _cause(checked, seed, most=1)
            # What other pictures speak against is not sure.
            found = found and replace(found, sureness="likely" if found.causes else "unknown")
    if found is not None:
        sentences = (*student_words(found), *sentences)
    elif status == "pass":
        sentences = (f"right in all {len(parts)} pictures" if len(parts) > 1 else "the picture is right",)
    sentences = (*sentences, *dict.fromkeys(a.made_of for a in asked if a.made_of))
    # Pixel by pixel the worst; the others stay small.
    wrong = [(a, c.got, c) for a, c in zip(asked, checked, strict=True) if c.got is not None]
    wrong.sort(key=lambda w: -(w[2].part.error or 0))
    pictures = [wrong_picture(a, got, h.scale, whole=i < MOST_VIEWS) for i, (a, got, h) in enumerate(wrong)]
    marked = Marked(
        name=exercise.name,
        stage=exercise.stage,
        status=status,
        points=round(exercise.points * sum(p.share for p in parts) / len(parts), 4),
        of=exercise.points,
        visibility=exercise.visibility,
        unit="of the picture's scale" if exercise.stage == "render" else "m",
        tolerance=asked[0].tolerance.p999_abs,
        sentences=sentences or ("wrong; no single common mistake fits",),
        causes=tuple(c.name for c in found.causes) if found else (),
        sureness=found.sureness if found and found.causes else "",
        faults=tuple((c.name, c.sentence) for c in found.causes) if found else (),
        fingerprint=_fingerprint(asked, checked) if status == "fail" else "",
        parts=tuple(parts),
    )
    return marked, pictures


def _fingerprint(asked: list[Question], checked: list[CheckedPicture]) -> str:
    """A fingerprint of the pictures of named scenes, the same for all; empty where one of them has no numbers."""
    named = [(a, c) for a, c in zip(asked, checked, strict=True) if not a.drawn]
    if not named or any(c.got is None and not c.part.passed for _, c in named):
        return ""
    right = [a.case.expected[0] for a, _ in named]
    return fingerprint(right, [r if c.got is None else c.got for r, (_, c) in zip(right, named, strict=True)])


def student_words(found: Diagnosis) -> tuple[str, ...]:
    """The diagnosis in sentences for a student: each mistake, what may be meant as well, what is wrong beside it."""
    if not found.causes:
        where = (f"no single common mistake fits: {found.where}",)
        near = found.nearest if found.explained >= 0.5 else None
        return (*where, f"closest to it, but not all of it: {near.sentence}") if near else where
    said = []
    for cause, others in zip(found.causes, found.alternatives, strict=True):
        said += [cause.sentence, *(f"or, with the same effect in these pictures: {o.sentence}" for o in others)]
    first, more, _ = found.where.partition("something else is wrong")
    clause = first.partition(";")[0]
    said += [f"your pictures are {clause}"] if clause else []
    return (*said, "something else is wrong, too") if more else tuple(said)
