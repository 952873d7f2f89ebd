"""A slip in a student's text is undone by one change, and its line is named; what is right is left alone."""

import ast
import marshal
import types

import numpy as np
import pytest
from starter_submissions import LOOPS, PLAIN, RIGHT, SLIPS

from raytwin.contract.check_function import judge_function, repair_function
from raytwin.contract.repair_function import _bounded_memory
from raytwin.contract.stage import Case
from raytwin.contract.stage_table import CONTRACT
from raytwin.diagnose.operators import edits, replaced
from raytwin.diagnose.repair import Repair, attempt, candidates, repair
from raytwin.diagnose.textbook import TEXT

QUICK = [s for s in SLIPS if s.label in (
    "norm without axis", "return in the loop", "sum of everything", "or for and", "minimum", "sky without albedo",
)]  # fmt: skip


def module(source):
    made = types.ModuleType("submission")
    exec(compile(source, "submission.py", "exec"), made.__dict__)
    return made


@pytest.mark.parametrize("slip", QUICK, ids=lambda s: s.label)
def test_the_line_of_a_slip_is_named_and_what_to_write_makes_everything_right(slip):
    made, stage = module(slip.source), CONTRACT[slip.shows]
    function = getattr(made, slip.shows)
    found = repair_function(stage, function, source=slip.source)
    assert found is not None
    assert found.line == slip.line
    lines = slip.source.split("\n")
    if "(after the loop)" not in found.after:
        indent = lines[found.line - 1][: -len(lines[found.line - 1].lstrip())]
        lines[found.line - 1] = indent + found.after
        assert judge_function(stage, getattr(module("\n".join(lines)), slip.shows)).passed
    assert getattr(made, slip.shows) is function


@pytest.mark.parametrize("variation", RIGHT)
def test_right_submissions_pass_every_test(variation):
    text, old, new = variation
    made = module(text.replace(old, new) if old else text)
    assert all(judge_function(s, getattr(made, s.name)).passed for s in CONTRACT.values() if hasattr(made, s.name))


def test_hints_say_where_then_what_then_what_to_write():
    found = Repair("cell 3", 7, "a square root is missing", "t = disc", "t = np.sqrt(disc)")
    one, two, three = (found.hint(level) for level in (1, 2, 3))
    assert found.hint(0) == ""
    assert "cell 3, line 7" in one
    assert "square root" not in one
    assert "square root" in two
    assert "np.sqrt(disc)" not in two
    assert "`t = np.sqrt(disc)`" in three


def test_nothing_is_tried_on_a_text_that_is_not_known():
    stage, made = CONTRACT["shade"], module(QUICK[-1].source)
    assert repair_function(stage, made.shade, source="") is None


def test_a_change_that_does_not_end_is_given_up_and_names_are_put_back():
    space = {"f": len}
    codes = [c.code for c in candidates([("", "def f(n):\n    while n < 0:\n        n += 1\n    return n")], "f")]
    made = attempt(space, "f", codes, [("f",)] * len(codes), (1,), 0.02)
    assert None in made
    assert any(one is not None and one[0] == 1 for one in made)
    assert space["f"] is len


@pytest.mark.parametrize("text", [TEXT, LOOPS], ids=["textbook", "loops"])
def test_every_edit_changes_one_place_and_leaves_the_tree_as_it_was(text):
    for statement in (s for s in ast.parse(text).body if isinstance(s, ast.FunctionDef)):
        whole = ast.dump(statement)
        for edit in edits(statement)[::17]:
            assert ast.dump(replaced(statement, edit.old, edit.new)) != whole, edit.after
        assert ast.dump(statement) == whole


def test_a_change_that_asks_for_too_much_memory_is_none():
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    code = candidates([("", "import numpy as np\ndef f(n):\n    return np.ones(n * 40000)[:1]")], "f")
    chosen = [c for c in code if "n ** 40000" in c.edit.after or "n * 40000 ** 2" in c.edit.after]
    with _bounded_memory():
        made = attempt({"np": np}, "f", [c.code for c in chosen], [("f",)] * len(chosen), (7,), 1.0)
    assert made == [None] * len(chosen) != []
    assert resource.getrlimit(resource.RLIMIT_AS) == before


def test_what_is_right_by_its_own_test_is_not_changed():
    bodies = {"lens": "undo(x)", "undo": "x / 2", "ray": "lens(x)", "hit": "ray(x) + 1", "other": "-x"}
    text = "\n".join(f"def {name}(x):\n    return {value}" for name, value in bodies.items())
    assert {name for c in candidates([("", text)], "hit", ("lens",)) for name in c.names} == {"hit", "ray"}


def test_a_change_that_is_right_by_chance_in_the_first_cases_is_no_proof():
    """Of positive numbers a dropped sign does as well as the absolute value that is meant."""
    text, space = "import numpy as np\ndef f(x):\n    return -x\n", {"np": np}
    exec(text, space)

    def run(chosen, arguments):
        return attempt(space, "f", [c.code for c in chosen], [c.names for c in chosen], arguments, 1.0)

    def repaired(further):
        cases = [Case("", (np.array([1.0, 2.0]),), ())]
        right = lambda case, got: np.array_equal(got[0], np.abs(case.args[0]))  # noqa: E731
        return repair([("", text)], "f", cases, right, run, lambda: True, further=further).after

    assert repaired(tuple) == "return x"
    assert repaired(lambda: [Case("", (np.array([-3.0, 2.0]),), ())]) in ("return np.abs(x)", "return np.abs(-x)")


def test_what_repairs_a_random_slip_is_right_in_cases_that_nobody_tried():
    name = "shade"
    stage, tree = CONTRACT[name], ast.parse(PLAIN)
    (statement,) = [s for s in tree.body if isinstance(s, ast.FunctionDef) and s.name == name]
    proved = 0
    for edit in edits(statement)[7::60]:
        source = ast.unparse(replaced(tree, edit.old, edit.new))
        try:
            wrong = getattr(module(source), name)
        except SyntaxError:  # an edit may leave no Python
            continue
        found = repair_function(stage, wrong, source=source)
        if found is not None:
            space = module(source).__dict__
            exec(marshal.loads(found.candidate.code), space)
            assert all(judge_function(stage, space[name], seed).passed for seed in (50, 51, 52)), found
            proved += 1
    assert proved >= 1
