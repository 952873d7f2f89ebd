"""A submission that is graded gets the line to look at, in its sandbox, as far as the rubric's hints go."""

import pytest
from starter_submissions import SLIPS

from raytwin.grade.class_run import jobs_of, run
from raytwin.parallel import Workers

RUBRIC = 'title = "t"\nhints = {hints}\n[[exercises]]\nstage = "intersect_sphere"\npoints = 20\n'


@pytest.mark.parametrize(
    ("hints", "said"),
    [
        (0, ""),
        (3, "in place of `c = (oc * oc).sum() - radius ** 2` makes everything right"),
    ],
)
def test_the_line_of_a_slip_is_told_as_far_as_the_rubric_allows(tmp_path, hints, said):
    (tmp_path / "r.toml").write_text(RUBRIC.format(hints=hints))
    (tmp_path / "a.py").write_text(next(s.source for s in SLIPS if s.label == "sum of everything"))
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    exercise = result.exercises[0]
    assert any(said in sentence for sentence in exercise.sentences)
    assert any("line 39" in sentence for sentence in exercise.sentences) == bool(hints)


def test_a_submission_that_answers_nonsense_for_its_repairs_is_graded_all_the_same(tmp_path):
    (tmp_path / "r.toml").write_text(RUBRIC.format(hints=2))
    source = next(s.source for s in SLIPS if s.label == "sum of everything")
    liar = "\n\nimport marshal\nmarshal.loads = lambda b: compile('raise SystemExit', '', 'exec')\n"
    (tmp_path / "a.py").write_text(source + liar)
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    assert result.exercises[0].status == "fail"
    assert not any("line" in sentence for sentence in result.exercises[0].sentences)
