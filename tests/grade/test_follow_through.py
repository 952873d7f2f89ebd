"""A picture that a failed function spoils keeps its points, and nothing is given for nothing."""

import pytest
import submitted_tracers as tracers

from raytwin import files
from raytwin.grade.class_run import jobs_of, run
from raytwin.grade.follow_through import source_of
from raytwin.parallel import Workers

RUBRIC = """
title = "t"
hints = 0
follow_through = {rate}
[[exercises]]
stage = "shade"
points = 10
[[exercises]]
stage = "intersect_sphere"
points = 10
[[exercises]]
stage = "back_project"
points = 10
[[exercises]]
stage = "render"
drawn = 1
points = 30
"""
PI = tracers.tracer("pi")
PARTS = tracers.RIGHT.replace("def render", "def own")
"""A tracer without a function for the whole."""
HELPED = "from helper import *\nimport helper\n\n\ndef render(scene):\n    return helper.render(scene)\n"
NOTHING = "\n".join(
    f"def {f}:\n    return 0 * {of}\n"
    for f, of in (
        ("back_project(K, dist, width, height)", "__import__('numpy').ones((height, width, 3))"),
        ("intersect_sphere(origins, directions, center, radius)", "origins[:, 0]"),
        ("shade(points, normals, albedo, to_light, irradiance, sky)", "points"),
    )
)


@pytest.mark.parametrize(
    ("rate", "students"),
    [
        (0.0, {"pi": (PI, "", 0)}),
        (0.5, {"pi": (PI, "", 15)}),
        (
            1.0,
            {
                "helped": (HELPED, PI, 30),  # the wrong function lies in another module
                "parts": (PARTS.replace("albedo / np.pi *", "albedo *"), "", 20),  # two of three functions are theirs
                "nothing": (NOTHING, "", 0),
                "beside": (PI.replace("return out.reshape", "return 1.1 * out.reshape"), "", 0),  # the picture's own
                "own": (tracers.RIGHT.replace("def shade", "def lambert").replace(" shade(", " lambert("), "", 30),
            },
        ),
    ],
)
def test_what_is_right_once_the_failed_function_is_replaced_keeps_its_share(tmp_path, rate, students):
    (tmp_path / "r.toml").write_text(RUBRIC.format(rate=rate))
    for name, (text, helper, _) in students.items():
        files.write_text(tmp_path / "in" / name / "tracer.py", text)
        if helper:
            files.write_text(tmp_path / "in" / name / "helper.py", helper)
    results = run(jobs_of(tmp_path / "in", tmp_path / "r.toml"), tmp_path / "out", Workers())
    assert {r.student: r.exercises[-1].points for r in results} == {name: s[2] for name, s in students.items()}


def test_the_sandbox_is_given_no_function_that_was_not_replaced():
    text = source_of(["shade", "intersect_sphere"])
    assert "def shade" in text
    assert "def render" not in text
    assert "def back_project" not in text
    made: dict = {}
    exec(source_of(["back_project"]), made)
    assert callable(made["undistort"])


def test_beside_a_failed_function_the_second_mistake_is_named_alone(tmp_path):
    (tmp_path / "r.toml").write_text(RUBRIC.format(rate=0.0).replace("drawn = 1", "drawn = 2"))
    (tmp_path / "a.py").write_text(PI.replace("return out.reshape", "return out[:, ::-1].reshape"))
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    picture = result.exercises[-1]
    assert picture.causes == ("bgr",)
    assert picture.sureness == "proved"
    assert picture.sentences[0].startswith("with a right shade in place of yours one mistake is left: ")
