"""Follow-through: whether a picture is wrong only because of functions that failed on their own.

Wrong pictures are asked for once more, with the correct function in the failed one's place, wherever the submission's
modules have its name. What is correct then needs no other cause; what is still wrong has a second one. Of a picture
that is made of functions alone, the share of those that are the submission's own counts. Of a sampled picture the
samplers are replaced, too.
"""

import inspect
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import FunctionType

from raytwin.explain import textbook
from raytwin.teach.contract.composed_tracer import NEEDED, PARTS
from raytwin.teach.contract.stages import samplers
from raytwin.teach.grade.check_picture import check_picture
from raytwin.teach.grade.questions import Question
from raytwin.teach.grade.sandboxed_calls import ask
from raytwin.teach.sandbox.sandbox import Sandbox

REPLACE = "raytwin_replace"
REPLACE_DRIVER = f"""
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


def ask_again(
    child_with: Callable[[Sequence[str]], Sandbox], shown: Sequence[Question], failed: Sequence[str]
) -> tuple[str, ...]:
    """Ask for the wrong pictures that the failed functions may be part of, these replaced; return their names.

    `child_with(names)`: the submission in a process, with correct functions of these names in place of its own.
    """
    names = tuple(name for name in (*PARTS, *samplers.SAMPLER_NAMES) if name in failed)
    wrong = [q for q in shown if not q.passed and _parts_of(q) & set(names) and q.answer.sort in ("", "error")]
    if not wrong:
        return ()
    child = child_with(names)
    for question in wrong:
        copy = replace(question, made_of="")
        ask(copy, child, "python", names)
        question.again = check_picture(copy)
    return names


def _parts_of(question: Question) -> set[str]:
    """The functions that its picture may be made of."""
    return {*NEEDED[question.exercise.stage], *(samplers.SAMPLER_NAMES if question.exercise.sampled else ())}


def source_of(names: Sequence[str]) -> str:
    """The text of the textbook's functions, with all that they call."""
    found: dict[str, Callable[..., object]] = {}
    todo = [name for name in names if name not in samplers.SAMPLER_NAMES]
    while todo:
        function = getattr(textbook, name := todo.pop())
        if name not in found and isinstance(function, FunctionType):
            found[name] = function
            todo += [n for n in function.__code__.co_names if isinstance(vars(textbook).get(n), FunctionType)]
    texts = [textwrap.dedent(inspect.getsource(f)) for f in found.values()]
    drawn = samplers.source_of([name for name in names if name in samplers.SAMPLER_NAMES])
    return "\n\n".join(["from typing import Any\nimport numpy as np", *texts, drawn])
