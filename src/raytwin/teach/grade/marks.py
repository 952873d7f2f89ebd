"""What is found of the answers: of each exercise which parts are correct, and the cause of what is not; no points."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import msgspec
import numpy as np

from raytwin.explain.diagnosis import diagnose
from raytwin.explain.explanation import Explanation
from raytwin.teach.contract.check_function import judge, student_words
from raytwin.teach.contract.stage_result import says_why
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.grade.check_picture import CheckedPicture, check_picture
from raytwin.teach.grade.fingerprint import fingerprint
from raytwin.teach.grade.follow_through import Rerun, ask_again, with_again
from raytwin.teach.grade.questions import Question
from raytwin.teach.grade.result import SUREST, Marked, MarkedPart, Picture, Result, Status
from raytwin.teach.grade.rubric import Exercise, Rubric
from raytwin.teach.grade.sandboxed_repair import LineSearch
from raytwin.teach.grade.wrong_picture import wrong_picture
from raytwin.teach.sandbox.sandbox import Code

MAX_SEARCHES = 3
"""Searches for the causes of a submission's pictures, at most: of all of them, and of those of single exercises."""
WORSE_FACTOR = 1.25
"""Multiple of the wrong pixels: if correct functions leave more, they do not fit the submission's own ways."""
MAX_WHOLE_PICTURES = 3
"""Wrong pictures of a submission that can be looked at pixel by pixel; of the others there is a small one."""


def marked(result: Result, rubric: Rubric, asked: list[Question], problem: str, code: Code | None = None) -> Result:
    """Return the result with its exercises, whose points `marked_by` fills in.

    Functions that fail alone are repaired before causes of pictures are looked for: the same change may make these
    right, too.
    """
    with LineSearch(rubric, None if problem else code) as line_search:
        return _marked(result, rubric, asked, problem, code, line_search)


def _marked(
    result: Result, rubric: Rubric, asked: list[Question], problem: str, code: Code | None, line_search: LineSearch
) -> Result:
    of = {e.name: [a for a in asked if a.exercise is e] for e in rubric.exercises}
    checked = {id(a): check_picture(a) for a in asked if a.scene is not None}
    marks = {e.name: _mark_stage(of[e.name]) for e in rubric.exercises if of[e.name][0].scene is None}
    failed = [m for m in marks.values() if m.status not in ("pass", "missing")]
    helped = (
        ask_again(line_search.child_with, line_search.code, asked, checked, [m.stage for m in failed])
        if line_search.code
        else Rerun()
    )
    drawn_ones = [e for e in rubric.exercises if e.name not in marks]
    status = {name: m.status for name, m in marks.items()}
    status |= {e.name: _status([checked[id(a)].part for a in of[e.name]], of[e.name]) for e in drawn_ones}
    wrong_stages = {e.stage for e in rubric.exercises if status[e.name] != "pass"}
    right = [stage for stage in dict.fromkeys(e.stage for e in rubric.exercises) if stage not in wrong_stages]
    spoilt = [a for a in asked if id(a) in checked and not checked[id(a)].part.passed]
    beside = dict.fromkeys(a.exercise.stage for a in spoilt if not helped.fixed_by(a))
    marks |= {m.name: m for m in line_search.with_lines([*marks.values()], right, beside=[*beside])}
    failed = [marks[m.name] for m in failed]
    mended = {id(a) for a in spoilt if a.exercise.stage in line_search.found}
    outside = {id(a) for a in asked if not a.exercise.inside}
    seen = {k: c for k, c in checked.items() if k in outside}
    again = replace(helped, again={k: pair for k, pair in helped.again.items() if k in outside})
    causes = _Causes(seen, again, [m for m in failed if m.stage in helped.names], result.seed, mended)
    pictures: list[Picture] = []
    for exercise in sorted(drawn_ones, key=lambda e: e.inside):
        mine = of[exercise.name]
        before = [marks[e.name] for e in drawn_ones if e.name in marks]
        found = _from_inside(mine, checked, before, helped) if exercise.inside else causes.of(mine)
        one, wrong = _mark_pictures(exercise, mine, checked, found)
        pictures += wrong
        marks[exercise.name] = with_again(one, of[exercise.name], helped)
    first = [e for e in drawn_ones if not e.inside]
    if all(marks[e.name].status in ("pass", "missing") for e in first):
        first = drawn_ones
    unclear = [m for e in first if not ((m := marks[e.name]).follows or says_why(m.sureness, m.faults))]
    shown = [(a.exercise.stage, a.case) for a in spoilt if a.reference is None]
    marks |= {
        m.name: m
        for m in line_search.with_lines(unclear, right, helped.names if causes.has_second else (), pictures=shown)
    }
    return msgspec.structs.replace(
        result,
        exercises=tuple(_with_repair(marks[e.name], line_search, of[e.name]) for e in rubric.exercises),
        pictures=tuple(pictures),
        problem=problem,
        own_seconds=round(sum(a.answer.seconds for a in asked), 4),
    )


