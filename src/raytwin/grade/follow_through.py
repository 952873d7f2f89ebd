"""Follow-through credit: a picture that is wrong because of a function that failed on its own is not lost twice.

Wrong pictures are asked for once more, with the right function in the failed one's place, wherever the submission's
modules have its name. What is right then earns the rubric's `follow_through` of its points. A picture that is made of
functions alone earns only the share of those that are the submission's own.
"""

import inspect
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import FunctionType

import msgspec

from raytwin.contract.composed_tracer import NEEDED, PARTS
from raytwin.diagnose import textbook
from raytwin.grade.check_picture import check_picture
from raytwin.grade.questions import Question
from raytwin.grade.result import Marked, Result
from raytwin.grade.rubric import Rubric
from raytwin.grade.sandboxed_calls import ask
from raytwin.sandbox.sandbox import Code, Sandbox

REPLACE = """
def raytwin_replace(text, names):
    import os, sys
    import numpy
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
                    setattr(module, key, new)

raytwin_replace({text!r}, {names!r})
"""
"""Runs in the sandbox behind the submission's own text."""


def followed(result: Result, rubric: Rubric, code: Code, asked: Sequence[Question]) -> Result:
    """Return the result with follow-through credit."""
    failed = {e.stage for e in result.exercises if e.stage in PARTS and e.status not in ("pass", "missing")}
    own = [e for e in rubric.exercises if set(NEEDED.get(e.stage, ())) & failed]
    if not (rubric.follow_through and own and code.kind == "python"):
        return result
    names = [name for name in PARTS if name in failed]
    changed = code.followed_by(REPLACE.format(text=source_of(names), names=names))
    marked = {e.name: e for e in result.exercises}
    with Sandbox(changed, rubric.limits, (Path(rubric.folder), Path.cwd())) as child:
        for exercise in own:
            mine = [q for q in asked if q.exercise is exercise]
            if mine[0].scene is not None and marked[exercise.name].status == "fail":
                shares = [
                    _share(q, p.passed, names, child, code)
                    for q, p in zip(mine, marked[exercise.name].parts, strict=True)
                ]
                marked[exercise.name] = _credited(marked[exercise.name], shares, rubric.follow_through, names)
    return msgspec.structs.replace(result, exercises=tuple(marked[e.name] for e in result.exercises))


def _share(question: Question, passed: bool, replaced: Sequence[str], child: Sandbox, code: Code) -> float:
    """What the picture earns with the right functions in place of the failed ones, 0 to 1."""
    if passed or question.answer.problem:
        return 0.0
    again = replace(question, made_of="")
    ask(again, child, code, replaced)
    part = check_picture(again).part
    needed = NEEDED[question.exercise.stage]
    return part.share * (1 - len(set(needed) & set(replaced)) / len(needed) if again.made_of else 1.0)


def _credited(exercise: Marked, shares: Sequence[float], rate: float, names: Sequence[str]) -> Marked:
    parts = tuple(
        msgspec.structs.replace(p, share=max(p.share, round(rate * share, 6)))
        for p, share in zip(exercise.parts, shares, strict=True)
    )
    points = round(exercise.of * sum(p.share for p in parts) / len(parts), 4)
    if points <= exercise.points:
        return exercise
    more = round(points - exercise.points, 4)
    right = sum(p.passed or share > 0 for p, share in zip(parts, shares, strict=True))
    count = "the picture is" if len(parts) == 1 else f"{right} of the {len(parts)} pictures are"
    said = (
        f"with a right {' and '.join(names)} in place of yours {count} right: you lose points there, and keep "
        f"{f'{more:.2f}'.rstrip('0').rstrip('.')} here"
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
