"""Imports point one way, and heavy libraries stay out until they are asked for."""

import doctest
import functools
import importlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from raytwin.images.exr import write_exr
from raytwin.images.image import Image

ROOT = Path(__file__).resolve().parent.parent
GUIDE = ROOT / "docs" / "contributing.md"
HEAVY = {"mitsuba", "drjit", "cv2", "pupil_apriltags", "PIL", "OpenEXR", "jinja2", "OpenImageIO", "scipy", "reportlab"}


@functools.cache
def loaded_by(statement: str) -> set[str]:
    """The modules that a fresh interpreter holds after the statement."""
    code = f"import sys\n{statement}\nprint('\\n'.join(sys.modules))"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert child.returncode == 0, child.stderr
    return set(child.stdout.split())


def test_the_lower_floors_load_no_heavy_library():
    lower = (
        "import raytwin.errors, raytwin.scene, raytwin.images.image_formats, raytwin.scene.scene_files, raytwin.tracer"
    )
    assert not loaded_by(lower) & HEAVY


@pytest.mark.nightly
def test_importing_any_module_runs_nothing_and_writes_nothing(tmp_path):
    code = (
        "import importlib, pkgutil, raytwin\n"
        "for found in pkgutil.walk_packages(raytwin.__path__, 'raytwin.'):\n"
        "    if found.name != 'raytwin.twin.probe': importlib.import_module(found.name)"  # a script
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert not list(tmp_path.iterdir())


@pytest.mark.nightly
def test_to_draw_into_photos_and_tell_of_it_takes_neither_mitsuba_nor_what_compares_images():
    loads = "import raytwin.cli, raytwin.show.terminal_text, raytwin.study.augment_photos"
    draws = "from raytwin import fast, twin; assert not twin.chosen().libllvm or fast.ENGINES['drjit32'].float_type"
    assert not loaded_by(f"{loads}; {draws}") & {"mitsuba", "asyncio", "raytwin.compare", "raytwin.explain.diagnosis"}


@pytest.mark.nightly
def test_comparing_two_files_does_without_the_folders_that_the_guide_lists(tmp_path):
    (row,) = re.findall(r"^\| which folders `raytwin diff` .*$", GUIDE.read_text(encoding="utf-8"), re.M)
    for name, scale in (("a", 1), ("b", 2)):
        write_exr(tmp_path / f"{name}.exr", Image(np.full((9, 8, 3), scale, np.float32)))
    command = ["diff", str(tmp_path / "a.exr"), str(tmp_path / "b.exr"), "-o", str(tmp_path / "out")]
    run = f"import contextlib, io; from raytwin.cli import main; sys.argv[1:] = {command}"
    loaded = loaded_by(
        f"{run}\nwith contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit): main()"
    )
    rooms = {p.name for p in (ROOT / "src" / "raytwin").iterdir() if (p / "__init__.py").is_file()}
    assert set(re.findall(r"`(\w+)`", row)) == {room for room in rooms if f"raytwin.{room}" not in loaded}


def test_every_file_that_the_guide_names_is_there():
    named = re.findall(r"`((?:\w+/)+\w+\.\w+)`", GUIDE.read_text(encoding="utf-8"))
    assert len(named) > 20
    named.remove("scenes/NAME/scene.toml")
    assert [name for name in named if not any((ROOT / part / name).is_file() for part in (".", "src/raytwin"))] == []


# ------------------------------------------------------------------------------------------ the public API


def test_importing_raytwin_loads_the_standard_library_alone():
    before = loaded_by("import importlib, typing")
    assert {m for m in loaded_by("import raytwin") - before if m.partition(".")[0] != "raytwin"} == set()
    assert not [m for m in loaded_by("import raytwin") if m.startswith("raytwin.")]


def test_a_function_that_has_a_packages_name_is_that_package():
    import raytwin

    assert callable(raytwin.compare)
    assert raytwin.compare.METRICS is importlib.import_module("raytwin.compare").METRICS
    with pytest.raises(AttributeError, match="nonsense"):
        raytwin.nonsense  # noqa: B018


EXAMPLES = sorted(p for p in (ROOT / "src").rglob("*.py") if ">>> " in p.read_text(encoding="utf-8"))


@pytest.mark.nightly
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_the_examples_in_docstrings_work(path, monkeypatch):
    monkeypatch.chdir(ROOT)
    name = ".".join(path.relative_to(ROOT / "src").with_suffix("").parts).removesuffix(".__init__")
    found = doctest.testmod(importlib.import_module(name), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert found.attempted > 0
    assert found.failed == 0
