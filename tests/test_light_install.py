"""The light install: without Mitsuba, OpenCV, the detector, charts and FLIP, images are still held to references."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from program import CHAIN, check_chain

from raytwin import files
from raytwin.image import Image

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
EXTRAS = ("mitsuba", "drjit", "cv2", "pupil_apriltags", "reportlab", "flip_evaluator")


@pytest.fixture
def run(tmp_path, request):
    """`run(*command)`: python -m ..., where some modules, names of os and folders are not there; in tmp_path."""

    def child(
        *command: str, names: tuple[str, ...] = EXTRAS, missing: tuple[str, ...] = (), folders: tuple[str, ...] = (),
        code: int = 0,
    ):  # fmt: skip
        (tmp_path / "without").mkdir(exist_ok=True)
        text = BLOCKED.format(names=set(names), missing=missing, folders=folders)
        (tmp_path / "without" / "sitecustomize.py").write_text(text)
        path = os.pathsep.join([str(tmp_path / "without"), str(Path(files.__file__).parents[2])])
        environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")} | {"PYTHONPATH": path}
        done = subprocess.run(
            [sys.executable, "-m", *command], cwd=tmp_path, capture_output=True, text=True, env=environment
        )
        assert done.returncode == code, done.stdout + done.stderr
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


def test_what_the_light_install_lacks_is_named_in_one_line(run):
    for command, lacking in (
        (("compare", "single"), "photos"),
        (("doctor",), "twin"),
    ):
        done = run("raytwin", *command, code=2)
        assert done.stderr.count("\n") == 1
        assert f"pip install 'raytwin[{lacking}]'" in done.stderr


def test_without_flip_its_metric_is_null_and_the_reason_is_said(run, tmp_path):
    done = run("raytwin", "diff", "a.exr", "a.exr", "--flip", "--json", "a.json")
    assert done.stderr == "raytwin: FLIP is left out, since it is not installed: pip install 'raytwin[flip]'\n"
    found = json.loads((tmp_path / "a.json").read_text())
    assert (found["perceptual"]["flip_mean"], found["metrics"]["flip_hdr"]) == (None, None)


def test_light_journeys_need_nothing_of_unix(run):
    """What Windows lacks: resource, fcntl, pwd, termios; fork, links, pipes with names; /proc, /sys."""
    unix = ("resource", "fcntl", "pwd", "grp", "termios", "tty", "pty", "syslog")
    missing = ("fork", "forkpty", "symlink", "link", "mkfifo", "chown", "O_NOFOLLOW")
    light_journeys(run, names=(*EXTRAS, *unix), missing=missing, folders=("/proc", "/sys"))
