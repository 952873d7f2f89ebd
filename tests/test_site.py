"""The site: it builds without a warning, its links lead somewhere, it loads nothing from elsewhere, all can read it."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from browser import barriers_of

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "docs" / "build.py"


@pytest.fixture(scope="module")
def faults(tmp_path_factory):
    """build.py's check of a folder of pages."""
    sys.path.insert(0, str(BUILD.parent))
    try:
        return runpy.run_path(str(BUILD))["faults"]
    finally:
        sys.path.remove(str(BUILD.parent))


@pytest.mark.parametrize(
    ("link", "wrong"),
    [
        ('<a href="b.html#here">', ""),
        ('<a href="b.html">', ""),
        ('<a href="https://example.org/">', ""),
        ('<a href="c.html">', "a.html: c.html leads nowhere"),
        ('<a href="b.html#there">', "a.html: b.html#there: b.html has no such heading"),
        ('<img src="missing.png">', "a.html: missing.png leads nowhere"),
        ('<script src="https://example.org/a.js">', "a.html: loads https://example.org/a.js"),
    ],
)
def test_a_link_that_leads_nowhere_and_a_file_from_elsewhere_are_noticed(faults, tmp_path, link, wrong):
    (tmp_path / "a.html").write_text(link, encoding="utf-8")
    (tmp_path / "b.html").write_text('<h1 id="here">b</h1>', encoding="utf-8")
    assert faults(tmp_path) == ([wrong] if wrong else [])


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, str(BUILD), "--no-gallery", "--site", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_it_builds_without_a_warning_and_has_every_command_and_every_exported_name(site):
    import raytwin
    from raytwin.cli import app

    commands = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    names = [c.name or c.callback.__name__ for c in app.registered_commands] + [g.name for g in app.registered_groups]
    assert [name for name in names if f'id="raytwin-{name}"' not in commands] == []
    api = (site / "reference" / "api.html").read_text(encoding="utf-8")
    exported = [name for name in raytwin.__all__ if not name.startswith("_")]
    assert [name for name in exported if f">raytwin.{name}" not in api] == []


@pytest.mark.parametrize("page", ["index", "tutorials/instructor", "reference/commands", "measured/verdict"])
def test_axe_core_finds_nothing_serious(chromium, site, page):
    assert barriers_of(chromium, site / f"{page}.html") == []
