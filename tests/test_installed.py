"""The wheel works where it is installed: no checkout beside it, with nothing but what its extras bring."""

import ast
import json
import re
import runpy
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
from installed_wheel import TEXTS, clean_environment
from program import CHAIN, check_chain

import raytwin
from raytwin.images.exr import write_exr
from raytwin.images.image import Image

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).resolve().parent.parent
MOST_BYTES = 13e6
"""Of the wheel: references 7.3 MB, scenes 3.8 MB (photos are progressive: 17 % less, the same pixels), code 0.5 MB."""
FULL = "all", "llvm", "notebook"
"""A user's extras."""

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
WITHOUT_UNIX = {
    "names": ("resource", "fcntl", "pwd", "grp", "termios", "tty", "pty", "syslog"),
    "missing": ("fork", "forkpty", "symlink", "link", "mkfifo", "chown", "O_NOFOLLOW"),
    "folders": ("/proc", "/sys"),
}
"""What Windows lacks."""
WITHOUT_PHOTOS = {"names": ("cv2", "pupil_apriltags"), "missing": (), "folders": ("/nowhere",)}


@pytest.fixture
def run(tmp_path, environment_with):
    """`run(*command)`: python -m ... in tmp_path, with the wheel and `extras`, without what `blocked` names."""

    def child(*command: str, extras: tuple[str, ...] = (), blocked: dict | None = None):
        environment = clean_environment(tmp_path) | {"RAYTWIN_CACHE": str(tmp_path / "cache")}
        if blocked:
            (tmp_path / "without").mkdir(exist_ok=True)
            (tmp_path / "without" / "sitecustomize.py").write_text(BLOCKED.format(**blocked))
            environment["PYTHONPATH"] = str(tmp_path / "without")
        python = environment_with(*extras, also=("pytest",))
        command = (str(python), *(command if command[0] == "-c" else ("-m", *command)))
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
        return done

    (tmp_path / "chain.py").write_text(CHAIN)
    return child


def contents(archive: Path) -> set[str]:
    if archive.suffix == ".whl":
        return set(zipfile.ZipFile(archive).namelist())
    with tarfile.open(archive) as tar:
        return {name.partition("/")[2] for name in tar.getnames()}


