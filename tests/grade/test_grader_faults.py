"""Whatever one student hands in, and whatever fails in the grader: each other student has a result and a page."""

import csv
import json
import os

import pytest
import submitted_tracers as tracers
from typer.testing import CliRunner

from raytwin.cli import app
from raytwin.errors import MachineError
from raytwin.grade.class_run import jobs_of, run
from raytwin.grade.result import Result
from raytwin.parallel import Workers
from raytwin.report import class_page as pages

RUBRIC = 'title = "t"\n[limits]\nfolder_mb = 3\n[[exercises]]\nstage = "intersect_sphere"\npoints = 10\n'
RIGHT = tracers.RIGHT


@pytest.fixture
def folder(tmp_path):
    """A class of one right submission; a test adds another."""
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "right.py").write_text(RIGHT)
    (tmp_path / "r.toml").write_text(RUBRIC)
    return tmp_path


def graded(folder):
    """(exit code, what was printed, rows of the CSV by student, names of pages)"""
    done = CliRunner().invoke(
        app, ["grade", str(folder / "in"), "-r", str(folder / "r.toml"), "-o", str(folder / "out")]
    )
    if not (folder / "out" / "results.csv").is_file():
        raise AssertionError(done.output)
    with (folder / "out" / "results.csv").open() as file:
        rows = {row["student"]: row for row in csv.DictReader(file)}
    return done.exit_code, done.output, rows, sorted(p.name for p in (folder / "out" / "students").iterdir())


def too_many(path):
    path.mkdir()
    for i in range(10_001):
        (path / f"{i}.txt").touch()
    (path / "tracer.py").write_text(RIGHT)


def not_utf8(path):
    with open(os.fsencode(path.parent) + b"/caf\xe9.py", "w") as file:  # noqa: PTH123 - a name that no str has
        file.write(RIGHT)


HANDED_IN = {
    "nested": (lambda p: p.with_suffix(".ipynb").write_text("[" * 200_000), "RecursionError"),
    "caf\\udce9": (not_utf8, ""),
    "ansi\\x1b[31m": (lambda p: p.with_name("ansi\x1b[31m.py").write_text(RIGHT), ""),
    "large": (lambda p: p.with_suffix(".py").write_bytes(b"#" * 3_100_000), "at most 3 MB"),
    "cells": (lambda p: p.with_suffix(".ipynb").write_text('{"cells": 5}'), "a notebook"),
    "surrogate": (
        lambda p: p.with_suffix(".ipynb").write_text(
            json.dumps({"cells": [{"cell_type": "code", "source": '"\ud800"\n' + RIGHT}]})
        ),
        None,
    ),
    "many": (too_many, "10 000 files"),
    "commented": (lambda p: p.with_suffix(".py").write_text(RIGHT + "#" + "x" * 1_100_000), ""),
    "notebook of a hundred cells": (
        lambda p: p.with_suffix(".ipynb").write_text(
            json.dumps({"cells": [{"cell_type": "code", "source": s} for s in (RIGHT, *["x = 1"] * 100)]})
        ),
        "",
    ),
}


def test_files_that_are_no_submission_cost_their_own_students_alone_and_are_named(folder):
    for name, (make, _) in HANDED_IN.items():
        make(folder / "in" / name)
    code, printed, rows, names = graded(folder)
    assert code == 0, printed
    assert set(rows) == {"right", *HANDED_IN}
    assert rows["right"]["points"] == "10"
    assert len(names) == len(rows)
    for name, (_, said) in HANDED_IN.items():
        if said is not None:
            assert said in rows[name]["problem"]
            assert (name, rows[name]["points"]) == (name, "0" if said else "10")
    assert "\x1b" not in printed


