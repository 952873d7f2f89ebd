"""Samplers in a rubric, and pictures at sampled light levels: by the sequential verdict, until it is certain."""

import numpy as np

from raytwin.images.image import Image
from raytwin.parallel import Workers
from raytwin.show.student_page import student_page
from raytwin.teach.grade.class_run import jobs_of, run
from raytwin.teach.grade.rubric import read_rubric
from raytwin.teach.grade.sandboxed_calls import MAX_RENDERS, SAME_NUMBERS, render_until_certain
from raytwin.teach.sandbox.sandbox import Answer

PICTURE = '{ stage = "render", scenes = ["wedge"], rung = "RUNG", points = 10, credit = [[1e-3, 0.9], [1e-1, 0.4]] }'
PATH = PICTURE.replace("RUNG", "path")
SAMPLER = '{ stage = "sample_cosine", points = 5 }'

SAMPLING = """
import numpy as np


def sample_cosine(u):
    a, b = u.T
    z, r = np.sqrt(1 - a), np.sqrt(a)
    directions = np.stack([r * np.cos(2 * np.pi * b), r * np.sin(2 * np.pi * b), z], axis=-1)
    return directions, z / np.pi, np.ones(len(u))


def render(scene):
    height, width = scene["height"], scene["width"]
    light, weight = np.zeros(height * width), np.ones(height * width)
    for surface in range(7 if scene["rung"] == "path" else 1):
        directions, _, more = sample_cosine(np.random.uniform(size=(height * width, 2)))
        weight = weight * more * 0.5
        sky = directions[:, 0] < 0
        light += np.where(sky, weight, 0)
        weight = np.where(sky, 0, weight)
    return np.repeat(light.reshape(height, width, 1), 3, axis=2)
"""
"""The wedge's walk of light, whose other half is where the directions' x is positive."""


def graded(folder, text, *exercises):
    (folder / "r.toml").write_text(f'title = "t"\nhints = 0\nfollow_through = 1\nexercises = [{", ".join(exercises)}]')
    (folder / "a.py").write_text(text)
    (result,) = run(jobs_of(folder / "a.py", folder / "r.toml"), folder / "out", Workers(), again=True)
    return result


def test_a_correct_path_tracer_has_all_points_and_one_that_drops_a_bounce_has_fewer(tmp_path):
    """False alarms: one in 100 000 of each correct picture. The sandbox's seed is the submission's own."""
    for rung in ("sky", "path"):
        found = graded(tmp_path, SAMPLING, PICTURE.replace("RUNG", rung)).exercises[0]
        assert (found.status, found.points) == ("pass", 10), found.sentences
    found = graded(tmp_path, SAMPLING.replace("range(7 if", "range(2 if"), PATH).exercises[0]
    assert (found.status, found.parts[0].passed) == ("fail", False)
    assert found.points == 0  # 5/16 for 1/3: 6 %, for which a picture without noise has credit
    assert "too dark" in found.sentences[0]
    assert found.causes == ()


def test_a_fixed_seed_is_undecided_and_a_crash_is_what_it_is(tmp_path):
    fixed = graded(tmp_path, SAMPLING.replace("    height,", "    np.random.seed(1)\n    height,"), PATH).exercises[0]
    assert (fixed.status, fixed.points) == ("fail", 0)
    assert fixed.sentences[0] == f"undecided: {SAME_NUMBERS}"
    crashed = graded(tmp_path, SAMPLING.replace("    height,", "    undefined\n    height,"), PATH).exercises[0]
    assert crashed.status == "error"
    assert "NameError" in crashed.sentences[0]


def test_calls_end_when_the_verdict_is_certain_and_at_the_latest_after_a_stated_number():
    rng = np.random.default_rng(1)
    reference = Image(np.full((24, 32, 3), 0.5, np.float32))

    def calls(picture):
        made = []

        def call():
            made.append(picture())
            return Answer((made[-1],), 0.1)

        answer, verdict = render_until_certain(call, reference)
        return len(made), answer, verdict

    count, answer, verdict = calls(lambda: rng.normal(0.5, 0.05, (24, 32, 3)))
    assert (verdict.verdict, round(answer.seconds, 6)) == ("pass", round(0.1 * count, 6))
    assert 8 <= count < MAX_RENDERS
    assert abs(answer.arrays[0].mean() - 0.5) < 0.005
    count, _, verdict = calls(lambda: rng.normal(0.6, 0.05, (24, 32, 3)))
    assert (count, verdict.verdict) == (4, "fail")
    count, _, verdict = calls(lambda: rng.normal(0.5, 40.0, (24, 32, 3)))
    assert (count, verdict.verdict) == (MAX_RENDERS, "undecided")
    assert calls(lambda: np.zeros((2, 2, 3)))[2] is None


def test_a_wrong_sampler_costs_its_own_points_and_no_picture(tmp_path):
    """The submission's own samplers are replaced before a sampled picture is judged again."""
    wrong = SAMPLING.replace("np.ones(len(u))", "np.full(len(u), 0.5)")
    for text, points in ((SAMPLING, [5, 10]), (wrong, [0, 10])):
        result = graded(tmp_path, text, SAMPLER, PATH)
        assert [e.points for e in result.exercises] == points, [e.said for e in result.exercises]
        page = student_page(result, read_rubric(tmp_path / "r.toml"))
        assert "judged by a chi-square test" in page
        assert ("judged by the sequential verdict" in page) == result.exercises[1].parts[0].passed
        assert "allowed" not in page
    assert result.exercises[1].because == ("sample_cosine",)