def _with_repair(m: Marked, line_search: LineSearch, asked: Sequence[Question]) -> Marked:
    """The exercise with the hints of the change that repairs it, if one does, and that change as its mistake.

    What repairs pictures from outside is tried on those from inside a sphere.
    """
    found = line_search.found.get(m.stage)
    if found is None or m.status == "pass" or m.because:
        return m
    if asked[0].exercise.inside and not line_search.mends(m.stage, [a.case for a in asked]):
        return m
    hints = tuple(found.hint(level) for level in (1, 2, 3))
    return msgspec.structs.replace(m, hints=hints, mistakes=(*m.mistakes, hints[-1]))


def _status(parts: list[MarkedPart], asked: list[Question]) -> Status:
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
    parts = [
        MarkedPart(
            c.shows,
            c.passed,
            error=c.error,
            wrong=c.wrong,
            seconds=a.answer.seconds,
            problem=a.answer.problem,
        )
        for c, a in zip(found.cases, asked, strict=True)
    ]
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
        parts=tuple(parts),
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

    `failed`: functions that fail alone and that pictures are made of. `mended`: pictures for which a change of the text
    is known. Tried in this order: pictures that are correct with correct functions are `by_functions`, unless
    the pictures name a cause that the functions do not; `as_handed_in`, one diagnosis of all other pictures; and where
    correct functions leave less wrong (`has_second`), `second`, a diagnosis of the pictures made with them.
    """

    def __init__(
        self, checked: Mapping[int, CheckedPicture], helped: Rerun, failed: list[Marked], seed: int,
        mended: Collection[int] = (),
    ) -> None:  # fmt: skip
        self.checked, self.helped, self.failed, self.seed = checked, helped, failed, seed
        self.mended, checked = mended, {k: c for k, c in checked.items() if k not in mended}
        self.searches, self.functions = MAX_SEARCHES, " and ".join(f"`{name}`" for name in helped.names)
        known = bool(failed) and all(m.faults or m.repair for m in failed)
        left = [k for k, (_, again) in helped.again.items() if not (again.part.passed or k in mended)]
        fixed_by = bool(helped.again) and not left
        self.has_second = any(_is_nearer(checked[k], helped.again[k][1]) for k in left)
        self.as_handed_in: Explanation | None = None
        if not (known and self.has_second):
            explained = helped.again if known and fixed_by else {}
            self.as_handed_in = self._diagnosed([c for k, c in checked.items() if k not in explained])
        named = self.as_handed_in is not None and self.as_handed_in.cause is not None
        self.by_functions = fixed_by and (known or not named)
        self.second: Explanation | None = None
        if self.has_second and not named:
            found = self._diagnosed([helped.again[k][1] if k in helped.again else c for k, c in checked.items()])
            if found is not None and found.cause is not None:
                self.second = found
            else:
                self.as_handed_in = self.as_handed_in or self._diagnosed(list(checked.values()))

    def _diagnosed(self, checked: Sequence[CheckedPicture]) -> Explanation | None:
        """None if nothing is wrong, there are no numbers, or no search is left."""
        views = [c.view for c in checked if c.view is not None]
        if self.searches == 0 or not _has_wrong_numbers(checked):
            return None
        self.searches -= 1
        return diagnose(views, self.seed)

    def of(self, asked: Sequence[Question]) -> _Found:
        """Return what is said of one exercise."""
        mine = [self.checked[id(a)] for a in asked]
        wrong = [a for a, c in zip(asked, mine, strict=True) if not c.part.passed]
        if wrong and all(map(self.helped.fixed_by, wrong)) and self.failed and (self.by_functions or self.second):
            faults = tuple(dict.fromkeys(fault for m in self.failed for fault in m.faults))
            sureness = max((m.sureness for m in self.failed), key=SUREST.index) if faults else ""
            once = f"{self.functions} is" if len(self.helped.names) == 1 else "these are"
            caused = f"Caused by {self.functions}. Once {once} correct, so is this picture."
            return _Found((caused,), faults, sureness, self.helped.names)
        if not _has_wrong_numbers(mine) or any(id(a) in self.mended for a in asked):
            return _Found()
        found = self.second or self.as_handed_in
        others = any(not c.part.passed for c in self.checked.values() if all(c is not one for one in mine))
        if found is not None and found.cause is None and others:
            found = self._diagnosed(mine) or found
            # What other pictures speak against is not proved.
            found = replace(found, certainty="likely" if found.cause else "unknown")
        if found is None:
            return _Found()
        faults = ((found.cause.name, found.cause.sentence),) if found.cause else ()
        makes = "makes" if len(self.helped.names) == 1 else "make"
        beside = (f"{self.functions} {makes} it wrong, too",) if self.second is not None else ()
        said = (*student_words(found), *beside)
        alone = self.second is None and says_why(found.certainty, faults)
        return _Found(said, faults, found.certainty if faults else "", (), tuple(n for n, _ in faults) if alone else ())


def _has_wrong_numbers(checked: Sequence[CheckedPicture]) -> bool:
    return any(c.view is not None and not c.part.passed for c in checked)


def _is_nearer(before: CheckedPicture, after: CheckedPicture) -> bool:
    """Whether another picture came of correct functions, of which hardly more is wrong."""
    if before.got is None or after.got is None:
        return after.got is not None
    same = before.got.shape == after.got.shape and np.array_equal(before.got, after.got, equal_nan=True)
    worse = (after.part.wrong or 0.0) > WORSE_FACTOR * (1.0 if before.part.wrong is None else before.part.wrong)
    return not same and not worse


def _from_inside(
    asked: Sequence[Question], checked: Mapping[int, CheckedPicture], others: Sequence[Marked], helped: Rerun
) -> _Found:
    """What is said of pictures from inside a sphere. They tell little, so other pictures that are wrong come first."""
    if not (wrong := [a for a in asked if not checked[id(a)].part.passed]):
        return _Found()
    if failed := [m for m in others if m.status not in ("pass", "missing")]:
        first = next((m for m in failed if m.because or m.mistakes), failed[0])
        said = f"Pictures from outside are wrong, too. Start with {first.name}."
        return _Found((said,), (), "", first.because if all(map(helped.fixed_by, wrong)) else (), first.mistakes)
    outcomes = [a.answer.problem or tuple(x.astype(float) for x in a.answer.arrays) for a in asked]
    found = judge(LESSONS[asked[0].exercise.stage], [a.case for a in asked], outcomes)
    mistakes = found.causes if says_why(found.sureness, found.faults) else ()
    return _Found(() if found.passed else (found.sentence,), found.faults, found.sureness, (), mistakes)


def _mark_pictures(
    exercise: Exercise, asked: list[Question], every: Mapping[int, CheckedPicture], found: _Found
) -> tuple[Marked, list[Picture]]:
    checked = [every[id(a)] for a in asked]
    parts = [c.part for c in checked]
    status = _status(parts, asked)
    sentences = (*found.sentences, *dict.fromkeys(p.problem for p in parts if p.problem))
    if not sentences and status == "pass":
        sentences = (f"correct in all {len(parts)} pictures" if len(parts) > 1 else "the picture is correct",)
    made_of = tuple(dict.fromkeys(a.made_of for a in asked if a.made_of))
    sentences = (*sentences, *made_of)
    # Pixel by pixel the worst; the others stay small.
    wrong = [(a, c.got, c) for a, c in zip(asked, checked, strict=True) if c.got is not None]
    wrong.sort(key=lambda w: -(w[2].part.error or 0))
    pictures = [wrong_picture(a, got, h.scale, whole=i < MAX_WHOLE_PICTURES) for i, (a, got, h) in enumerate(wrong)]
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
        fingerprint=_fingerprint(asked, checked) if status == "fail" else "",
        parts=tuple(parts),
    )
    return marked, pictures


def _fingerprint(asked: list[Question], checked: list[CheckedPicture]) -> str:
    """A fingerprint of the pictures of named scenes, the same for all; empty where one of them has no numbers."""
    named = [(a, c) for a, c in zip(asked, checked, strict=True) if not a.drawn and a.reference is None]
    if not named or any(c.got is None and not c.part.passed for _, c in named):
        return ""
    right = [a.case.expected[0] for a, _ in named]
    return fingerprint(right, [r if c.got is None else c.got for r, (_, c) in zip(right, named, strict=True)])
