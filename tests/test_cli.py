"""The command line as a user meets it: exit codes, files written, and one clear line for every wrong input."""

import io
import json
import re
import shlex
import subprocess
import sys
from importlib.metadata import version

import click
import numpy as np
import pytest
from program import parse, raytwin, refused
from typer.main import get_command
from typer.testing import CliRunner

from raytwin.cli import app
from raytwin.cli.option_values import check_outputs
from raytwin.cli.progress_bar import print_seconds, show_progress
from raytwin.images.exr import read_exr
from raytwin.images.image import Image
from raytwin.images.image_formats import write_image
from raytwin.photos.boards import Board, Grid, write_board
from raytwin.progress import Stages


def test_compare_passes_and_writes_every_file(scenes, tmp_path):
    out = tmp_path / "out"
    run = raytwin("compare", scenes / "overlap", "--size", "160x120", "-o", out, "--json", tmp_path / "a.json")
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("PASS  overlap, light level shadow")
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["backend"].keys() >= {"twin_variant", "tracer_engine"}
    assert found == json.loads((out / "comparison.json").read_text())
    tracer, other, error = (read_exr(out / f"{name}.exr")[0] for name in ("tracer", "twin", "error"))
    assert tracer.shape == (120, 160, 3)
    assert np.array_equal(tracer.mean - other.mean, error.mean)
    assert "<html" in (out / "report.html").read_text()[:500]
    names = {"comparison.json", "error.exr", "report.html", "tracer.exr", "twin.exr"}
    assert {p.name for p in out.iterdir()} == names


def test_compare_fails_with_1_where_the_images_differ_and_says_with_0_that_a_lower_level_differs(scenes, tmp_path):
    write_image(tmp_path / "black.exr", Image(np.zeros((60, 80, 3), np.float32)))
    wrong, lower = ("--subject", tmp_path / "black.exr"), ("--rung", "sky", "--samples", 16)
    for options, code, verdict in ((wrong, 1, "FAIL"), (lower, 0, "DIFFERS")):
        run = raytwin("compare", scenes / "overlap", "--size", "80x60", *options, "-o", tmp_path)
        assert run.returncode == code, run.stderr
        assert run.stdout.startswith(verdict)


def test_misused_words_are_told_in_one_line_that_names_the_help():
    for arguments, said, command in (
        ("compare --sise 3 single", "No such option: --sise (Possible options: --seed, --size)", "raytwin compare"),
        ("diffs a b", "No such command 'diffs'. Did you mean 'diff'?", "raytwin"),
        ("photo simulate", "Missing option '--out' / '-o'", "raytwin photo simulate"),
        ("grade", "Missing argument 'submissions'", "raytwin grade"),
        ("compare single more", "Got unexpected extra argument(s) (more)", "raytwin compare"),
        ("compare single --samples x", "Invalid value for '--samples'", "raytwin compare"),
    ):
        run = raytwin(*arguments.split())
        refused(run, f"(`{command} --help` lists what it takes)")
        assert run.stderr.startswith(f"raytwin: {said}")


def test_what_is_wrong_is_named_as_it_was_typed_and_what_exists_is_kept(tmp_path, scenes):
    write_board(tmp_path / "b.toml", Board("tag36h11", 0.03, Grid(3, 3, 0.04)))
    (tmp_path / "tracer.py").write_text("mine")
    for name in "123":
        (tmp_path / f"{name}.jpg").write_bytes((scenes / "desk" / "photos" / "photo_04.jpg").read_bytes()[:100_000])
    small = ("compare", "single", "--size", "40x30")
    for words, said in (
        (("compare", "single", "--size=0x10"), "--size: expected"),
        ((*small, "--detectable-bias", "0"), "--detectable-bias: expected a number > 0, got 0"),
        ((*small, "--subject", "./nosuch {scene} {out}"), "The program ./nosuch cannot be started: No such file"),
        (("photo", "calibrate", ".", "--board", "b.toml"), "3.jpg: a damaged one (image file is truncated"),
        (("bench", "--sizes", "big", "single"), "--sizes: expected numbers separated by commas, got big"),
        (("bench", "scene"), "scene: expected a scene's folder"),
        (("grade", "starter"), "raytwin: tracer.py exists. --force overwrites it.\n"),
        (("scenes", "copy", "single", tmp_path), f"{tmp_path} exists. Give the copy another folder."),
    ):
        refused(raytwin(*words, cwd=tmp_path), said)
    assert (tmp_path / "tracer.py").read_text() == "mine"


