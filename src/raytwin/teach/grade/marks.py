"""What is found of the answers: of each exercise which parts are correct, and the cause of what is not; no points."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import msgspec
import numpy as np

from raytwin.explain.diagnosis import diagnose
from raytwin.explain.explanation import Explanation
from raytwin.teach.contract.check_function import judge, student_words
from raytwin.teach.contract.composed_tracer import NEEDED
from raytwin.teach.contract.stage_result import says_why
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.grade.check_picture import check_picture, wrong_picture
from raytwin.teach.grade.follow_through import ask_again
from raytwin.teach.grade.questions import CheckedPicture, Question
from raytwin.teach.grade.result import SUREST, Again, CodeLine, Marked, MarkedPart, Picture, Result, Status
from raytwin.teach.grade.rubric import Exercise, Rubric
from raytwin.teach.grade.sandboxed_repair import LineSearch
from raytwin.teach.sandbox.sandbox import Code

MAX_SEARCHES = 3
"""Searches for the causes of a submission's pictures, at most: of all of them, and of those of single exercises."""
WORSE_FACTOR = 1.25
"""Multiple of the wrong pixels: if correct functions leave more, they do not fit the submission's own ways."""
MAX_WHOLE_PICTURES = 3
"""Wrong pictures of a submission that can be looked at pixel by pixel; of the others there is a small one."""
LINES_AROUND = 2
"""Lines that are shown before and after the one to look at."""
MAX_LINE_CHARACTERS = 160
"""Characters of a line that are shown."""
LINE_REFERENCE = re.compile(r"(?:(cell \d+), |([^\s,]+\.py), )?line (\d+)")


def marked(result: Result, rubric: Rubric, asked: list[Question], problem: str, code: Code | None = None) -> Result:
    """Return the result with its exercises, whose points `with_points` fills in.

    Functions that fail alone are repaired before causes of pictures are looked for: the same change may make these
    right, too.
    """
    with LineSearch(rubric, None if problem else code) as line_search:
        exercises, pictures = _marked(result.seed, rubric, asked, line_search)
    if code is not None:
        exercises = [msgspec.structs.replace(m, code=lines_of(m, code)) for m in exercises]
    return msgspec.structs.replace(
        result,
        exercises=tuple(exercises),
        pictures=tuple(pictures),
        problem=problem,
        own_seconds=round(sum(a.answer.seconds for a in asked), 4),
    )


def _marked(
    seed: int, rubric: Rubric, asked: list[Question], line_search: LineSearch
) -> tuple[list[Marked], list[Picture]]:
    of = {e.name: [a for a in asked if a.exercise is e] for e in rubric.exercises}
    shown = [a for a in asked if a.scene is not None]
    for one in shown:
        one.checked = check_picture(one)
    marks = {e.name: _mark_stage(of[e.name]) for e in rubric.exercises if of[e.name][0].scene is None}
    failed = [m.stage for m in marks.values() if m.status not in ("pass", "missing")]
    replaced = ask_again(line_search.child_with, shown, failed) if line_search.code else ()
    drawn_ones = [e for e in rubric.exercises if e.name not in marks]
    status = {name: m.status for name, m in marks.items()}
    status |= {e.name: _status([a.checked.part for a in of[e.name] if a.checked], of[e.name]) for e in drawn_ones}
    wrong_stages = {e.stage for e in rubric.exercises if status[e.name] != "pass"}
    right = [stage for stage in dict.fromkeys(e.stage for e in rubric.exercises) if stage not in wrong_stages]
    spoilt = [a for a in shown if not a.passed]
    beside = dict.fromkeys(a.exercise.stage for a in spoilt if not a.fixed)
    marks |= {m.name: m for m in line_search.with_lines([*marks.values()], right, beside=[*beside])}
    mended = [a for a in spoilt if a.exercise.stage in line_search.found]
    causes = _Causes(shown, replaced, [m for m in marks.values() if m.stage in replaced], mended, seed)
    pictures: list[Picture] = []
    for exercise in drawn_ones:
        marks[exercise.name], wrong = _mark_pictures(exercise, of[exercise.name], causes)
        pictures += wrong
    made = [marks[e.name] for e in drawn_ones]
    unclear = [m for m in made if not (m.follows or says_why(m.sureness, m.faults))]
    cases = [(a.exercise.stage, a.case) for a in spoilt if a.reference is None]
    found = line_search.with_lines(unclear, right, replaced if causes.has_second else (), pictures=cases)
    marks |= {m.name: m for m in found}
    return [line_search.with_mistake(marks[e.name]) for e in rubric.exercises], pictures


