"""Submissions of an ordinary user share one limit of processes: none fails because of another."""

import os
import subprocess
import sys
import tempfile
import threading
from contextlib import ExitStack

import pytest
import submitted_tracers as tracers

from raytwin.teach.grade import grade_submission as grading
from raytwin.teach.grade.class_run import jobs_of
from raytwin.teach.sandbox import turns
from raytwin.teach.sandbox.sandbox import Answer, Code, Limits, Sandbox, probe
from raytwin.teach.sandbox.turns import turn

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_NPROC counts threads on Linux alone"),
]

THREADS = """
import threading, time
def f():
    for _ in range(8): threading.Thread(target=time.sleep, args=(600,), daemon=True).start()
    return 1.0
"""
RUBRIC = 'title = "t"\n[[exercises]]\nstage = "intersect_sphere"\npoints = 10\n'


def neighbours_that_start_threads() -> list[str]:
    """What each of four submissions says that were begun before any of them starts 8 of the 12 threads it may have."""
    with ExitStack() as stack:
        limits = Limits(processes=12)
        children = [stack.enter_context(Sandbox(Code(source=THREADS, asked=("f",)), limits)) for _ in range(4)]
        return [child.call("f").problem for child in children]


def test_neighbours_of_an_ordinary_user_do_not_take_each_others_threads():
    if os.getuid() != 0:
        assert neighbours_that_start_threads() == [""] * 4
        return
    program = "import test_turns; print(test_turns.neighbours_that_start_threads())"
    environment = {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "TMPDIR": "/tmp", "HOME": "/tmp"}
    try:
        done = subprocess.run(
            [sys.executable, "-B", "-c", program], cwd="/tmp", env=environment, user=65533, group=65533,
            extra_groups=(), capture_output=True, text=True,
        )  # fmt: skip
    except PermissionError:
        pytest.skip("this machine lacks locks: an ordinary user cannot read Python")
    assert done.stdout.strip() == str([""] * 4), done.stderr


def test_who_is_alone_waits_for_the_others_and_they_for_it(monkeypatch, tmp_path):
    monkeypatch.setattr(turns, "share_a_limit", lambda: True)
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
    (tmp_path / f"raytwin-turns-{os.getuid()}").unlink()
    (tmp_path / f"raytwin-turns-{os.getuid()}").symlink_to(tmp_path / "elsewhere")
    with turn(), turn(alone=True):  # no file of ours: no turns
        assert not (tmp_path / "elsewhere").exists()


def test_a_submission_to_which_a_thread_was_refused_is_graded_again_alone(tmp_path, monkeypatch):
    (tmp_path / "r.toml").write_text(RUBRIC)
    (tmp_path / "right.py").write_text(tracers.RIGHT)
    probe()
    monkeypatch.setattr(turns, "share_a_limit", lambda: True)
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
