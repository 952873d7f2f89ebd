"""A rubric: what it says in TOML, what it earns, and what is wrong with it in one line."""

import os
import re

import pytest
from typer.testing import CliRunner

from raytwin.cli import app
from raytwin.errors import InputError
from raytwin.teach.contract.stage_table import CONTRACT, LESSONS
from raytwin.teach.grade.class_run import jobs_of
from raytwin.teach.grade.rubric import READY, Exercise, read_rubric
from raytwin.teach.grade.submission_code import code_of

GOOD = """
title = "t"
[[exercises]]
stage = "intersect_sphere"
points = 10
[[exercises]]
stage = "render"
scenes = ["single"]
drawn = 2
rung = "lambert"
points = 20
visibility = "hidden"
credit = [[1e-4, 0.8], [1e-2, 0.4]]
"""


@pytest.fixture
def read(tmp_path):
    def of(text: str):
        (tmp_path / "r.toml").write_text(text)
        return read_rubric(tmp_path / "r.toml")

    return of


def test_a_rubric_is_read_with_names_that_tell_its_rows(read):
    rubric = read(GOOD)
    assert [e.name for e in rubric.exercises] == ["intersect_sphere", "render (lambert: single, 2 drawn)"]
    assert (rubric.points, rubric.stages) == (30, ("intersect_sphere", "render"))


def test_what_is_wrong_with_a_rubric_is_said_with_its_field(read):
    for old, new, said in (
        ('"intersect_sphere"', '"intersect_spere"', "did you mean intersect_sphere?"),
        ('"lambert"', '"path"', "for render of named scenes sky or path"),
        ('"lambert"', '"surface"', "for render of named scenes sky or path"),
        ("points = 10", "points = -1", "exercises[0].points"),
        ("points = 10", "points = 10\ndrawn = 1", "has cases of its own"),
        ("[[1e-4, 0.8], [1e-2, 0.4]]", "[[1e-2, 0.8], [1e-4, 0.4]]", "rows by rising error"),
        ("points = 10", 'points = 10\nname = "render (lambert: single, 2 drawn)"', "names that differ"),
        ('title = "t"', 'title = "t"\nfolder = "x"', "r.toml: folder is no known key."),
        ("points = 10", "points = 10\ninside = true", "r.toml: inside was removed in 0.2.0. Leave the exercise out"),
        ("points = 10", "point = 10", "exercises[0].point is no known key. Did you mean points?"),
        ('title = "t"', 'title = "t"\n[speed]\nof = "image"', "r.toml: speed was removed in 0.2.0. Leave it out"),
    ):
        with pytest.raises(InputError, match=re.escape(said)):
            read(GOOD.replace(old, new))


def test_partial_credit_falls_with_the_logarithm_of_the_error():
    row = Exercise("shade", 10, credit=((1e-6, 0.9), (1e-4, 0.5), (1e-2, 0.1)))
    earned = [row.share(False, e) for e in (1e-9, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.011, None, float("nan"))]
    assert earned == pytest.approx([0.9, 0.9, 0.7, 0.5, 0.3, 0.1, 0, 0, 0])
    assert row.share(True, 1.0) == 1.0
    assert Exercise("shade", 10).share(False, 1e-9) == 0.0


def test_a_seed_belongs_to_the_submission_and_the_rubric(read):
    one, other = read(GOOD), read("seed = 1\n" + GOOD)
    assert one.seed_of(b"a") == one.seed_of(b"a") not in (one.seed_of(b"b"), other.seed_of(b"a"))


def test_a_walks_lessons_are_stages_too_and_the_starter_has_those_that_are_asked_for(read, tmp_path):
    lessons = [name for name in LESSONS if name not in CONTRACT]
    rows = "".join(f'[[exercises]]\nstage = "{name}"\npoints = 1\n' for name in lessons)
    assert read('title = "t"\n' + rows).stages == tuple(lessons)
    words = ["--stage", f"{lessons[0]}, {lessons[1]}", "--stage", lessons[2]]
    CliRunner().invoke(app, ["grade", "starter", "-o", str(tmp_path / "mine.py"), *words])
    written = (tmp_path / "mine.py").read_text()
    assert re.findall(r"^def (\w+)", written, re.MULTILINE)[1:] == lessons[:3]  # the first is the example
    assert "scene[" not in written


def test_the_ready_rubric_has_every_stage_and_the_starter_writes_it_over_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    assert "change it" in run(app, ["grade", "starter", "--rubric"]).output
    ready = read_rubric(READY)
    assert read_rubric(tmp_path / "rubric.toml").exercises == ready.exercises
    assert (set(ready.stages), ready.points) == (set(CONTRACT), 100)
    assert isinstance(run(app, ["grade", "starter", "--rubric"]).exception, InputError)


def test_a_scene_that_render_cannot_be_called_with_is_refused_before_anybody_is_graded(tmp_path):
    (tmp_path / "a.py").touch()
    for name in ("studio", "gloss"):
        (tmp_path / "r.toml").write_text(GOOD.replace("single", f'overlap", "{name}'))
        with pytest.raises(InputError, match=rf"r\.toml: exercises\[1\]\.scenes: scene {name}"):
            jobs_of(tmp_path / "a.py", tmp_path / "r.toml")


def test_a_pipe_handed_in_is_refused_and_not_waited_for(read, tmp_path):
    os.mkfifo(tmp_path / "bob.py")
    with pytest.raises(InputError, match=r"bob.py: expected a Python file.*a device or a pipe"):
        code_of(tmp_path / "bob.py", read(GOOD))
