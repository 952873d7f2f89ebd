"""What is built works where it is installed: no checkout beside it, nothing but what the wheel brings."""

import ast
import contextlib
import json
import re
import runpy
import subprocess
import sys
import tarfile
import urllib.request
import zipfile
from pathlib import Path

import pytest
from installed_wheel import TEXTS, clean_environment
from program import CHAIN, check_chain

ROOT = Path(__file__).resolve().parent.parent
MOST_BYTES = 13e6
"""Of the wheel: references 7.3 MB, scenes 3.8 MB (photos are progressive: 17 % less, the same pixels), code 0.5 MB."""

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def installed(environment_with, tmp_path_factory):
    """`run(*command)` in an empty folder, with an environment that has the wheel and every extra of a user's."""
    home = tmp_path_factory.mktemp("installed")
    python, environment = environment_with("all", "llvm", "notebook", also=("pytest",)), clean_environment(home)
    empty = home / "empty"
    empty.mkdir()
    (empty / "chain.py").write_text(CHAIN)

    def run(*command: str, code: int | None = 0) -> str:
        done = subprocess.run(
            [python, "-m", *command], cwd=empty, env=environment, capture_output=True, text=True, timeout=300
        )
        assert code in (None, done.returncode), f"{command}: {done.returncode}\n{done.stdout}{done.stderr}"
        return done.stdout

    @contextlib.contextmanager
    def started(*command: str):
        command = [python, "-u", "-m", *command]
        child = subprocess.Popen(command, cwd=empty, env=environment, stdout=subprocess.PIPE, text=True)
        try:
            yield child
        finally:
            child.terminate()
            child.wait(60)
            child.stdout.close()

    def chain(*steps: tuple[str, int, str]) -> None:
        check_chain(steps, lambda words: run("chain", words))

    run.folder, run.started, run.chain = empty, started, chain
    return run


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


def test_the_wheel_brings_scenes_and_references_and_stays_small(built):
    wheel = next(built.glob("*.whl"))
    there = contents(wheel)
    asked = {f"raytwin/shipped/{n}" for n in tracked("scenes", "reference") if not n.endswith(".md")}
    assert {n for n in there if n.startswith("raytwin/shipped/")} == asked
    assert {n.replace("src/", "", 1) for n in tracked("src")} <= there
    assert wheel.stat().st_size < MOST_BYTES


def test_the_sdist_brings_tests_scenes_and_references(built):
    there = contents(next(built.glob("*.tar.gz")))
    assert tracked("src", "scenes", "reference", "tests", "docs", ".ci", ".github", *TEXTS) <= there


def test_the_sdists_own_tests_find_what_they_need_beside_them(built, tmp_path):
    """A part of them: the READMEs' links, which lead everywhere, and the references with their scenes."""
    with tarfile.open(next(built.glob("*.tar.gz"))) as tar:
        tar.extractall(tmp_path, filter="data")
    (root,) = tmp_path.iterdir()
    links = "tests/test_readme.py::test_links_lead_to_files_that_are_there"
    references = "tests/workflows/test_reference.py::test_a_shipped_reference_is_whole_and_of_its_scene"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", links, references]
    environment = clean_environment(tmp_path) | {"PYTHONPATH": str(root / "src")}
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout[-3000:]


def test_an_installed_raytwin_does_its_jobs_in_an_empty_folder(installed):
    assert "report: out/desk/report.html" in installed("raytwin", "compare", "desk", "--size", "168x126")
    installed.chain(
        ("scenes", 0, "desk"),
        ("compare scenes/single --size 64x48", 0, "report: out/single/report.html"),
        ("diff out/single/tracer.exr out/single/twin.exr --fail 1e-4 -o out/diff", 0, "report: out/diff/report.html"),
        ("bench single --sizes 0.003 --budget 3600 --repeats 2 --methods numpy32-*-conic", 0, "numpy32"),
        ("reference show single", 0, "single/shadow"),
        ("reference check single --rung shadow", 0, "1 reference, 0 failed"),
        ("scenes copy desk mine", 0, "mine"),
        ("scenes copy desk mine", 2, ""),
        ("calibrate mine/photos --board mine/board.toml", 0, "rms"),
        ("export single --json -o out/single.json", 0, ""),
        ("export single --mitsuba-xml", 0, "<scene version"),
        ("needs single --tolerance 0.1 --size 32x24", 0, "Cheapest"),
        ("ladder single --size 64x48", 0, "report: out/single-ladder/ladder.html"),
        ("stability sum-samples", 0, "report: out/stability/atlas.html"),
        ("walk --notebook -o lessons", 0, "wrote lessons/"),
    )
    assert json.loads((installed.folder / "out" / "single.json").read_text())["width"] == 640
    assert len(list((installed.folder / "lessons").glob("*.ipynb"))) == 1


