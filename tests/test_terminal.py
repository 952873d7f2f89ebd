"""Names that strangers chose, and places that vanish: one clear line, nothing that moves the terminal's cursor."""

import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from program import raytwin, raytwin_alone, refused

from raytwin import cli
from raytwin.cli.terminal import say
from raytwin.images.image import Image
from raytwin.images.image_formats import write_image


def picture(path: Path, value: float = 0.5) -> Path:
    write_image(path, Image(np.full((24, 24, 3), value, np.float32)))
    return path


def test_a_verdict_is_coloured_on_a_terminal_alone_and_never_by_a_strangers_text(monkeypatch, capsys):
    monkeypatch.setattr(f"{typer.echo.__module__}.should_strip_ansi", lambda stream, color=None: color is False)
    say("FAIL  a\x1b[2J: too dark\nFAILED\nPASS  b")
    coloured = capsys.readouterr().out
    assert coloured.count("\x1b[31m") == coloured.count("\x1b[32m") == 1
    assert "\\x1b[2J" in coloured
    monkeypatch.setenv("NO_COLOR", "1")
    say("FAIL  a")
    assert capsys.readouterr().out == "FAIL  a\n"


def test_only_say_prints():
    """Text printed without it could carry a name's escapes."""
    for file in Path(cli.__file__).parent.glob("*.py"):
        if file.name != "terminal.py":
            prints = re.findall(r"(?:typer\.echo|\bprint|secho)\((.*)", file.read_text(encoding="utf-8"))
            assert [p for p in prints if not p.startswith("text, nl=False")] == [], file.name


@pytest.mark.skipif(os.name == "nt", reason="there a name is never bytes")
def test_an_output_whose_name_is_not_utf8_is_refused_before_the_work(tmp_path):
    name = os.fsdecode(bytes(tmp_path) + b"/o\xff")
    for command in (("compare", "single"), ("levels", "single"), ("bench", "single")):
        refused(raytwin(*command, "-o", name), "the name of an output", "UTF-8")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.nightly
@pytest.mark.skipif(os.name == "nt", reason="Windows keeps a folder that a process is in")
def test_a_working_folder_that_vanished_is_named(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    refused(raytwin_alone("doctor", PYTHONPATH=os.pathsep.join(sys.path)), "the current folder", "removed")
    monkeypatch.chdir(tmp_path)


@pytest.mark.nightly
def test_ctrl_c_during_the_first_imports_ends_in_one_line(tmp_path):
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt\n")
    run = raytwin_alone("--help", PYTHONPATH=str(tmp_path))
    assert (run.returncode, run.stdout, run.stderr) == (130, "", "raytwin: interrupted\n")