@pytest.mark.parametrize("error", [ZeroDivisionError("ours"), MachineError("a worker", "a process that lives", "none")])
def test_an_error_of_the_graders_own_costs_one_result_which_is_named_and_graded_again_next_time(
    folder, monkeypatch, error
):
    from raytwin.grade import class_run

    (folder / "in" / "unlucky.py").write_text(RIGHT)
    own = class_run.grade_submission

    def fails_for_one(job):
        if job.student == "unlucky":
            raise error
        return own(job)

    monkeypatch.setattr(class_run, "grade_submission", fails_for_one)
    code, printed, rows, names = graded(folder)
    assert code == 1
    assert "failed on unlucky" in printed
    assert rows["unlucky"]["problem"].startswith("the grader's own fault")
    assert rows["right"]["points"] == "10"
    assert len(names) == 2
    page = (folder / "out" / "index.html").read_text()
    assert "the grader&#39;s own fault" in page
    monkeypatch.setattr(class_run, "grade_submission", own)
    assert graded(folder)[0] == 0
    assert graded(folder)[2]["unlucky"]["points"] == "10"


def test_a_page_that_cannot_be_made_costs_no_other_page(folder, monkeypatch):
    (folder / "in" / "unlucky.py").write_text(RIGHT + "# another")
    names = iter(["right", "unlucky"])
    own = pages._ordered

    def fails_second(result):
        if next(names) == "unlucky":
            raise RuntimeError("<ours>")
        return own(result)

    monkeypatch.setattr(pages, "_ordered", fails_second)
    code, printed, rows, made = graded(folder)
    assert (code, set(rows), len(made)) == (1, {"right", "unlucky"}, 2)
    assert "failed on unlucky" in printed
    assert "RuntimeError: &lt;ours&gt;" in (folder / "out" / "students" / made[1]).read_text()


def test_a_rubrics_fault_ends_the_run_before_anyone_is_graded(folder):
    text = RUBRIC + '[[exercises]]\nstage = "render"\nscenes = ["no-such-scene"]\npoints = 1\n'
    (folder / "r.toml").write_text(text)
    done = CliRunner().invoke(app, ["grade", str(folder / "in"), "-r", str(folder / "r.toml"), "-o", str(folder / "o")])
    assert done.exit_code != 0
    assert not (folder / "o" / "results").exists()


def test_a_picture_of_two_arrays_is_none_whatever_format_the_second_claims(tmp_path):
    """The first bytes of an 8-bit PNG beside a picture would grant half a step of 8 bits to each value."""
    (tmp_path / "r.toml").write_text('title = "t"\n[[exercises]]\nstage = "render"\ndrawn = 1\npoints = 1\n')
    header = "np.frombuffer(b'\\x89PNG\\r\\n\\x1a\\n' + bytes(18), np.uint8)"
    (tmp_path / "a.py").write_text(
        f"import numpy as np\ndef render(s): return np.zeros((s['height'], s['width'], 3)), {header}\n"
    )
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    assert result.exercises[0].sentences[0] == "it returned 2 arrays, where one is wanted"


@pytest.mark.parametrize(
    ("returned", "said"),
    [("()", "it returned 0 arrays"), ("t[:, None]", "where ("), ("t[:5]", "where (")],
)
def test_a_part_of_another_shape_is_refused_in_words_and_never_broadcast_in_the_grader(tmp_path, returned, said):
    (tmp_path / "r.toml").write_text('title = "t"\n[[exercises]]\nstage = "render"\ndrawn = 1\npoints = 1\n')
    text = tracers.RIGHT.replace("def render", "def own")
    wrong = "\nright = intersect_sphere\ndef intersect_sphere(o, d, c, r):\n    t = right(o, d, c, r)\n"
    (tmp_path / "a.py").write_text(f"{text}{wrong}    return {returned}\n")
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    assert not result.problem
    assert said in result.exercises[0].sentences[0], result.exercises[0].sentences


def test_a_result_without_exercises_has_a_page_and_a_row(tmp_path):
    from raytwin.grade.rubric import read_rubric

    (tmp_path / "r.toml").write_text(RUBRIC)
    result = Result("a", "k", "", (), problem="the grader's own fault: x", grader_fault=True)
    assert pages.write_class([result], read_rubric(tmp_path / "r.toml"), tmp_path / "out") == []
    assert "✗" in (tmp_path / "out" / "students" / pages.page_name(result)).read_text()
