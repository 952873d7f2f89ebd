"""What a stored result is worth by a rubric: arithmetic alone, so that other points or other keys grade nobody again.

One mistake costs points once. What one change of the text repairs, or one proved cause explains, is one mistake, in
however many exercises it shows: the exercise of a function pays for it, or else the picture that loses most. The others
keep the rubric's `follow_through` of their points. So does a picture that is correct once they are replaced.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from raytwin.teach.grade.result import Marked, MarkedPart, Result
from raytwin.teach.grade.rubric import PICTURES, Exercise, Rubric


def with_points(result: Result, rubric: Rubric) -> Result:
    """Return the result with the rubric's names and points.

    Unchanged where it is none of these exercises, as where the grader failed.
    """
    if [m.stage for m in result.exercises] != [e.stage for e in rubric.exercises]:
        return result
    names = {m.name: e.name for m, e in zip(result.exercises, rubric.exercises, strict=True)}
    exercises = _paid_once([_scored(m, e) for m, e in zip(result.exercises, rubric.exercises, strict=True)], rubric)
    pictures = tuple(replace(p, exercise=names[p.exercise]) for p in result.pictures)
    return replace(result, title=rubric.title, exercises=tuple(exercises), pictures=pictures)


def _scored(m: Marked, e: Exercise, kept: Sequence[float] = ()) -> Marked:
    """The exercise with its points. `kept`: of each part, the share that it keeps since its mistake is paid for."""
    earned = [e.share(p.passed, p.error) for p in m.parts]
    shares = [max(own, more) for own, more in zip(earned, kept or earned, strict=True)]
    points, own_points = (round(e.points * sum(some) / max(1, len(some)), 4) for some in (shares, earned))
    parts = tuple(replace(p, share=share) for p, share in zip(m.parts, shares, strict=True))
    about = {"name": e.name, "of": e.points, "visibility": e.visibility, "points": points, "parts": parts}
    return replace(m, **about, followed=round(points - own_points, 4), same_as="")


def _paid_once(marked: Sequence[Marked], rubric: Rubric) -> list[Marked]:
    """The exercises with what they keep, each beside the one that pays for its mistake."""
    payers: dict[str, str] = {}
    for group in _one_mistake_each(marked):
        payer = max(group, key=_pays_first)
        payers |= {m.name: payer.name for m in group if m is not payer}
    rate, made = rubric.follow_through, []
    for m, e in zip(marked, rubric.exercises, strict=True):
        if m.name in payers:
            made.append(replace(_scored(m, e, [rate] * len(m.parts)), same_as=payers[m.name]))
        else:
            made.append(_scored(m, e, [_share_again(p, e, rate) for p in m.parts]))
    return made


def _pays_first(m: Marked) -> tuple[bool, bool, float, bool]:
    return m.points < m.of, m.stage not in PICTURES, m.of - m.points, m.visibility == "visible"


def _one_mistake_each(marked: Sequence[Marked]) -> list[list[Marked]]:
    """Groups of exercises that are wrong by one mistake."""
    groups: list[list[Marked]] = []
    for m in (m for m in marked if m.mistakes):
        same = [g for g in groups if any(set(m.mistakes) & set(other.mistakes) for other in g)]
        groups = [g for g in groups if g not in same] + [[*(other for g in same for other in g), m]]
    return groups


def _share_again(p: MarkedPart, e: Exercise, rate: float) -> float:
    """What a picture keeps that was asked for again with correct functions in place of the failed ones."""
    if p.again is None:
        return 0.0
    return round(rate * p.again.own * e.share(p.again.passed, p.again.error), 6)
