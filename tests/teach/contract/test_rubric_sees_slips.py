"""Every slip in the textbook that changes anything fails its function's cases: generated, none is written down."""

import ast
import warnings

import numpy as np
import pytest

from raytwin.explain.edits import edits
from raytwin.explain.textbook import TEXT, tracer_with
from raytwin.teach.contract.check_function import call_stage, is_right
from raytwin.teach.contract.stage import Case
from raytwin.teach.contract.stage_table import CONTRACT

ENDLESS = ("an axis is missing",)
"""In a loop it makes arrays without end."""
STATEMENTS = {s.name: s for s in ast.parse(TEXT).body if isinstance(s, ast.FunctionDef)}


def slipped(function, part, edit):
    """The textbook's function with this slip in one of its parts; None where that cannot be compiled."""
    space = getattr(tracer_with(), function).__globals__
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.Module([edit.applied(STATEMENTS[part])], [])
            exec(compile(ast.fix_missing_locations(tree), "slip", "exec"), space)
    except (SyntaxError, TypeError, ValueError):
        return None
    return space[function]


def lenses(rng):
    """Any lens that does not fold, either sign of every coefficient, up to 45 degrees to the side."""
    for _ in range(3):
        K = np.array([[11.0, 0, 9.2], [0, 11.5, 6.1], [0, 0, 1]])
        yield K, rng.uniform([-0.1, 0.0, -0.005, -0.005, -0.004], [0.1, 0.05, 0.005, 0.005, 0.004]), 20, 13


def rays(rng):
    for radius in (0.2, 0.7):
        o, d = rng.normal(size=(2, 200, 3))
        yield o, d, rng.normal(size=3) * 0.3, radius


def surfaces(rng):
    for _ in range(2):
        n = rng.normal(size=(60, 3))
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        yield rng.normal(size=(60, 3)), n, rng.uniform(size=(60, 3)), n[0], rng.uniform(size=3), rng.uniform(size=3)


@pytest.mark.parametrize(
    ("function", "parts", "probes", "every"),
    [
        ("intersect_sphere", ("intersect_sphere",), rays, 1),
        ("shade", ("shade",), surfaces, 1),
        ("back_project", ("undistort", "through"), lenses, 7),
    ],
)
def test_every_slip_in_the_textbook_that_changes_anything_fails_a_case(function, parts, probes, every):
    stage = CONTRACT[function]
    cases = sorted(stage.cases(4), key=lambda case: case.shows not in ("a wide and strong lens", "rays that miss"))
    other = [Case("", args, (stage.reference(*args),)) for args in probes(np.random.default_rng(7))]
    unseen, tried = [], 0
    for part in parts:
        some = [e for e in edits(STATEMENTS[part]) if e.weight <= 1.5 and e.operator not in ENDLESS]
        for edit in [e for e in some if "range" not in e.before][::every]:
            slip = slipped(function, part, edit)
            if slip is None:
                continue
            tried += 1
            if all(is_right(stage, case, call_stage(stage, slip, [case])[0]) for case in cases) and not all(
                is_right(stage, case, call_stage(stage, slip, [case])[0]) for case in other
            ):
                unseen.append(f"{part}: {edit.before} -> {edit.after}")
    assert tried > 200
    assert unseen == [], "\n".join(unseen)
