"""What is built works where it is installed: no checkout beside it, nothing but what the wheel brings."""

import ast
import os
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MOST_BYTES = 12.5e6
"""Of the wheel: references 7.2 MB, scenes 4.4 MB, code 0.4 MB."""

pytestmark = pytest.mark.slow


def clean_environment(home: Path) -> dict[str, str]:
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PYTEST", "VIRTUAL_ENV", "XDG_"))}
    return kept | {"HOME": str(home), "COLUMNS": "120"}


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """A folder with the sdist, and the wheel made of it."""
    out = tmp_path_factory.mktemp("dist")
    subprocess.run([sys.executable, "-m", "build", "--quiet", "--outdir", out, ROOT], check=True, timeout=300)
    return out


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """`run(*command)` in an empty folder, with an environment that has the wheel; its dependencies are this one's."""
    home = tmp_path_factory.mktemp("installed")
    subprocess.run([sys.executable, "-m", "venv", home / "env"], check=True)
    python = home / "env" / ("Scripts" if os.name == "nt" else "bin") / "python"
    environment = clean_environment(home)
    wheel = next(built.glob("*.whl"))
    install = [python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", wheel]
    subprocess.run(install, check=True, env=environment, timeout=120)
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = subprocess.run([python, "-c", ask], check=True, capture_output=True, text=True).stdout.strip()
    Path(site, "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    empty = home / "empty"
    empty.mkdir()

    def run(*command: str, code: int = 0) -> str:
        done = subprocess.run(
            [python, "-m", *command], cwd=empty, env=environment, capture_output=True, text=True, timeout=300
        )
        assert done.returncode == code, f"{command}: {done.returncode}\n{done.stdout}{done.stderr}"
        return done.stdout

    run.folder = empty
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
    asked = {f"raytwin/shipped/{n}" for n in tracked("scenes", "reference") if not n.endswith(("overview.png", ".md"))}
    assert {n for n in there if n.startswith("raytwin/shipped/")} == asked
    assert {n.replace("src/", "", 1) for n in tracked("src")} <= there
    assert wheel.stat().st_size < MOST_BYTES


def test_the_sdist_brings_tests_scenes_and_references(built):
    there = contents(next(built.glob("*.tar.gz")))
    assert tracked("src", "scenes", "reference", "tests", ".ci", "README.md", "setup.py", "pyproject.toml") <= there


def test_an_installed_raytwin_does_its_jobs_in_an_empty_folder(installed):
    assert "desk" in installed("raytwin", "scenes")
    assert "report: out/desk/report.html" in installed("raytwin", "compare", "desk", "--size", "168x126")
    installed("raytwin", "compare", "scenes/single", "--size", "64x48")
    mine, theirs = (f"out/single/{name}.exr" for name in ("tracer", "twin"))
    installed("raytwin", "diff", mine, theirs, "--fail", "1e-4", "-o", "out/diff")
    installed("raytwin", "bench", "single", "--sizes", "0.003", "--budget", "5", "--methods", "loop*,numpy*")
    assert "single/shadow" in installed("raytwin", "reference", "show", "single")
    assert "1 reference, 0 failed" in installed("raytwin", "reference", "check", "single", "--rung", "shadow")
    installed("raytwin", "scenes", "copy", "desk", "mine")
    installed("raytwin", "scenes", "copy", "desk", "mine", code=2)
    assert "rms" in installed("raytwin", "calibrate", "mine/photos", "--board", "mine/board.toml")


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