def tracked(*folders: str) -> set[str]:
    listed = subprocess.run(["git", "ls-files", *folders], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode or not listed.stdout:
        pytest.skip("not a checkout: what belongs into the archives is not known")
    return {name for name in listed.stdout.split("\n") if name and (ROOT / name).exists()}


def test_the_archives_bring_scenes_and_references_and_the_wheel_stays_small(built):
    wheel = next(built.glob("*.whl"))
    there = contents(wheel)
    asked = {f"raytwin/shipped/{n}" for n in tracked("scenes", "reference") if not n.endswith(".md")}
    assert {n for n in there if n.startswith("raytwin/shipped/")} == asked
    assert {n.replace("src/", "", 1) for n in tracked("src")} <= there
    assert wheel.stat().st_size < MOST_BYTES
    source = contents(next(built.glob("*.tar.gz")))
    assert tracked("src", "scenes", "reference", "tests", "docs", ".ci", ".github", *TEXTS) <= source


# ----------------------------------------------------------------------------------------- without any extra

PLUGIN = """
def test_equal(raytwin_reference):
    reference = raytwin_reference("single", "lambert")
    reference.check(reference.image.mean)
    assert not reference.compare(1.1 * reference.image.mean).passed
"""

FAR = """
import numpy as np
import raytwin

def intersect_sphere(o, d, c, r):
    f = o - c
    a, b = (d * d).sum(-1), (f * d).sum(-1)
    left = b * b - a * ((f * f).sum(-1) - r * r)
    t = (np.sqrt(np.maximum(left, 0)) - b) / a
    return np.where((left >= 0) & (t > 0), t, np.inf)

if __name__ == "__main__":
    raytwin.check("intersect_sphere", intersect_sphere)
"""


def test_images_are_compared_and_files_graded_without_any_extra_and_nothing_of_unix(run, tmp_path):
    a = np.random.default_rng(1).random((20, 30, 3)).astype(np.float32)
    for name, image in (("a", a), ("b", 1.5 * a)):
        write_exr(tmp_path / f"{name}.exr", Image(image))
    (tmp_path / "far.py").write_text(FAR)
    (tmp_path / "rubric.toml").write_text('title = "t"\n[[exercises]]\nstage = "intersect_sphere"\npoints = 1\n')
    (tmp_path / "test_mine.py").write_text(PLUGIN)
    steps = (
        ("diff a.exr a.exr --flip --json a.json -o out", 0, "report: out/report.html"),
        ("diff a.exr b.exr --junit b.xml", 1, "FAIL"),
        ("reference show single", 0, "single/lambert"),
        ("scenes", 0, "desk"),
        ("scenes copy desk mine", 0, "mine"),
        ("scenes copy desk mine", 2, ""),
        ("export single", 0, '"width": 640'),
        ("grade starter -o tracer.py", 0, "tracer.py"),
        ("grade far.py --rubric rubric.toml -o grades", 0, "1 graded; report: grades"),
    )
    check_chain(steps, lambda words: run("chain", words, blocked=WITHOUT_UNIX).stdout)
    found = json.loads((tmp_path / "a.json").read_text())
    assert (found["verdict"], found["perceptual"]["flip_mean"], found["metrics"]["flip_hdr"]) == ("pass", None, None)
    assert "1 passed" in run("pytest", "-q", "-p", "no:cacheprovider", "test_mine.py", blocked=WITHOUT_UNIX).stdout
    assert "you take the far root, where the ray leaves the sphere" in run("far").stdout


def test_an_extra_that_is_missing_is_named_in_one_line(run):
    needs = {
        "compare single": "twin,llvm",
        "bench single": "twin,llvm",
        "explore single": "live",
        "photo calibrate . --board board.toml": "photos",
        "walk --notebook": "notebook",
    }
    calls = {"render(raytwin.read_scene('single'))": "twin,llvm", "read_board('board.toml')": "photos"}
    tries = (f"try: raytwin.{call}\nexcept raytwin.InputError as error: print(error)" for call in calls)
    in_python = run("-c", "\n".join(("import raytwin", *tries))).stdout.splitlines()
    assert all(f"'raytwin[{e}]'" in line for e, line in zip(calls.values(), in_python, strict=True)), in_python
    *told, (code, doctor) = json.loads(run("chain", json.dumps([c.split() for c in (*needs, "doctor")])).stdout)
    for extras, (refused, line) in zip(needs.values(), told, strict=True):
        assert (refused, line.count("\n")) == (2, 1), line
        assert f"pip install 'raytwin[{extras}]'" in line
    assert code == 0
    assert re.search(r"^backend +none: .*pip install 'raytwin\[twin,llvm\]'", doctor, re.MULTILINE)
    for extra, use in (("twin,llvm", "compare a scene"), ("photos", "calibrate a"), ("live", "open the live")):
        assert f"pip install 'raytwin[{extra}]'; needed to: {use}" in doctor


def test_the_wheels_types_hold_where_nothing_but_its_dependencies_is_installed(environment_with, tmp_path):
    """`mypy --strict` finds a user's code sound, and each mistake in it; of jaxtyping nothing is there."""
    python = environment_with(also=("pytest",))
    assert subprocess.run([python, "-c", "import jaxtyping"], capture_output=True).returncode == 1
    check = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", tmp_path / "mypy", "--python-executable", python]
    right, wrong = ROOT / "tests" / "user_code.py", ROOT / "tests" / "user_mistakes.py"
    done = subprocess.run([*check, right, wrong], cwd=tmp_path, capture_output=True, text=True)
    found = {int(line) for line in re.findall(rf"{wrong.name}:(\d+): error", done.stdout)}
    marked = {i for i, line in enumerate(wrong.read_text().split("\n"), 1) if line.endswith("# wrong")}
    assert found == marked, done.stdout
    assert right.name not in done.stdout, done.stdout


# ------------------------------------------------------------------------------------------- with every extra

RUBRIC = """
title = "One scene"
[[exercises]]
stage = "render"
scenes = ["single"]
rung = "lambert"
points = 10
"""


def test_an_installed_raytwin_does_its_jobs_in_an_empty_folder(run, tmp_path):
    (tmp_path / "rubric.toml").write_text(RUBRIC)
    (tmp_path / "students").mkdir()
    right = runpy.run_path(str(ROOT / "tests" / "submitted_tracers.py"))["tracer"]("")
    (tmp_path / "students" / "right.py").write_text(right)
    steps = (
        ("compare single --size 64x48", 0, "report: out/single/report.html"),
        ("reference check single --rung shadow", 0, "1 reference, 0 failed"),
        ("stability sphere-ground", 0, "report: out/stability/atlas.html"),
        ("walk --notebook -o lessons", 0, "wrote lessons/"),
        ("grade students --rubric rubric.toml", 0, "10 of 10  right: all right"),
    )
    check_chain(steps, lambda words: run("chain", words, extras=FULL).stdout)
    assert len(list((tmp_path / "lessons").glob("*.ipynb"))) == 1


def test_a_scene_whose_camera_is_given_needs_neither_opencv_nor_a_board(run):
    done = run("raytwin", "compare", "single", "--size", "64x48", extras=FULL, blocked=WITHOUT_PHOTOS)
    assert "report: out/single/report.html" in done.stdout


def test_too_old_a_python_is_refused_in_one_line():
    ast.parse((ROOT / "setup.py").read_text(), feature_version=(3, 7))
    code = "import runpy, sys; sys.version_info = (3, 10, 13, 'final', 0); runpy.run_path('setup.py')"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "raytwin needs Python 3.11 or newer; this is Python 3.10\n")


def test_the_version_stands_in_one_place_and_changelog_and_citation_name_its_release():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert raytwin.__version__ == version
    release = version.partition(".dev")[0]
    assert f"\n## {release} (" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"\nversion: {release}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
