"""Follow-through credit: a picture that is wrong because of a function that failed on its own is not lost twice.

Wrong pictures are asked for once more, with the right function in the failed one's place, wherever the submission's
modules have its name. What is right then needs no other cause, and earns the rubric's `follow_through` of its points;
what is still wrong has a second one. A picture that is made of functions alone earns only the share of those that are
the submission's own.
"""

import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import FunctionType

import msgspec

from raytwin.contract.composed_tracer import NEEDED, PARTS
from raytwin.diagnose import textbook
from raytwin.grade.check_picture import CheckedPicture, check_picture
from raytwin.grade.questions import Question
from raytwin.grade.result import Marked, Result
from raytwin.grade.rubric import Rubric
from raytwin.grade.sandboxed_calls import ask
from raytwin.sandbox.sandbox import Code, Sandbox

REPLACE = "raytwin_replace"
DRIVER = f"""
raytwin_replaced = []

def {REPLACE}(text, names):
    import os, sys
    import numpy
    while raytwin_replaced:
        setattr(*raytwin_replaced.pop())
    right = {{}}
    exec(text, right)
    def quiet(function):
        def called(*arguments, **named):
            with numpy.errstate(all="ignore"):
                return function(*arguments, **named)
        return called
    folder = os.path.dirname(__file__)
    own = [m for m in list(sys.modules.values()) if str(getattr(m, "__file__", "")).startswith(folder)]
    for name in names:
        old, new = globals().get(name), quiet(right[name])
        for module in own:
            for key, value in list(vars(module).items()):
                if value is old and old is not None:
                    raytwin_replaced.append((module, key, old))
                    setattr(module, key, new)
    return numpy.zeros(0)
"""
"""Runs in the sandbox behind the submission's own text. What was replaced before is put back."""


@dataclass(frozen=True, eq=False)
class Rerun:
    """Wrong pictures, asked for once more with the right functions of these `names` in place of the failed ones.

    `again`: by the question's id, what was asked for and what came of it. `beside`: something else is wrong, too.
    """

    names: tuple[str, ...] = ()
    again: Mapping[int, tuple[Question, CheckedPicture]] = field(default_factory=dict)
    beside: bool = False

    def fixed_by(self, question: Question) -> bool:
        """Whether the failed functions alone made this picture wrong."""
        return id(question) in self.again and self.again[id(question)][1].part.passed


def ask_again(
    child_with: Callable[[Sequence[str]], Sandbox], code: Code, asked: Sequence[Question],
    checked: Mapping[int, CheckedPicture], failed: Sequence[str],
) -> Rerun:  # fmt: skip
    """Ask for the wrong pictures that the failed functions are part of, these replaced.

    `child_with(names)`: the submission in a process, with right functions of these names in place of its own.
    """
    names = tuple(name for name in PARTS if name in failed)
    wrong = [
        q for q in asked if id(q) in checked and not checked[id(q)].part.passed
        and set(NEEDED[q.exercise.stage]) & set(names) and q.answer.sort in ("", "error")
    ]  # fmt: skip
    if not (wrong and code.kind == "python"):
        return Rerun()
    again, child = {}, child_with(names)
    for question in wrong:
        copy = replace(question, made_of="")
        ask(copy, child, code, names)
        again[id(question)] = copy, check_picture(copy)
    return Rerun(names, again)


def followed(result: Result, rubric: Rubric, asked: Sequence[Question], helped: Rerun) -> Result:
    """Return the result with follow-through credit."""
    if not (rubric.follow_through and helped.again):
        return result
    exercises = []
    for exercise in result.exercises:
        mine = [q for q in asked if q.exercise.name == exercise.name]
        if exercise.status == "fail" and any(id(q) in helped.again for q in mine):
            exercise = _credited(exercise, [_share(q, helped) for q in mine], rubric.follow_through, helped.names)
        exercises.append(exercise)
    return msgspec.structs.replace(result, exercises=tuple(exercises))


def _share(question: Question, helped: Rerun) -> float:
    """What the picture earns with the right functions in place of the failed ones, 0 to 1."""
    if id(question) not in helped.again or question.answer.problem:
        return 0.0
    again, checked = helped.again[id(question)]
    needed = NEEDED[question.exercise.stage]
    own = 1 - len(set(needed) & set(helped.names)) / len(needed)
    return checked.part.share * (own if again.made_of else 1.0)


def _credited(exercise: Marked, shares: Sequence[float], rate: float, names: Sequence[str]) -> Marked:
    parts = tuple(
        msgspec.structs.replace(p, share=max(p.share, round(rate * share, 6)))
        for p, share in zip(exercise.parts, shares, strict=True)
    )
    points = round(exercise.of * sum(p.share for p in parts) / len(parts), 4)
    if points <= exercise.points:
        return exercise
    more = round(points - exercise.points, 4)
    said = (
        f"you lose points for your {' and '.join(names)}, and keep {f'{more:.2f}'.rstrip('0').rstrip('.')} here for "
        "what is right without it"
    )
    sentences = (*exercise.sentences, said)
    return msgspec.structs.replace(exercise, parts=parts, points=points, followed=more, sentences=sentences)


def source_of(names: Sequence[str]) -> str:
    """The text of the textbook's functions, with all that they call."""
    found: dict[str, Callable[..., object]] = {}
    todo = list(names)
    while todo:
        function = getattr(textbook, name := todo.pop())
        if name not in found and isinstance(function, FunctionType):
            found[name] = function
            todo += [n for n in function.__code__.co_names if isinstance(vars(textbook).get(n), FunctionType)]
    texts = [textwrap.dedent(inspect.getsource(f)) for f in found.values()]
    return "\n\n".join(["from typing import Any\nimport numpy as np", *texts])
