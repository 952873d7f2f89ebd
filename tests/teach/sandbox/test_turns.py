"""Submissions of an ordinary user share one limit of processes: none fails because of another."""

import sys
import tempfile
import threading

import pytest
import submitted_tracers as tracers

from raytwin.teach.grade import grade_submission as grading
from raytwin.teach.grade.class_run import jobs_of
from raytwin.teach.grade.grade_submission import turn
from raytwin.teach.sandbox.sandbox import Answer, Sandbox, probe

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_NPROC counts threads on Linux alone"),
]

RUBRIC = 'title = "t"\n[[exercises]]\nstage = "intersect_sphere"\npoints = 10\n'


def test_who_is_alone_waits_for_the_others_and_they_for_it(monkeypatch, tmp_path):
    monkeypatch.setattr(grading, "share_a_limit", lambda: True)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    order: list[str] = []

    def alone():
        with turn(alone=True):
            order.append("alone")

    with turn(), turn():  # beside each other
        waiting = threading.Thread(target=alone)
        waiting.start()
        waiting.join(0.3)
        order.append("others")
    waiting.join()
    assert order == ["others", "alone"]


def test_a_submission_to_which_a_thread_was_refused_is_graded_again_alone(tmp_path, monkeypatch):
    (tmp_path / "r.toml").write_text(RUBRIC)
    (tmp_path / "right.py").write_text(tracers.RIGHT)
    probe()
    monkeypatch.setattr(grading, "share_a_limit", lambda: True)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    own, taken = Sandbox.call, []

    def call(child, *arguments):
        answer = own(child, *arguments)
        return Answer(problem="RuntimeError: can't start new thread", sort="error") if len(taken) <= 1 else answer

    def counted(alone=False):
        taken.append(alone)
        return turn(alone)

    monkeypatch.setattr(Sandbox, "call", call)
    monkeypatch.setattr(grading, "turn", counted)
    (job,) = jobs_of(tmp_path / "right.py", tmp_path / "r.toml")
    result = grading.grade_submission(job)
    assert taken == [False, True]
    assert [e.status for e in result.exercises] == ["pass"]
