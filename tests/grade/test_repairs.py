"""A submission that is graded gets the line to look at, in its sandbox, as far as the rubric's hints go."""

import pytest
from starter_submissions import SLIPS

from raytwin.grade.class_run import jobs_of, run
from raytwin.parallel import Workers

SOURCE = next(s.source for s in SLIPS if s.label == "sum of everything")
LIAR = "\n\nimport marshal\nmarshal.loads = lambda b: compile('raise SystemExit', '', 'exec')\n"
"""Answers nonsense for its repairs."""


@pytest.mark.parametrize(("text", "told"), [(SOURCE, True), (SOURCE + LIAR, False)])
def test_the_line_of_a_slip_is_told_where_the_submission_lets_it_be_found(tmp_path, text, told):
    (tmp_path / "r.toml").write_text('title = "t"\nhints = 3\n[[exercises]]\nstage = "intersect_sphere"\npoints = 20\n')
    (tmp_path / "a.py").write_text(text)
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    exercise = result.exercises[0]
    assert exercise.status == "fail"
    fix = "in place of `c = (oc * oc).sum() - radius ** 2` makes everything right"
    for said in ("line 39", fix):
        assert any(said in sentence for sentence in exercise.sentences) == told, exercise.sentences
