"""Each hostile submission gets its right verdict; the grader lives, and the next submission is unharmed."""

import os
import re
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import attacks
import numpy as np
import pytest

from raytwin.teach.sandbox.lock import HOLDS, SUBMISSIONS_AT_ONCE, _without
from raytwin.teach.sandbox.sandbox import Code, Limits, Sandbox, probe

NAMES = re.findall(r"@tried\ndef (\w+)", attacks.ATTACKS)
OTHERS = re.findall(r"^def (\w+)\(\)", attacks.ATTACKS, re.MULTILINE)
SHORT = Limits(
    seconds=20, seconds_a_call=0.35, cpu_seconds=20, memory_mb=200, folder_mb=8, file_mb=4, processes=12, answer_mb=4,
)  # fmt: skip

pytestmark = pytest.mark.skipif(os.name != "posix", reason="tries what POSIX has")


@pytest.fixture(scope="module")
def locks() -> dict[str, str]:
    return probe()


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """What became of every attack of one submission, all of which run in one process; and the grader's own files."""
    folder = tmp_path_factory.mktemp("grader")
    told = {"folder": str(folder), "name": f"raytwin-{os.getpid()}", "backwards": "secret-course"[::-1]}
    for name in ("reference", "rubric", "results", "run_autograder"):
        (folder / f"{name}.json").write_text("secret")
        told[name] = str(folder / f"{name}.json")
    for path in (folder, *folder.iterdir(), *folder.parents[:2]):  # as open as a careless grader's
        with suppress(OSError):
            path.chmod(0o777)
    with socket.create_server(("127.0.0.1", 0)) as tcp, socket.socket(socket.AF_UNIX) as unix:
        told["port"] = tcp.getsockname()[1]
        if hasattr(os, "sched_getaffinity"):
            unix.bind("\0" + told["name"])
            unix.listen()
        limits = Limits(seconds=60, memory_mb=400, answer_mb=4)
        hidden = (tmp_path_factory.mktemp("secret-course"),)
        with Sandbox(Code(source=attacks.ATTACKS, asked=(*NAMES, *OTHERS)), limits, hidden) as child:
            found = {name: child.call(name, told) for name in NAMES} | {n: child.call(n) for n in OTHERS}
            pid = child._process.pid
    return {**found, "folder": folder, "left": left_of(pid), "base": child._base}


def left_of(pid: int) -> int:
    """Processes of the group; those that are killed may need a moment to end."""
    for _ in range(100):
        left = sum(state != "Z" for state in states_of(pid))
        if left == 0:
            break
        time.sleep(0.02)
    return left


def states_of(group: int) -> list[str]:
    """What the system says of each process of a group: R (runs), S (sleeps), Z (is dead), ..."""
    told = subprocess.run(["ps", "-A", "-o", "pgid=,state="], capture_output=True, text=True, check=True).stdout
    return [line.split()[1][0] for line in told.splitlines() if line.split()[0] == str(group)]


def test_no_attack_works(outcome, locks):
    if not {"seccomp", "Landlock"} <= {n for n, held in locks.items() if held == HOLDS}:
        pytest.skip(f"this machine lacks locks: {locks}")
    assert {outcome[name].sort for name in NAMES} <= {"", "error"}
    assert [name for name in NAMES if outcome[name].sort == "" and outcome[name].arrays[0] != 0.0] == []


def test_nothing_of_the_graders_is_changed_and_no_process_and_no_folder_is_left_behind(outcome):
    assert {p.read_text() for p in outcome["folder"].iterdir()} == {"secret"}
    assert not Path(f"/tmp/raytwin-{os.getpid()}").exists()
    assert outcome["leaves_a_child_behind"].problem == outcome["digs_deep"].problem == ""
    assert outcome["left"] == 0
    assert attacks.goes(outcome["base"])


def test_arrays_come_as_they_are_and_what_is_no_array_of_numbers_is_said(outcome):
    np.testing.assert_array_equal(outcome["breaks_numpy"].arrays[0], [np.nan, np.inf])
    assert outcome["returns_another_shape"].arrays[0].shape == (3, 0, 5)
    for name, word in (
        ("returns_a_pickle_bomb", "not numbers"),
        ("returns_objects", "not numbers"),
        ("returns_nothing", "return"),
        ("returns_far_too_much", "more than is taken"),
        ("ends_python", "SystemExit"),
        ("raises_what_cannot_be_printed", "cannot be printed"),
        ("recurses", "RecursionError"),
    ):
        assert outcome[name].sort == "error", name
        assert word in outcome[name].problem


def test_python_stays_readable_in_a_hidden_folder_and_what_is_hidden_in_it_does_not(tmp_path):
    for name in ("course/.venv/lib/numpy", "course/.venv/lib/raytwin/shipped", "course/.venv/bin", "course/reference"):
        (tmp_path / name).mkdir(parents=True)
    course = tmp_path / "course"
    found = dict(_without(str(course / ".venv"), [str(course), str(course / ".venv" / "lib" / "raytwin")]))
    names = {str(Path(path).relative_to(course)): listed for path, listed in found.items()}
    assert names == {".venv": True, ".venv/bin": False, ".venv/lib": True, ".venv/lib/numpy": False}


FIRST = (
    "an endless loop", "a fork bomb", "many files", "os._exit", "a crash", "noise in the grader's pipe",
    "all descriptors closed", "an import that is not there",
)  # fmt: skip
"""One of each kind: the others are nightly."""


