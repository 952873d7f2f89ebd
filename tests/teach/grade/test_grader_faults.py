"""Whatever fails in the grader: it costs one student's result or page, which says so and is made again."""

import csv
import re
import sys
import tempfile
import threading

import pytest
import submitted_tracers as tracers
from typer.testing import CliRunner

from raytwin.cli import app
from raytwin.errors import MachineError
from raytwin.show import class_page as pages
from raytwin.show import student_page
from raytwin.teach.grade import class_run
from raytwin.teach.grade import grade_submission as grading
from raytwin.teach.grade.result import Result
from raytwin.teach.grade.rubric import read_rubric
from raytwin.teach.sandbox.sandbox import Answer, Sandbox, probe

RUBRIC = 'title = "t"\n[[exercises]]\nstage = "intersect_sphere"\npoints = 10\n'


@pytest.fixture
def folder(tmp_path):
    """A class of one correct submission and its rubric."""
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "right.py").write_text(tracers.RIGHT)
    (tmp_path / "r.toml").write_text(RUBRIC)
    return tmp_path


def grade(folder):
    return CliRunner().invoke(
        app, ["grade", str(folder / "in"), "-r", str(folder / "r.toml"), "-o", str(folder / "out")]
    )


@pytest.mark.nightly
def test_an_error_of_the_graders_own_costs_one_result_which_is_named_and_graded_again_next_time(folder, monkeypatch):
    errors = {
        "unlucky": ZeroDivisionError("ours"),
        "\x1b[31m": MachineError("a worker", "a process that lives", "none"),
    }
    for name in errors:
        (folder / "in" / f"{name}.py").write_text("")
    own = class_run.grade_submission

    def fails_for_some(job):
        if error := next((e for name, e in errors.items() if name in job.path), None):
            raise error
        return own(job)

    def rows():
        with (folder / "out" / "results.csv").open() as file:
            return {row["student"]: row for row in csv.DictReader(file)}

    monkeypatch.setattr(class_run, "grade_submission", fails_for_some)
    done = grade(folder)
    assert done.exit_code == 1
    assert re.search("failed on.*unlucky", done.output)
    assert "\x1b" not in done.output
    assert len(list((folder / "out" / "students").iterdir())) == 3
    assert rows()["right"]["points"] == "10"
    assert all(rows()[name]["problem"].startswith("the grader's own fault") for name in ("unlucky", "\\x1b[31m"))
    assert "the grader&#39;s own fault" in (folder / "out" / "index.html").read_text()
    monkeypatch.setattr(class_run, "grade_submission", own)
    assert grade(folder).exit_code == 0
    assert "the grader's own fault" not in rows()["unlucky"]["problem"]


def test_a_page_that_cannot_be_made_costs_no_other_page(graded, monkeypatch, tmp_path):
    own, some = student_page._ordered, [graded.results["right"], graded.results["empty"]]

    def fails_for_one(result):
        if result.student == "empty":
            raise RuntimeError("<ours>")
        return own(result)

    monkeypatch.setattr(student_page, "_ordered", fails_for_one)
    assert pages.write_class(some, graded.rubric, tmp_path) == ["empty"]
    correct, failed = ((tmp_path / "students" / pages.page_name(result)).read_text() for result in some)
    assert "RuntimeError: &lt;ours&gt;" in failed
    assert "✓ image" in correct


def test_a_rubrics_fault_ends_the_run_before_anyone_is_graded(folder):
    text = RUBRIC + '[[exercises]]\nstage = "render"\nscenes = ["no-such-scene"]\npoints = 1\n'
    (folder / "r.toml").write_text(text)
    assert grade(folder).exit_code != 0
    assert not (folder / "out" / "results").exists()


def test_a_result_without_exercises_has_a_page_and_a_row(folder):
    result = Result("a", "k", "", (), problem="the grader's own fault: x", grader_fault=True)
    assert pages.write_class([result], read_rubric(folder / "r.toml"), folder / "out") == []
    assert "✗" in (folder / "out" / "students" / pages.page_name(result)).read_text()


# ------------------------------------------------------------------------------------------ one limit of processes


@pytest.fixture
def shared(tmp_path, monkeypatch):
    """Submissions of an ordinary user: the system counts the threads of all of them together."""
    probe()
    monkeypatch.setattr(grading, "share_a_limit", lambda: True)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_NPROC counts threads on Linux alone")
def test_who_is_alone_waits_for_the_others_and_they_for_it(shared):
    order: list[str] = []

    def alone():
        with grading.turn(alone=True):
            order.append("alone")

    with grading.turn(), grading.turn():  # beside each other
        waiting = threading.Thread(target=alone)
        waiting.start()
        waiting.join(0.3)
        order.append("others")
    waiting.join()
    assert order == ["others", "alone"]


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_NPROC counts threads on Linux alone")
def test_a_submission_to_which_a_thread_was_refused_is_graded_again_alone(folder, shared, monkeypatch):
    own, turn, taken = Sandbox.call, grading.turn, []

    def call(child, *arguments, **more):
        answer = own(child, *arguments, **more)
        return Answer(problem="RuntimeError: can't start new thread", sort="error") if len(taken) <= 1 else answer

    def counted(alone=False):
        taken.append(alone)
        return turn(alone)

    monkeypatch.setattr(Sandbox, "call", call)
    monkeypatch.setattr(grading, "turn", counted)
    (job,) = class_run.jobs_of(folder / "in", folder / "r.toml")
    result = grading.grade_submission(job)
    assert taken == [False, True]
    assert [e.status for e in result.exercises] == ["pass"]