def _status(parts: Sequence[MarkedPart], asked: Sequence[Question]) -> Status:
    """The most telling of what became of the calls."""
    sorts = [a.answer.sort for a in asked]
    for sort in ("limit", "broken", "missing", "error"):
        if sort in sorts:
            return sort
    if all(p.passed for p in parts):
        return "pass"
    return "error" if all(p.problem and p.wrong is None for p in parts) else "fail"


def _mark_stage(asked: list[Question]) -> Marked:
    exercise = asked[0].exercise
    stage = LESSONS[exercise.stage]
    if exercise.tolerance is not None:
        stage = replace(stage, tolerance=exercise.tolerance)
    outcomes = [a.answer.problem or tuple(x.astype(float) for x in a.answer.arrays) for a in asked]
    found = judge(stage, [a.case for a in asked], outcomes)
    parts = tuple(
        MarkedPart(c.shows, c.passed, 0.0, c.error, c.wrong, a.answer.seconds, a.answer.problem)
        for c, a in zip(found.cases, asked, strict=True)
    )
    return Marked(
        name=exercise.name,
        stage=exercise.stage,
        status=_status(parts, asked),
        unit=found.unit,
        tolerance=found.tolerance,
        judged_by=stage.judged_by,
        sentences=(found.sentence,),
        causes=found.causes,
        sureness=found.sureness,
        faults=found.faults or tuple((name, found.sentence) for name in found.causes),
        mistakes=found.causes if says_why(found.sureness, found.faults) else (),
        inputs=found.inputs,
        expected=found.expected,
        got=found.got,
        parts=parts,
    )


class _Found(NamedTuple):
    """What is said of an exercise's pictures; `faults`: (name, sentence) of each mistake.

    `because`: functions that make them wrong; `mistakes`: what explains each all that is wrong.
    """

    sentences: tuple[str, ...] = ()
    faults: tuple[tuple[str, str], ...] = ()
    sureness: str = ""
    because: tuple[str, ...] = ()
    mistakes: tuple[str, ...] = ()


class _Causes:
    """The causes of wrong pictures. One tracer made them all, so they are diagnosed together.

    `failed`: functions that fail alone and were `replaced` by correct ones. `mended`: pictures for which a change of
    the text is known. Tried in this order: pictures that are correct with correct functions are `by_functions`, unless
    the pictures name a cause that the functions do not; `as_handed_in`, one diagnosis of all other pictures; and where
    correct functions leave less wrong (`has_second`), `second`, a diagnosis of the pictures made with them.
    """

    def __init__(
        self, every: Sequence[Question], replaced: tuple[str, ...], failed: list[Marked], mended: list[Question],
        seed: int,
    ) -> None:  # fmt: skip
        self.replaced, self.failed, self.mended, self.seed = replaced, failed, mended, seed
        self.shown = shown = [a for a in every if a not in mended]
        self.searches, self.functions = MAX_SEARCHES, " and ".join(f"`{name}`" for name in replaced)
        known = bool(failed) and all(m.faults or m.repair for m in failed)
        again = [a for a in shown if a.again is not None]
        fixed = any(a.again for a in every) and all(a.fixed for a in again)
        self.has_second = any(_is_nearer(a) for a in again if not a.fixed)
        self.as_handed_in: Explanation | None = None
        if not (known and self.has_second):
            explained = again if known and fixed else []
            self.as_handed_in = self._diagnosed([a.checked for a in shown if a not in explained])
        named = self.as_handed_in is not None and self.as_handed_in.cause is not None
        self.by_functions = fixed and (known or not named)
        self.second: Explanation | None = None
        if self.has_second and not named:
            found = self._diagnosed([a.again or a.checked for a in shown])
            if found is not None and found.cause is not None:
                self.second = found
            else:
                self.as_handed_in = self.as_handed_in or self._diagnosed([a.checked for a in shown])

    def _diagnosed(self, checked: Sequence[CheckedPicture | None]) -> Explanation | None:
        """None if nothing is wrong, there are no numbers, or no search is left."""
        seen = [c for c in checked if c is not None and c.view is not None]
        if self.searches == 0 or all(c.part.passed for c in seen):
            return None
        self.searches -= 1
        return diagnose([c.view for c in seen if c.view is not None], self.seed)

    def of(self, asked: Sequence[Question]) -> _Found:
        """Return what is said of one exercise."""
        wrong = [a for a in asked if not a.passed]
        if wrong and all(a.fixed for a in wrong) and self.failed and (self.by_functions or self.second):
            faults = tuple(dict.fromkeys(fault for m in self.failed for fault in m.faults))
            sureness = max((m.sureness for m in self.failed), key=SUREST.index) if faults else ""
            once = f"{self.functions} is" if len(self.replaced) == 1 else "these are"
            caused = f"Caused by {self.functions}. Once {once} correct, so is this picture."
            return _Found((caused,), faults, sureness, self.replaced)
        if not any(a.checked and a.checked.view for a in wrong) or any(a in self.mended for a in asked):
            return _Found()
        found = self.second or self.as_handed_in
        if found is not None and found.cause is None and any(not a.passed and a not in asked for a in self.shown):
            found = self._diagnosed([a.checked for a in asked]) or found
            # What other pictures speak against is not proved.
            found = replace(found, certainty="likely" if found.cause else "unknown")
        if found is None:
            return _Found()
        faults = ((found.cause.name, found.cause.sentence),) if found.cause else ()
        makes = "makes" if len(self.replaced) == 1 else "make"
        beside = (f"{self.functions} {makes} it wrong, too",) if self.second is not None else ()
        said = (*student_words(found), *beside)
        alone = self.second is None and says_why(found.certainty, faults)
        return _Found(said, faults, found.certainty if faults else "", (), tuple(n for n, _ in faults) if alone else ())


