"""autograder.zip, unpacked and run as Gradescope does, in its own folders below a temporary one."""

import json
import os
import shlex
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import submitted_tracers as tracers

from raytwin.errors import InputError
from raytwin.teach.grade.gradescope import write_zip

pytest.importorskip("resource")

RUBRIC = """
title = "t"
limits = { memory_mb = 300 }
exercises = [
  { stage = "intersect_sphere", points = 10 },
  { name = "image", stage = "render", scenes = ["single"], rung = "lambert", points = 20, visibility = "hidden" },
]
"""

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(sys.platform != "linux", reason="Gradescope's containers are Linux"),
]


def some_wheel(folder: Path) -> Path:
    """Nothing is installed from it here."""
    (folder / "raytwin-1-py3-none-any.whl").touch()
    return folder / "raytwin-1-py3-none-any.whl"


def container(folder: Path, submission: str) -> dict:
    """Return results.json after setup.sh and run_autograder."""
    (folder / "rubric.toml").write_text(RUBRIC)
    write_zip(folder / "rubric.toml", folder / "autograder.zip", some_wheel(folder))
    base = folder / "autograder"
    with zipfile.ZipFile(folder / "autograder.zip") as archive:
        archive.extractall(base / "source")
    (base / "run_autograder").write_bytes((base / "source" / "run_autograder").read_bytes())
    for name in ("submission", "results", "raytwin/bin"):
        (base / name).mkdir(parents=True)
    (base / "submission" / "my tracer.py").write_text(submission)
    # The packages of this environment stand for what pip would bring.
    python, source = base / "raytwin" / "bin" / "python", Path(write_zip.__code__.co_filename).parents[3]
    python.write_text(f'#!/bin/sh\nPYTHONPATH="{source}" exec "{sys.executable}" "$@"\n')
    python.chmod(0o755)
    environment = os.environ | {"RAYTWIN_AUTOGRADER": str(base), "RAYTWIN_NO_INSTALL": "1"}
    for script in ("source/setup.sh", "run_autograder"):
        done = subprocess.run(["bash", base / script], env=environment, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stdout + done.stderr
    return json.loads((base / "results" / "results.json").read_text())


@pytest.fixture(scope="module")
def graded(tmp_path_factory):
    """(results.json, /autograder) of a tracer with a mistake that also reads and writes wherever it can."""
    folder = tmp_path_factory.mktemp("gradescope")
    base = folder / "autograder"
    steal = tracers.tracer("gamma") + (
        "\nimport glob\n"
        f"for path in glob.glob({str(base)!r} + '/**', recursive=True) + [{str(base / 'source' / 'rubric.toml')!r}]:\n"
        "    try:\n        print('STOLEN', path, open(path, 'rb').read(8))\n    except OSError: pass\n"
        f"try:\n    open({str(base / 'results' / 'results.json')!r}, 'w').write('hacked')\nexcept OSError: pass\n"
        f"try:\n    open({str(base / 'run_autograder')!r}, 'a').write('hacked')\nexcept OSError: pass\n"
        "print('as far as it came')\n"
    )
    return container(folder, steal), base


def test_it_grades_a_submission_in_gradescopes_folders(graded):
    told = graded[0]
    assert (told["score"], [t["score"] for t in told["tests"]]) == (10, [10, 0])
    assert told["tests"][1]["visibility"] == "hidden"


def test_a_submission_finds_neither_references_nor_rubric_nor_results(graded):
    base = graded[1]
    (result,) = (base / "results" / ".grades" / "results").iterdir()
    printed = json.loads(result.read_text())["printed"]
    assert "as far as it came" in printed
    assert "STOLEN" not in printed
    assert "hacked" not in (base / "run_autograder").read_text()


def test_packages_of_the_rubric_are_installed_and_run_nothing(tmp_path):
    (tmp_path / "r.toml").write_text('packages = ["numba>=0.6", "a; rm -rf /"]\n' + RUBRIC)
    write_zip(tmp_path / "r.toml", tmp_path / "a.zip", some_wheel(tmp_path))
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        (line,) = (s for s in archive.read("setup.sh").decode().splitlines() if "pip install" in s)
    assert shlex.split(line)[-2:] == ["numba>=0.6", "a; rm -rf /"]


def test_a_rubric_whose_scene_has_no_reference_is_refused(tmp_path):
    (tmp_path / "r.toml").write_text(RUBRIC.replace('"single"', '"nowhere"'))
    with pytest.raises(InputError, match="nowhere"):
        write_zip(tmp_path / "r.toml", tmp_path / "a.zip")
    assert not (tmp_path / "a.zip").exists()


def test_a_development_version_asks_for_its_wheel(tmp_path):
    (tmp_path / "r.toml").write_text(RUBRIC)
    with pytest.raises(InputError, match=r"--wheel: This is version .*\.dev0, which no package index has"):
        write_zip(tmp_path / "r.toml", tmp_path / "b.zip")
    assert not (tmp_path / "b.zip").exists()
