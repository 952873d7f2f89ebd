"""The site: it builds without a warning, its links lead somewhere, it loads nothing from elsewhere, all can read it."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from browser import barriers_of
from PIL import Image as Picture

import raytwin

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "docs" / "build.py"


@pytest.fixture
def faults(monkeypatch):
    """build.py's check of a folder of pages."""
    monkeypatch.syspath_prepend(str(BUILD.parent))
    return runpy.run_path(str(BUILD))["faults"]


def test_a_link_that_leads_nowhere_and_a_file_from_elsewhere_are_noticed(faults, tmp_path):
    (tmp_path / "b.html").write_text('<h1 id="here">b</h1>', encoding="utf-8")
    for link, wrong in (
        ('<a href="b.html#here">', ""),
        ('<a href="https://example.org/">', ""),
        ('<a href="c.html">', "a.html: c.html leads nowhere"),
        ('<a href="b.html#there">', "a.html: b.html#there: b.html has no such heading"),
        ('<img src="missing.png">', "a.html: missing.png leads nowhere"),
        ('<script src="https://example.org/a.js">', "a.html: loads https://example.org/a.js"),
    ):
        (tmp_path / "a.html").write_text(link, encoding="utf-8")
        assert faults(tmp_path) == ([wrong] if wrong else []), link


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, str(BUILD), "--no-gallery", "--site", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_it_builds_without_a_warning_and_has_every_command_and_every_exported_name(site):
    from raytwin.cli import COMMANDS

    commands = (site / "commands.html").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f'id="raytwin-{name.replace(" ", "-")}"' not in commands] == []
    api = (site / "api.html").read_text(encoding="utf-8")
    assert [name for name in raytwin.__all__ if not name.startswith("_") and f">raytwin.{name}" not in api] == []


@pytest.mark.parametrize("page", ["index", "teach", "commands", "api", "measured", "faults", "gallery"])
def test_axe_core_finds_nothing_serious(chromium, site, page):
    assert barriers_of(chromium, site / f"{page}.html") == []


MEASURED = BUILD.parent / "measured.md"
WRITTEN_BY_HAND = runpy.run_path(str(BUILD.parent / "tables.py"))["written_by_hand"]


def test_no_measured_table_is_written_by_hand():
    assert WRITTEN_BY_HAND(MEASURED) == []
    assert "<!-- table: " in MEASURED.read_text(encoding="utf-8")


def test_the_gallery_shows_a_fault_beside_its_difference_and_every_sentence(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(BUILD.parent))
    import fault_gallery as gallery

    single = raytwin.read_scene("single")
    small = {"FOLDER": tmp_path, "WIDTH": 80, "HEIGHT": 60, "draw_scene": lambda seed: single}
    for name, value in small.items():
        monkeypatch.setattr(gallery, name, value)
    overlap = gallery.scenes()[:1]
    monkeypatch.setattr(gallery, "scenes", lambda: overlap)
    gallery.make(["no-shadow", "nothing-met"])
    assert {path.stem for path in tmp_path.glob("*.webp")} == {"no-shadow", "nothing-met"}
    pixels = np.asarray(Picture.open(tmp_path / "no-shadow.webp"), float) / 255
    off = pixels[:, gallery.WIDTH + gallery.GAP :]
    red, blue = off[..., 0] - off[..., 2] > 0.5, off[..., 2] - off[..., 0] > 0.5
    assert 0.02 < red.mean() < 0.2  # the cast shadows are missing: too bright there, and nothing is too dark
    assert blue.mean() < 0.005
    page = gallery.page()
    assert [f.name for f in gallery.FAULTS if f"<b>{f.name}</b>" not in page] == []
    assert page.count("<img") == 2
    with pytest.raises(SystemExit, match="expected names of faults, got nonsense"):
        gallery.make(["nonsense"])
