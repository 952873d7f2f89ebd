"""The instructor's own words: a rubric's `[[feedback]]` rows, said to whoever has the wrong numbers that a row is for.

    [[feedback]]
    stage = "shade"
    name = "half-vector"
    sentence = "you shade with the half vector: Lambert's law has the normal"
    fingerprint = "0.0312 -0.41 ..."      # pasted from the class page

Fingerprints are stored with the results, so a row costs no grading: the next run says it, and next year's, too.
"""

from collections.abc import Sequence

import msgspec

from raytwin.teach.grade.fingerprint import same
from raytwin.teach.grade.result import Marked, Result
from raytwin.teach.grade.rubric import Feedback, Rubric


def with_feedback(result: Result, rubric: Rubric) -> Result:
    """Return the result with the rubric's own sentences first where their fingerprints match."""
    exercises = tuple(_with_row(e, rubric.feedback) for e in result.exercises)
    return result if exercises == result.exercises else msgspec.structs.replace(result, exercises=exercises)


def _with_row(exercise: Marked, rows: Sequence[Feedback]) -> Marked:
    found = [r for r in rows if r.stage == exercise.stage and same(r.fingerprint, exercise.fingerprint)]
    if not found:
        return exercise
    name = found[0].name or found[0].sentence
    # What the grader guessed gives way; a hint that a repair has proved stays behind it.
    others = exercise.sentences if exercise.sureness == "proved" else ()
    return msgspec.structs.replace(
        exercise,
        sentences=(found[0].sentence, *others),
        causes=(name,),
        faults=((name, found[0].sentence),),
        sureness="named",
    )


def unnamed(results: Sequence[Result]) -> list[tuple[Marked, list[Result]]]:
    """The wrong results of which neither cause nor line is known, those that several share first, each with whose."""
    groups: list[tuple[Marked, list[Result]]] = []
    for result in results:
        for exercise in result.exercises:
            if exercise.status != "fail" or exercise.named or exercise.follows or not exercise.fingerprint:
                continue
            for first, who in groups:
                if first.stage == exercise.stage and same(first.fingerprint, exercise.fingerprint):
                    who += [] if result in who else [result]
                    break
            else:
                groups.append((exercise, [result]))
    return sorted(groups, key=lambda group: -len(group[1]))


def row_of(exercise: Marked) -> str:
    """The row to paste into the rubric, its sentence to be written."""
    return (
        f'[[feedback]]\nstage = "{exercise.stage}"\nname = ""\nsentence = ""\nfingerprint = "{exercise.fingerprint}"\n'
    )
