"""The light install, the wheel without any extra: images are compared with references; what is missing is named."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from installed_wheel import clean_environment
from program import CHAIN, STAGE, check_chain

from raytwin import files
from raytwin.image import Image

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent

BLOCKED = """
import os, sys
sys.modules.update(dict.fromkeys({names}))
for name in {missing}:
    if hasattr(os, name):
        delattr(os, name)

def closed(event, asked):
    if event in ("open", "os.listdir", "os.scandir") and str(asked[0]).startswith({folders}):
        raise FileNotFoundError(2, "No such file or directory", asked[0])

sys.addaudithook(closed)
"""


@pytest.fixture
def run(tmp_path, environment_with):
    """`run(*command)`: python -m ... in tmp_path, with the wheel and `extras`.

    `names`, `missing` and `folders`: modules, names of os and folders that are not there.
    """

    def child(
        *command: str, extras: tuple[str, ...] = (), names: tuple[str, ...] = (), missing: tuple[str, ...] = (),
        folders: tuple[str, ...] = (), code: int = 0,
    ):  # fmt: skip
        environment = clean_environment(tmp_path) | {"RAYTWIN_CACHE": str(tmp_path / "cache")}
        if names:
            (tmp_path / "without").mkdir(exist_ok=True)
            text = BLOCKED.format(names=set(names), missing=missing, folders=folders)
            (tmp_path / "without" / "sitecustomize.py").write_text(text)
            environment["PYTHONPATH"] = str(tmp_path / "without")
        python = environment_with(*extras, also=("pytest",))
        command = (str(python), *(command if command[0] == "-c" else ("-m", *command)))
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)
        assert done.returncode == code, done.stdout + done.stderr
        done.stderr = STAGE.sub("", done.stderr)  # a busy machine's long stages
        return done

    a = np.random.default_rng(1).random((20, 30, 3)).astype(np.float32)
    for name, image in (("a", a), ("b", 1.5 * a)):
        files.write_exr(tmp_path / f"{name}.exr", Image(image))
    (tmp_path / "chain.py").write_text(CHAIN)
    (tmp_path / "spheres.py").write_text("def intersect_sphere(o, d, c, r):\n    return o[:, 0] * 0\n")
    (tmp_path / "rubric.toml").write_text('title = "t"\n[[exercises]]\nstage = "intersect_sphere"\npoints = 1\n')
    (tmp_path / "test_mine.py").write_text(
        "def test_equal(raytwin_reference):\n"
        "    reference = raytwin_reference('single', 'lambert')\n"
        "    reference.check(reference.image.mean)\n"
    )
    return child


def light_journeys(run, **without) -> None:
    steps = (
        ("diff a.exr a.exr --json a.json -o out", 0, "report: out/report.html"),
        ("diff a.exr b.exr --junit b.xml", 1, "FAIL"),
        ("reference show single", 0, "single/lambert"),
        ("scenes", 0, "desk"),
        ("export single --json", 0, '"width": 640'),
        ("grade starter -o tracer.py", 0, "tracer.py"),
        ("grade spheres.py --rubric rubric.toml -o grades", 0, "1 graded; report: grades"),
    )
    check_chain(steps, lambda words: run("chain", words, **without).stdout)
    assert "1 passed" in run("pytest", "-q", "-p", "no:cacheprovider", "test_mine.py", **without).stdout


def test_the_light_install_compares_and_holds_to_references(run, tmp_path):
    light_journeys(run)
    assert json.loads((tmp_path / "a.json").read_text())["verdict"] == "pass"


def test_every_extra_that_a_command_needs_is_named_at_once_in_one_line(run):
    needs = {
        "compare single": "twin,llvm",
        "compare desk": "twin,llvm,photos",
        "ladder single": "twin,llvm",
        "needs single --tolerance 0.1": "twin,llvm",
        "bench single": "twin,llvm",
        "reference check single": "twin,llvm",
        "explore single": "live,twin,llvm",
        "calibrate . --board board.toml": "photos",
        "stability": "photos,twin,llvm",
        "walk --notebook": "notebook",
    }
    told = json.loads(run("chain", json.dumps([command.split() for command in needs])).stdout)
    for (command, extras), (code, line) in zip(needs.items(), told, strict=True):
        assert (code, line.count("\n")) == (2, 1), line
        assert line.startswith(f"raytwin: {command.split()[0]} needs ")
        assert line.endswith(f"is not installed: pip install 'raytwin[{extras}]'\n")


def test_doctor_tells_what_to_install_for_what(run):
    told = run("raytwin", "doctor").stdout
    assert re.search(r"^backend +none: .*pip install 'raytwin\[twin,llvm\]'", told, re.MULTILINE)
    for extra, use in (("twin,llvm", "compare a scene"), ("photos", "calibrate"), ("live", "explore")):
        assert re.search(rf"pip install 'raytwin\[{extra}\]' to use .*{use}", told), told
    assert "sandbox: process group" in told


def test_from_python_too_the_missing_extra_is_named(run):
    calls = {
        "render(raytwin.read_scene('single').scene)": "twin,llvm",
        "compare_scene('single')": "twin,llvm",
        "mitsuba_sensor(raytwin.read_scene('single').scene.camera)": "twin,llvm",
        "needs('single', 0.1)": "twin,llvm",
        "read_board('board.toml')": "photos",
        "calibrate": "photos",
    }
    tries = (f"try: raytwin.{call}\nexcept raytwin.InputError as error: print(error)" for call in calls)
    told = run("-c", "\n".join(("import raytwin", *tries))).stdout.splitlines()
    for extra, line in zip(calls.values(), told, strict=True):
        assert f"pip install 'raytwin[{extra}]'" in line


def test_a_scene_whose_camera_is_given_needs_neither_opencv_nor_a_board(run):
    twin = ("twin", "llvm")
    done = run("raytwin", "compare", "single", "--size", "64x48", extras=twin)
    assert "report: out/single/report.html" in done.stdout
    assert (
        "1 reference, 0 failed"
        in run("raytwin", "reference", "check", "single", "--rung", "lambert", extras=twin).stdout
    )
    assert "report: " in run("raytwin", "ladder", "single", "--size", "32x24", extras=twin).stdout


def test_without_flip_its_metric_is_null_and_the_reason_is_said(run, tmp_path):
    done = run("raytwin", "diff", "a.exr", "a.exr", "--flip", "--json", "a.json")
    assert done.stderr == "raytwin: FLIP is left out, since it is not installed: pip install 'raytwin[flip]'\n"
    found = json.loads((tmp_path / "a.json").read_text())
    assert (found["perceptual"]["flip_mean"], found["metrics"]["flip_hdr"]) == (None, None)


def test_the_wheels_types_hold_where_nothing_but_its_dependencies_is_installed(environment_with, tmp_path):
    """`mypy --strict` finds a user's code sound, and each mistake in it; of jaxtyping nothing is there."""
    python = environment_with(also=("pytest",))
    assert subprocess.run([python, "-c", "import jaxtyping"], capture_output=True).returncode == 1
    check = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", tmp_path / "mypy", "--python-executable", python]
    right, wrong = ROOT / "tests" / "user_code.py", ROOT / "tests" / "user_mistakes.py"
    done = subprocess.run([*check, right, wrong], cwd=tmp_path, capture_output=True, text=True)
    found = {int(line) for line in re.findall(rf"{wrong.name}:(\d+): error", done.stdout)}
    assert found == {i for i, line in enumerate(wrong.read_text().split("\n"), 1) if line.endswith("# wrong")}, (
        done.stdout
    )
    assert right.name not in done.stdout, done.stdout


def test_light_journeys_need_nothing_of_unix(run):
    """What Windows lacks: resource, fcntl, pwd, termios; fork, links, pipes with names; /proc, /sys."""
    unix = ("resource", "fcntl", "pwd", "grp", "termios", "tty", "pty", "syslog")
    missing = ("fork", "forkpty", "symlink", "link", "mkfifo", "chown", "O_NOFOLLOW")
    light_journeys(run, names=unix, missing=missing, folders=("/proc", "/sys"))
