"""A wall that is lit from inside its sphere costs the exercise that looks from there, and no other."""

import pytest
from starter_submissions import PLAIN

from raytwin.errors import InputError
from raytwin.parallel import Workers
from raytwin.teach.grade.class_run import jobs_of, run
from raytwin.teach.grade.rubric import read_rubric

RUBRIC = """
title = "t"
hints = 0
follow_through = 1.0
exercises = [
  { stage = "shade", points = 4 },
  { name = "shadows", stage = "render", drawn = 2, points = 8 },
  { name = "inside", stage = "render", drawn = 2, inside = true, points = 2 },
]
"""
LEFT_OUT = PLAIN.replace('s["center"], s["radius"]))\n', 's["center"], s["radius"])) & (skip != k)\n')
GAMMA = "return out.reshape", "out = np.clip(out, 0, 1) ** (1 / 2.2)\n    return out.reshape"
PI = "albedo / np.pi *", "albedo *"


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("text", "points", "cause"),
    [
        (PLAIN, [4, 8, 2], ()),
        (LEFT_OUT.replace("p + 1e-6 * normal[hit]", "p"), [4, 8, 0], ("own-wall",)),
        (PLAIN.replace(*GAMMA), [4, 0, 2], ()),  # one mistake, which the shadows pay for
        (LEFT_OUT.replace(*PI), [0, 8, 0], ()),  # two: the function pays for one
    ],
    ids=["correct", "left out", "gamma", "left out, without pi"],
)
def test_each_mistake_is_paid_for_where_it_shows(tmp_path, text, points, cause):
    (tmp_path / "r.toml").write_text(RUBRIC)
    (tmp_path / "a.py").write_text(text)
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    assert [pytest.approx(e.points, abs=2) for e in result.exercises] == points
    inside = result.exercises[2]
    assert (inside.points, inside.causes) == (points[2], cause)
    assert inside.follows == (points == [4, 0, 2])
    if points == [0, 8, 0]:
        assert inside.sentences == ("Pictures from outside are wrong, too. Start with shadows.",)


def test_only_drawn_pictures_are_seen_from_inside(tmp_path):
    named = RUBRIC.replace("drawn = 2, inside", 'scenes = ["single"], inside')
    (tmp_path / "r.toml").write_text(named)
    with pytest.raises(InputError, match=r"exercises\[2\]\.inside: expected an exercise of render with drawn scenes"):
        read_rubric(tmp_path / "r.toml")