def _is_nearer(asked: Question) -> bool:
    """Whether another picture came of correct functions, of which hardly more is wrong."""
    before, after = asked.checked, asked.again
    if before is None or after is None or before.got is None or after.got is None:
        return after is not None and after.got is not None
    same = before.got.shape == after.got.shape and np.array_equal(before.got, after.got, equal_nan=True)
    worse = (after.part.wrong or 0.0) > WORSE_FACTOR * (1.0 if before.part.wrong is None else before.part.wrong)
    return not same and not worse


def _mark_pictures(exercise: Exercise, asked: list[Question], causes: _Causes) -> tuple[Marked, list[Picture]]:
    found = causes.of(asked)
    checked = [(a, a.checked) for a in asked if a.checked is not None]
    parts = tuple(c.part for _, c in checked)
    status = _status(parts, asked)
    sentences = (*found.sentences, *dict.fromkeys(p.problem for p in parts if p.problem))
    if not sentences and status == "pass":
        sentences = (f"correct in all {len(parts)} pictures" if len(parts) > 1 else "the picture is correct",)
    made_of = tuple(dict.fromkeys(a.made_of for a in asked if a.made_of))
    sentences = (*sentences, *made_of)
    # Pixel by pixel the worst; the others stay small.
    wrong = [(a, c, c.got) for a, c in checked if c.got is not None]
    wrong.sort(key=lambda w: -(w[1].part.error or 0))
    pictures = [wrong_picture(a, got, c.scale, whole=i < MAX_WHOLE_PICTURES) for i, (a, c, got) in enumerate(wrong)]
    if status == "fail":
        parts = tuple(msgspec.structs.replace(c.part, again=_again(a, causes.replaced)) for a, c in checked)
    marked = Marked(
        name=exercise.name,
        stage=exercise.stage,
        status=status,
        unit="of the picture's scale" if exercise.stage == "render" else "m",
        tolerance=asked[0].tolerance.p999_abs,
        judged_by="the sequential verdict" if exercise.sampled else "",
        sentences=sentences or ("wrong, and no single common mistake fits",),
        causes=tuple(name for name, _ in found.faults),
        sureness=found.sureness,
        faults=found.faults,
        mistakes=() if made_of else found.mistakes,
        because=found.because,
        parts=parts,
    )
    return marked, pictures


def _again(asked: Question, replaced: Sequence[str]) -> Again | None:
    """What became of the picture with correct functions; None where it was not asked for again, or there was none."""
    if asked.again is None or asked.answer.problem:
        return None
    part, needed = asked.again.part, NEEDED[asked.exercise.stage]
    own = 1 - len(set(needed) & set(replaced)) / len(needed) if asked.made_of else 1.0
    return Again(part.passed, part.error, part.wrong, own)


def lines_of(m: Marked, code: Code) -> tuple[CodeLine, ...]:
    """The lines of the submission that the hint names, or else the error, with their neighbours."""
    found = [place for said in (*m.mistakes[-1:], *m.sentences) for place in LINE_REFERENCE.findall(said)]
    if m.status == "pass" or not found or (found[0][1] and found[0][1] != code.file.rpartition(" ")[2]):
        return ()
    cell = found[0][0]
    named = {int(n) for where, file, n in found if (where, file) == found[0][:2]}
    text = dict(code.cells).get(cell, "") if code.cells else code.source
    near = {n + k for n in named for k in range(-LINES_AROUND, LINES_AROUND + 1)}
    every = enumerate(text.splitlines(), start=1)
    return tuple(CodeLine(n, line[:MAX_LINE_CHARACTERS], n in named) for n, line in every if n in near)
