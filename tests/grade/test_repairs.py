"""A submission that is graded gets the line to look at, in its sandbox, as far as the rubric's hints go."""

import numpy as np
import pytest
from starter_submissions import SLIPS

from raytwin.diagnose.repair import Repair
from raytwin.grade.check_picture import _compare_points
from raytwin.grade.class_run import jobs_of, run
from raytwin.grade.result import Marked
from raytwin.grade.sandboxed_repair import _with_hint
from raytwin.parallel import Workers
from raytwin.scene import Tolerance

SOURCE = next(s.source for s in SLIPS if s.label == "sum of everything")
LIAR = "\n\nimport marshal\nmarshal.loads = lambda b: compile('raise SystemExit', '', 'exec')\n"
"""Answers nonsense for its repairs."""
LONG = SOURCE + "# " + "x" * 100_000 + "\n"
"""Too long to be read for a line."""


@pytest.mark.parametrize(("text", "told"), [(SOURCE, True), (SOURCE + LIAR, False), (LONG, False)])
def test_the_line_of_a_slip_is_told_where_the_submission_lets_it_be_found(tmp_path, text, told):
    (tmp_path / "r.toml").write_text('title = "t"\nhints = 3\n[[exercises]]\nstage = "intersect_sphere"\npoints = 20\n')
    (tmp_path / "a.py").write_text(text)
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    exercise = result.exercises[0]
    assert exercise.status == "fail"
    fix = "in place of `c = (oc * oc).sum() - radius ** 2` makes everything right"
    for said in ("line 39", fix):
        assert any(said in sentence for sentence in exercise.sentences) == told, exercise.sentences


@pytest.mark.parametrize(("fault", "place"), [("nothing-met", 0), ("endless-planes", 1)])
def test_a_line_comes_before_a_cause_that_says_only_what_is_seen(fault, place):
    said = {"sentences": ("the cause", "where"), "faults": ((fault, "the cause"),), "sureness": "proved"}
    wrong = Marked("image", "render", "fail", 0, 1, "visible", "", 1e-3, **said)
    made = _with_hint(wrong, Repair("", 7, "the sign is wrong", "-a", "a"), 2, "")
    assert [k for k, sentence in enumerate(made.sentences) if "line 7" in sentence] == [place]


@pytest.mark.parametrize(("miss", "passes"), [(np.nan, True), (np.inf, False), (0.0, False)])
def test_points_of_rays_that_meet_nothing_are_nan(miss, passes):
    right = np.zeros((4, 5, 3)) + np.arange(5)[:, None]
    right[:2] = np.nan
    got = np.where(np.isnan(right), miss, right)
    assert _compare_points(right, got, Tolerance())[0] == passes


def test_a_text_that_is_nested_too_deeply_is_graded(tmp_path):
    """As deep as Python's own reader allows."""
    deep = "    return albedo * (n * irradiance + sky * 1.3)" + " + 0 * n" * 800
    head = "def shade(points, normals, albedo, to_light, irradiance, sky):\n    n = abs(normals @ to_light)[:, None]\n"
    (tmp_path / "r.toml").write_text('title = "t"\n[[exercises]]\nstage = "shade"\npoints = 20\n')
    (tmp_path / "a.py").write_text(head + deep)
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    assert (result.problem, result.exercises[0].status) == ("", "fail")