def test_an_installed_raytwin_checks_a_students_functions(installed):
    """`raytwin.check`, from the file that students begin with: nothing is written yet, then a sphere's far side."""
    installed("raytwin", "grade", "starter", "-o", "tracer.py")
    told = installed("tracer", code=None)
    assert "intersect_sphere" in told
    (installed.folder / "far.py").write_text(FAR)
    assert "you take the far root, where the ray leaves the sphere" in installed("far")


FAR = """
import numpy as np
import raytwin

def intersect_sphere(o, d, c, r):
    f = o - c
    a, b = (d * d).sum(-1), (f * d).sum(-1)
    left = b * b - a * ((f * f).sum(-1) - r * r)
    t = (np.sqrt(np.maximum(left, 0)) - b) / a
    return np.where((left >= 0) & (t > 0), t, np.inf)

raytwin.check("intersect_sphere", intersect_sphere)
"""

RUBRIC = """
title = "One scene"
[[exercises]]
stage = "render"
scenes = ["single"]
rung = "lambert"
points = 10
"""


def test_an_installed_raytwin_grades_a_class(installed):
    tracer = runpy.run_path(str(ROOT / "tests" / "submitted_tracers.py"))["tracer"]
    (installed.folder / "rubric.toml").write_text(RUBRIC)
    (installed.folder / "students").mkdir()
    for name in ("", "gamma"):
        (installed.folder / "students" / f"{name or 'right'}.py").write_text(tracer(name))
    told = installed("raytwin", "grade", "students", "--rubric", "rubric.toml")
    assert "10 of 10  right: all right" in told
    assert re.search(r" 0 of 10  gamma: .*gamma", told), told
    assert "report: out/grades/index.html" in told
    (rows,) = (installed.folder / "out" / "grades").glob("*.csv")
    assert rows.read_text().splitlines()[2].startswith("right,10,10")


def test_an_installed_raytwin_shows_a_scene_on_a_live_page(installed):
    with installed.started("raytwin", "explore", "single", "--size", "32x24", "--no-browser") as child:
        address, _, token = child.stdout.readline().split(" at ")[1].strip().partition("#")
        asked = urllib.request.Request(f"{address}about", headers={"X-Raytwin-Token": token.rpartition("=")[2]})
        page, about = (urllib.request.urlopen(what, timeout=100).read().decode() for what in (address, asked))
    assert "<script" in page
    assert json.loads(about)["scene"] == "single"


def test_an_installed_plugin_holds_renders_to_the_shipped_references(installed):
    (installed.folder / "test_mine.py").write_text(
        "def test_equal(raytwin_reference):\n"
        "    reference = raytwin_reference('single', 'lambert')\n"
        "    reference.check(reference.image.mean)\n"
        "def test_brighter(raytwin_reference):\n"
        "    reference = raytwin_reference('single', 'lambert')\n"
        "    assert not reference.compare(1.1 * reference.image.mean).passed\n"
    )
    assert "2 passed" in installed("pytest", "-q", "test_mine.py")


def test_too_old_a_python_is_refused_in_one_line():
    ast.parse((ROOT / "setup.py").read_text(), feature_version=(3, 7))
    code = "import runpy, sys; sys.version_info = (3, 10, 13, 'final', 0); runpy.run_path('setup.py')"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "raytwin needs Python 3.11 or newer; this is Python 3.10\n")


def test_the_version_stands_in_one_place_and_changelog_and_citation_name_its_release():
    import tomllib

    import raytwin

    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert raytwin.__version__ == version
    release = version.partition(".dev")[0]
    assert f"\n## {release} (" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"\nversion: {release}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
