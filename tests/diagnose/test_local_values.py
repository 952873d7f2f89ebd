"""What a run tells of changes is what they do to the function."""

import ast
import marshal
from typing import Any

import numpy as np
import pytest
from starter_submissions import PLAIN

from raytwin.contract.stage_table import LESSONS
from raytwin.diagnose.attempt import local_values, print_of
from raytwin.diagnose.local_values import values_text
from raytwin.diagnose.operators import edits


def outcome(text: str, name: str, arguments: Any) -> Any:
    space: dict[str, Any] = {"np": np}
    try:
        with np.errstate(all="ignore"):
            exec(text, space)
            return print_of(space[name](*arguments))
    except Exception:
        return "raised"


@pytest.mark.parametrize("name", ["intersect_sphere", "shade", "undo_lens"])
def test_what_is_dismissed_raises_or_does_as_another_change_or_nothing(name: str) -> None:
    statement = next(s for s in ast.parse(PLAIN).body if isinstance(s, ast.FunctionDef) and s.name == name)
    rng = np.random.default_rng(0)
    arguments: Any = LESSONS[name].cases(3)[0].args if name in LESSONS else (rng.normal(0, 0.2, (2, 5)), 0, 0)
    if name == "undo_lens":
        arguments = (*arguments[0], np.array([-0.2, 0.05, 0.001, -0.0005, 0.01]))
    some = edits(statement)
    code, numbers = values_text(statement, some, 7)
    space: dict[str, Any] = {"np": np}
    with np.errstate(all="ignore"):
        rows = local_values(space, name, [[marshal.loads(code)]], [(name,)], [], list(arguments), 20.0)
    at = {place: edit for edit, place in numbers.items()}
    told = {(place, number): group for place, number, group, whole in rows if whole or group < 0}
    assert sum(group != number + 1 for _, number, group, _ in rows) > len(some) / 4
    own = outcome(ast.unparse(statement), name, arguments)
    for (place, number), group in told.items():
        if number >= 0 and group != number + 1:
            got = outcome(ast.unparse(at[place, number].applied(statement)), name, arguments)
            other = at[place, group - 1].applied(statement) if group > 0 else statement
            like = "raised" if group < 0 else own if group == 0 else outcome(ast.unparse(other), name, arguments)
            # Values that are equal to 12 digits may differ in the last of those of the result.
            assert got == like or (got[1] == like[1] and "raised" not in (got, like)), at[place, number].operator


def test_a_copy_and_what_calls_the_students_own_functions_is_not_dismissed() -> None:
    (statement,) = ast.parse("def f(x):\n    y = x\n    z = helper(y)\n    return z").body
    _, numbers = values_text(statement, edits(statement), 0)
    assert not any(edit.operator == "a copy is missing" or edit.line == 3 for edit in numbers)
