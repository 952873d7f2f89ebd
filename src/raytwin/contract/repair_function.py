"""The line to look at: a student's function of a stage, repaired by one change of its text, in this process."""

import inspect
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from raytwin.contract.stage import Case, Function, Stage
from raytwin.diagnose.repair import A_CALL, Answers, Candidate, Cells, Repair, attempt, repair

SECONDS = 4.0
"""Of computing, after which no further change is tried."""


def repair_here(
    stage: Stage,
    function: Function,
    cases: Sequence[Case],
    is_right: Callable[[Case, Any], bool],
    source: str = "",
    seconds: float = SECONDS,
) -> Repair | None:
    """The change that makes the function right in all `cases`, of which the first is wrong; None where none is found.

    Nothing is tried on a function whose text is not known: `source`, its file, or a notebook's cells.
    """
    space, name = getattr(function, "__globals__", None), getattr(function, "__name__", "")
    if space is None or space.get(name) is not function or not (cells := _cells(function, source)):
        return None
    began = time.process_time()

    def run(chosen: Sequence[Candidate], arguments: Sequence[Any]) -> Answers:
        codes, names = [c.code for c in chosen], [c.names for c in chosen]
        made: Answers = attempt(space, name, codes, names, arguments, A_CALL)
        return made

    return repair(cells, name, cases, is_right, run, lambda: time.process_time() - began < seconds)


def _cells(function: Function, source: str) -> Cells:
    """The text that the function's names come from."""
    if source:
        return [("", source)]
    if isinstance(typed := function.__globals__.get("In"), list):  # a notebook's, or IPython's
        return [(f"cell {k}", text) for k, text in enumerate(typed) if isinstance(text, str)]
    try:
        return [("", "".join(inspect.findsource(function)[0]))]
    except (OSError, TypeError):
        return []


def probe_first(cases: Sequence[Case], wrong: Sequence[bool]) -> list[Case]:
    """The cases in the order that dismisses most changes soonest: a small wrong one, other wrong ones, right ones."""
    order = sorted(range(len(cases)), key=lambda i: (not wrong[i], _size(cases[i]) if wrong[i] else 0))
    return [cases[i] for i in order]


def _size(case: Case) -> float:
    """A case of few numbers takes less time, one of a single number tells less."""
    numbers = sum(np.size(a) for a in case.expected)
    return float(numbers if numbers > 12 else 1e6)