@pytest.mark.parametrize("arguments", [("compare", "overlapp"), ("compare", "overlap", "--rung", "shadw")])
def test_a_wrong_name_is_refused_before_anything_heavy_is_imported(arguments):
    code = f"import sys; sys.argv[1:] = {arguments!r}\nfrom raytwin.cli import main\ntry: main()\n"
    heavy = {"mitsuba", "drjit", "cv2", "jinja2"} | ({"numpy"} if len(arguments) == 2 else set())
    code += f"finally: print(sorted({heavy} & sys.modules.keys()))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (2, "[]\n"), run.stderr
    assert "did you mean" in run.stderr


def every_command() -> dict[str, click.Command]:
    """Each command and group of commands by its words, "" for raytwin itself."""
    found: dict[str, click.Command] = {"": get_command(app)}
    for words in ("", *found[""].commands):
        found |= {f"{words} {name}".strip(): c for name, c in getattr(found[words], "commands", {}).items()}
    return found


def test_every_command_has_help_that_fits_in_80_columns_under_both_names_and_an_example_that_parses(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for words, command in every_command().items():
        long, short = (CliRunner().invoke(app, [*words.split(), option]) for option in ("--help", "-h"))
        assert long.exit_code == short.exit_code == 0, words
        assert long.output == short.output
        assert max(map(len, long.output.splitlines())) <= 80, words
        example = re.search(r"Example: (raytwin .*?)(?:\. |$)", command.epilog or "")
        assert example, words
        assert parse(shlex.split(example[1])[1:]) is None, example[1]
    assert raytwin("--version").stdout == f"raytwin {version('raytwin')}\n"


def test_the_first_screen_of_help_has_the_fourteen_commands_and_compares_what_most_comparisons_need(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    listed = re.findall(r"^│ (\w+)  ", CliRunner().invoke(app, ["--help"]).output, re.MULTILINE)
    assert listed == [
        "compare", "diff", "laws", "explore", "shrink", "reference", "bench", "levels", "stability", "photo", "walk",
        "grade", "scenes", "doctor",
    ]  # fmt: skip
    shown = CliRunner().invoke(app, ["compare", "--help"]).output
    first, own = (shown.partition(part)[i] for part, i in (("raytwin's own tracer", 0), ("raytwin's own tracer", 2)))
    assert len(first.splitlines()) <= 30
    for name in ("scene", "--subject", "--rung", "--samples", "--size", "--out"):
        assert name in first
    own = own.partition("╰")[0]
    options = ["--tracer-rung", "--engine", "--solver", "--sampling", "--trim"]
    assert re.findall(r"^│ (--[a-z-]+)", own, re.MULTILINE) == options


def test_an_output_that_cannot_be_written_is_told_before_the_work(scenes, tmp_path):
    (tmp_path / "file").touch()
    for options, where in (
        (("--json", tmp_path), str(tmp_path)),
        (("--json", tmp_path / "file" / "a.json"), "a.json"),
        (("--out", tmp_path / "file"), "file"),
    ):
        refused(raytwin("compare", scenes / "desk", *options), where)
    check_outputs(folders=(tmp_path, tmp_path / "new" / "folder", None), files=(tmp_path / "file",))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_bars_are_gone_once_the_work_is_done(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", shown := Terminal())
    with show_progress() as progress, progress.stage("tracer"):
        pass
    drawn, _, after = shown.getvalue().rpartition("tracer")
    assert drawn
    assert "\x1b[2K" in after  # the line is erased behind the last drawing


def test_every_stage_is_timed_once_and_parts_of_a_stage_are_not_counted_again(monkeypatch):
    clock = iter(range(0, 1000, 10))
    monkeypatch.setattr("raytwin.progress.time.perf_counter", lambda: next(clock))
    shown = []
    stages = Stages(lambda *step: shown.append(step))
    with stages.stage("calibrate"):
        stages("detect", 0, 2)
        stages("detect", 2, 2)
    stages("twin", 50, 100)
    stages("twin", 100, 100)
    with stages.stage("calibrate"):
        pass
    assert stages.seconds == {"calibrate": 20, "twin": 10}
    assert [s for s, done, total in shown if done == total] == ["detect", "calibrate", "twin", "calibrate"]


def test_the_seconds_that_are_told_make_up_the_whole(capsys, monkeypatch):
    stages = Stages()
    stages.seconds |= {"calibrate": 2.0, "tracer": 0.04, "report": 1.5}
    monkeypatch.setattr("raytwin.cli.progress_bar.STARTED", 100.0)
    monkeypatch.setattr("raytwin.cli.progress_bar.time.perf_counter", lambda: 105.0)
    worth = {"calibrate": "rms 0.1 px", "tracer": "exact"}
    first = "  seconds: calibrate 2.00 s (rms 0.1 px), tracer 0.04 s (exact)"
    for verbose, said in ((False, first), (True, f"{first}, report 1.50 s, in all 5.00 s")):
        print_seconds(stages, verbose, worth)
        assert capsys.readouterr().out == f"{said}\n"
