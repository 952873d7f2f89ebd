"""A subject of Python runs in a process of its own: whatever it does to that process, raytwin says what happened."""

import os
import shlex
import sys
import time

import numpy as np
import pytest
from program import raytwin

from raytwin.errors import InputError, SubjectEnded
from raytwin.teach.contract.subject import find_subject
from raytwin.teach.contract.subject_process import SubjectProcess

TRACER = """
import os
import numpy as np

def back_project(K, dist, width, height):
    raise IndexError("too far")

def render(scene{also}):
    {body}
    return np.full((scene["height"], scene["width"], 3), 0.5)
"""


def subject(folder, body, also=", seed=0, samples=1"):
    file = folder / "mine.py"
    file.write_text(TRACER.format(body=body, also=also))
    return str(file)


@pytest.mark.nightly
def test_a_subject_that_ends_the_process_fails_the_comparison(scenes, tmp_path):
    for body, how in (
        ("os.kill(os.getpid(), 11)", "signal SIGSEGV"),
        ("os.fork() or __import__('time').sleep(60); os._exit(0)", "exit code 0"),
    ):
        asked = "--size", "24x18", "--subject", subject(tmp_path, body), "-o", tmp_path / "out"
        run = raytwin("compare", scenes / "single", *asked, cwd=tmp_path)
        assert (run.returncode, run.stdout) == (1, ""), body
        assert f"ended with {how} before it gave one" in run.stderr
        assert not (tmp_path / "out").exists()


@pytest.mark.nightly
def test_the_folder_the_output_and_what_is_left_behind_are_the_subjects_own(scenes, tmp_path):
    body = "os.chdir('/'); print('Comparison(pass)', flush=True); os.fork() or __import__('time').sleep(60)"
    asked = "--size", "24x18", "--subject", subject(tmp_path, body, ""), "-o", "here"
    began = time.monotonic()
    assert raytwin("compare", scenes / "single", *asked, cwd=tmp_path).returncode == 1
    assert (tmp_path / "here" / "report.html").is_file()
    assert time.monotonic() - began < 50  # not until the child that was left behind ends


@pytest.mark.nightly
def test_a_program_that_leaves_a_process_behind_has_ended_when_it_has(tmp_path, single):
    (tmp_path / "mine.py").write_text(
        "import os, sys, time, numpy as np\nfrom raytwin import Image, write_image\n"
        "write_image(sys.argv[1], Image(np.full((480, 640, 3), 0.5, np.float32)))\n"
        "os.fork() or time.sleep(60)\n"
    )
    began = time.monotonic()
    made = find_subject(f"{shlex.quote(sys.executable)} {tmp_path / 'mine.py'} {{out}}", "shadow")(single, 0)
    assert made.shape == (480, 640, 3)
    assert time.monotonic() - began < 50


def test_a_program_whose_command_has_no_seed_is_called_once(tmp_path):
    found = find_subject("./mine {scene} {out}", "shadow")
    assert (found.noisy, found.renders, found.samples) == (False, 1, 0)
    assert find_subject("./mine {scene} {out} {seed}", "shadow").noisy


@pytest.mark.nightly
def test_a_process_that_ended_is_started_again_at_the_next_call_and_none_is_left(tmp_path):
    process = SubjectProcess(subject(tmp_path, "os._exit(0) if seed else None"))
    scene = {"height": 2, "width": 3}
    for _ in range(2):
        assert process.call("render", (scene,), {}).shape == (2, 3, 3)
        pid = process._process.pid
        with pytest.raises(SubjectEnded, match="ended with exit code 0"):
            process.call("render", (scene,), {"seed": 1})
    process.describe()
    process.close()
    with pytest.raises(ProcessLookupError):
        os.killpg(pid, 0)
    (tmp_path / "mine.py").write_text("import os\nos._exit(0)\n")
    with pytest.raises(SubjectEnded, match="ended with exit code 0"):
        find_subject(str(tmp_path / "mine.py"), "shadow")


def test_what_a_function_raises_takes_and_is_called_is_as_if_it_were_here(tmp_path, single):
    found = find_subject(subject(tmp_path, "1 / seed"), "shadow")
    assert found.noisy
    assert found.samples
    assert list(found.stages) == ["back_project"]
    with pytest.raises(Exception, match="too far") as raised:
        found.stages["back_project"](np.eye(3), np.zeros(5), 4, 3)
    assert type(raised.value).__name__ == "IndexError"
    with pytest.raises(InputError, match=r"an image .*got ZeroDivisionError"):
        found(single, 0)