@pytest.mark.parametrize(
    "name", [*FIRST, *(pytest.param(n, marks=pytest.mark.nightly) for n in attacks.ENDINGS if n not in FIRST)]
)
def test_an_ending_has_its_reason_and_leaves_nothing(name, capfd):
    ending = attacks.ENDINGS[name]
    limits = Limits(seconds=2) if name == "an endless loop" else SHORT  # of computing: a busy machine takes far longer
    with Sandbox(Code(source=ending.source, asked=("f",)), limits) as child:
        answer = child.call("f")
        if not answer.problem:
            answer = child.call("f")
    assert (answer.sort or "none") in ending.sort.split(), answer
    assert not ending.word or any(word in answer.problem for word in (ending.word, *ending.word.split(" ")[:2])), answer
    assert left_of(child._process.pid) == 0
    assert attacks.goes(child._base)
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="processes of root are not bounded, and macOS has other limits")
def test_no_more_processes_are_started_than_the_limit_says(locks):
    if os.getuid() == 0 and locks["other uid"] != HOLDS:
        pytest.skip(f"this machine lacks locks: {locks['other uid']}")
    source = (
        "import os, time\ndef f():\n"
        " for count in range(500):\n  try: pid = os.fork()\n  except BlockingIOError: return count\n"
        "  if pid == 0:\n   time.sleep(600)\n return 500"
    )
    with Sandbox(Code(source=source, asked=("f",)), SHORT) as child:
        answer = child.call("f")
        alone = locks["other uid"] == HOLDS
        assert 0 < answer.arrays[0] <= SHORT.processes * (1 if alone else SUBMISSIONS_AT_ONCE)
    assert left_of(child._process.pid) == 0


def test_each_process_has_its_memory_and_may_write_small_files():
    source = (
        "import numpy as np\ndef f(): return np.ones(25_000_000)\n"
        "def g():\n with open('x', 'wb') as file: file.write(bytes(5_000_000))"
    )
    with Sandbox(Code(source=source, asked=("f", "g")), SHORT) as child:
        assert child.call("f").problem.startswith("MemoryError")
        assert child.call("g").problem.startswith("OSError: [Errno 27] File too large")


@pytest.mark.nightly
def test_a_call_ends_after_its_own_seconds_of_computing_and_all_after_theirs():
    source = (
        "import time\ndef f(seconds):\n end = time.process_time() + seconds\n while time.process_time() < end: pass"
    )
    source += "\n return 1.0"
    with Sandbox(Code(source=source, asked=("f",)), Limits(seconds_a_call=3)) as child:
        assert not child.call("f", 0.9).problem
        assert child.call("f", 99.0).problem == "not done after 3 s of computing: ended"
    with Sandbox(Code(source=source, asked=("f",)), Limits(seconds=2, seconds_a_call=9)) as child:
        assert child.call("f", 99.0).problem == "not done after 2 s of computing: ended"


@pytest.mark.nightly
@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="Linux alone tells who waits for a core")
def test_waiting_for_a_busy_core_is_not_counted():
    """Two others share the core, so that 0.25 s of computing take about 0.75 s."""
    source = (
        "import time\ndef f():\n end = time.process_time() + 0.25\n while time.process_time() < end: pass\n return 1.0"
    )
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    others = []
    try:
        with Sandbox(Code(source=source, asked=("f",)), Limits(seconds_a_call=0.5)) as child:
            os.sched_setaffinity(0, cores)
            loop = [sys.executable, "-S", "-c", "while True: pass"]
            others += [subprocess.Popen(loop, start_new_session=True) for _ in range(2)]
            for other in others:
                os.sched_setaffinity(other.pid, {min(cores)})
            began = time.monotonic()
            answer = child.call("f")
            elapsed = time.monotonic() - began
    finally:
        os.sched_setaffinity(0, cores)
        for other in others:
            other.kill()
            other.wait()
    assert not answer.problem
    assert 0.2 < answer.seconds < 0.6 * elapsed


def test_the_next_submission_is_unharmed_and_what_it_prints_is_kept():
    source = (
        "import sys\nprint('loaded')\n"
        "def f(a, scene):\n    print('called', file=sys.stderr)\n    return a @ scene['K'], a.T"
    )
    a = np.arange(9.0).reshape(3, 3)
    with Sandbox(Code(source=source, asked=("f", "g"))) as child:
        assert child.functions == ("f",)
        answer = child.call("f", a, {"K": 2 * np.eye(3)})
        assert child.call("g").sort == "missing"
    np.testing.assert_array_equal(answer.arrays[0], 2 * a)
    np.testing.assert_array_equal(answer.arrays[1], a.T)
    assert {"loaded", "called"} <= set(child.printed.split())


LEARNER = """
import raytwin
from raytwin import tracer
import no_such_plots
import numpy as np
get_ipython().run_line_magic("matplotlib", "inline")
def shade(points):
    return np.full(3, len(points))
raytwin.check("shade", shade).show()
tracer.lights.made()
def hit_points(scene): return tracer.render(scene)
"""


def test_a_submission_that_checks_itself_and_imports_what_is_missing_keeps_its_functions():
    for code in ({"source": LEARNER}, {"source": "", "cells": (("cell 1", LEARNER), ("cell 2", "x = unknown"))}):
        with Sandbox(Code(**code, asked=("shade", "hit_points", "render"))) as child:
            assert child.call("shade", np.zeros(2)).arrays[0].tolist() == [2, 2, 2]
            assert "object" in child.call("hit_points", 0).problem  # what stands for raytwin has no answers
            missing = child.call("render", 0)
        assert missing.sort == "missing"
        assert "this failed first" in missing.problem
        assert "No module named 'no_such_plots'" in missing.problem
