"""The command line as a user meets it: exit codes, files written, and one clear line for every wrong input."""

import io
import json
import os
import re
import shlex
import subprocess
import sys
from importlib.metadata import version

import click
import numpy as np
import pytest
from program import parse, raytwin, raytwin_alone, refused
from typer.main import get_command
from typer.testing import CliRunner

from raytwin.cli import app
from raytwin.cli.option_values import check_outputs
from raytwin.cli.progress_bar import lines, print_seconds, show_progress
from raytwin.images.exr import read_exr
from raytwin.images.image import Image
from raytwin.images.image_formats import write_image
from raytwin.photos.boards import Board, Grid, write_board
from raytwin.progress import Stages
from raytwin.scene.scene_files import read_camera


def test_compare_passes_and_writes_every_file(scenes, tmp_path):
    run = raytwin(
        "compare", scenes / "overlap", "--size", "160x120", "-o", tmp_path / "out", "--json", tmp_path / "a.json"
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("PASS  overlap, rung shadow")
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["backend"].keys() >= {"twin_variant", "tracer_engine"}
    assert found == json.loads((tmp_path / "out" / "comparison.json").read_text())
    tracer, _ = read_exr(tmp_path / "out" / "tracer.exr")
    other, _ = read_exr(tmp_path / "out" / "twin.exr")
    error, _ = read_exr(tmp_path / "out" / "error.exr")
    assert tracer.shape == (120, 160, 3)
    assert np.array_equal(tracer.mean - other.mean, error.mean)
    assert "<html" in (tmp_path / "out" / "report.html").read_text()[:500]
    names = "comparison.json", "error.exr", "report.html", "tracer.exr", "twin.exr"
    assert {p.name for p in (tmp_path / "out").iterdir()} == {*names}


def test_compare_fails_with_1_where_the_images_differ_and_says_with_0_that_a_lower_level_differs(scenes, tmp_path):
    write_image(tmp_path / "black.exr", Image(np.zeros((60, 80, 3), np.float32)))
    wrong, lower = ("--subject", tmp_path / "black.exr"), ("--rung", "sky", "--samples", 16)
    for options, code, verdict in ((wrong, 1, "FAIL"), (lower, 0, "DIFFERS")):
        run = raytwin("compare", scenes / "overlap", "--size", "80x60", *options, "-o", tmp_path)
        assert run.returncode == code, run.stderr
        assert run.stdout.startswith(verdict)


@pytest.mark.nightly
def test_without_any_llvm_one_line_says_what_to_install(scenes, tmp_path):
    environment = {"RAYTWIN_NO_LLVM": "1", "RAYTWIN_CACHE": str(tmp_path)}
    run = raytwin_alone("compare", scenes / "distorted", "--size", "80x60", "-o", tmp_path / "out", **environment)
    refused(run, "Mitsuba: expected", "pip install 'raytwin[llvm]'")
    doctor = raytwin_alone("doctor", **environment)
    assert doctor.returncode == 0
    assert "raytwin[llvm]" in next(line for line in doctor.stdout.splitlines() if line.startswith("backend"))


@pytest.mark.nightly
def test_calibrate_takes_photos_one_by_one(scenes, tmp_path):
    """The camera stands where asked."""
    photos = [scenes / "desk" / "photos" / f"photo_{i:02d}.jpg" for i in range(8)]
    outputs = "--json", tmp_path / "c.json", "-o", tmp_path / "c.toml"
    run = raytwin("calibrate", *photos, "--board", scenes / "desk" / "board.toml", *outputs, "--photo", photos[3].name)
    assert run.returncode == 0, run.stderr
    found = json.loads((tmp_path / "c.json").read_text())
    assert list(found) == ["image_size", "model", "K", "dist", "sigma", "rms_px", "views", "warnings", "boards"]
    assert list(found["views"][0]) == ["photo", "tags", "rms_px", "R_cam_board", "t_cam_board", "influence"]
    assert {v["photo"] for v in found["views"]} == {p.name for p in photos}
    view = next(v for v in found["views"] if v["photo"] == photos[3].name)
    camera = read_camera(tmp_path / "c.toml")
    assert camera.image_size == (2016, 1512)
    assert camera.fx == pytest.approx(1560, rel=0.01)
    assert np.allclose(camera.R_cam_board, view["R_cam_board"], atol=5e-3)
    assert np.allclose(camera.t_cam_board, view["t_cam_board"], atol=5e-3)
    assert "photo_03.jpg" in run.stdout


def test_a_truncated_photo_is_refused_by_name(scenes, tmp_path):
    for name in ("photo_03.jpg", "photo_04.jpg", "photo_05.jpg"):
        (tmp_path / name).write_bytes(
            (scenes / "desk" / "photos" / name).read_bytes()[: 100_000 if "4" in name else None]
        )
    refused(raytwin("calibrate", tmp_path, "--board", scenes / "desk" / "board.toml"), "photo_04.jpg", "truncated")


def test_the_option_that_is_wrong_is_named_as_it_was_typed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_board(tmp_path / "b.toml", Board("tag36h11", 0.03, Grid(3, 3, 0.04)))
    refused(raytwin("compare", "single", "--size=0x10"), "--size: expected")
    refused(
        raytwin("photograph", "--board", "b.toml", "-o", "out", "--focal", "0"),
        "--focal, --size: K: expected focal lengths",
    )


def test_misused_words_are_told_in_the_same_voice_as_all_else():
    for arguments, said in (
        ("compare --sise 3 single", "`raytwin compare` has no option --sise. Did you mean --size?"),
        ("compare --xyz", "`raytwin compare` has no option --xyz. `raytwin compare --help` lists what it takes."),
        ("diffs a b", "`raytwin` has no command diffs. Did you mean diff?"),
        ("compare", "SCENE is missing. `raytwin compare --help` lists what it takes."),
        ("photo simulate", "--out is missing. `raytwin photo simulate --help` lists what it takes."),
        ("walk --out", "--out needs a value."),
        ("grade starter --force=x", "--force takes no value."),
        ("compare single more", "`raytwin compare` takes no further words, as here more."),
        ("compare single --samples x", "--samples: expected a whole number, got x"),
        ("compare single --detectable-bias -1", "--detectable-bias: expected a number >= 0, got -1"),
    ):
        run = raytwin(*arguments.split())
        refused(run, said)
        assert run.stderr.startswith(f"raytwin: {said}")


def test_what_exists_is_kept_unless_one_says_otherwise(tmp_path, scenes):
    (tmp_path / "tracer.py").write_text("mine")
    refused(raytwin("grade", "starter", cwd=tmp_path), "raytwin: tracer.py exists. --force overwrites it.\n")
    assert (tmp_path / "tracer.py").read_text() == "mine"
    refused(raytwin("scenes", "copy", "single", tmp_path), f"{tmp_path} exists. Give the copy another folder.")


def test_a_program_that_cannot_be_started_is_named_without_the_systems_number(tmp_path):
    run = raytwin("compare", "single", "--size", "40x30", "--subject", "./nosuch {scene} {out}", cwd=tmp_path)
    refused(run, "The program ./nosuch cannot be started: No such file or directory.")


@pytest.mark.parametrize("arguments", [("compare", "overlapp"), ("compare", "overlap", "--rung", "shadw")])
def test_a_wrong_name_is_refused_before_anything_heavy_is_imported(arguments):
    code = f"import sys; sys.argv[1:] = {arguments!r}\nfrom raytwin.cli import main\ntry: main()\n"
    heavy = {"mitsuba", "drjit", "cv2", "bokeh", "jinja2"} | ({"numpy"} if len(arguments) == 2 else set())
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


def test_every_command_has_help_that_fits_in_80_columns_under_both_names_and_an_example_that_parses():
    for words, command in every_command().items():
        long, short = (CliRunner().invoke(app, [*words.split(), option]) for option in ("--help", "-h"))
        assert long.exit_code == short.exit_code == 0, words
        assert long.output == short.output
        assert max(map(len, long.output.splitlines())) <= 80, words
        assert not words or "..." not in command.get_short_help_str(66), words
        example = re.search(r"Example: (raytwin .*?)(?:\. |$)", command.epilog or "")
        assert example, words
        assert parse(shlex.split(example[1])[1:]) is None, example[1]
    assert raytwin("--version").stdout == f"raytwin {version('raytwin')}\n"


def test_the_first_screen_of_compares_help_has_what_most_comparisons_need():
    shown = CliRunner().invoke(app, ["compare", "--help"]).output
    first = "\n".join(shown.splitlines()[:24])
    for name in ("scene <path>", "--subject", "--rung", "--samples", "--size", "--out"):
        assert name in first
    own = shown.partition("raytwin's own tracer:")[2].partition("\n\n")[0]
    assert re.findall(r"^  (--[a-z-]+)", own, re.MULTILINE) == [
        "--tracer-rung", "--engine", "--solver", "--sampling", "--trim"
    ]  # fmt: skip
    assert not re.findall(r"\bcompare", CliRunner().invoke(app, ["reference", "--help"]).output)


@pytest.mark.nightly
def test_a_shell_completes_scenes_and_values():
    def completed(*words: str) -> list[str]:
        told = {"_RAYTWIN_COMPLETE": "complete_bash", "COMP_WORDS": " ".join(words), "COMP_CWORD": str(len(words) - 1)}
        code = "import sys; sys.argv[0] = 'raytwin'; from raytwin.cli import main; main()"
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | told)
        return run.stdout.split()

    assert completed("raytwin", "compare", "ov") == ["overlap"]
    assert completed("raytwin", "compare", "overlap", "--solver", "s") == ["stable"]


def test_a_bench_without_a_command_is_that_of_a_scene():
    refused(raytwin("bench", "--sizes", "big", "single"), "--sizes", "big")
    refused(raytwin("bench", "scene"), "scene: expected a scene's folder")


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


def test_long_stages_leave_one_line_each_where_there_is_no_terminal(capsys, monkeypatch):
    clock = iter([0.0, 0.1, 5.0, 5.0, 9.5, 10.0, 15.0])
    monkeypatch.setattr("raytwin.cli.progress_bar.time.perf_counter", lambda: next(clock))
    show = lines()
    for stage, done, total in (
        ("calibrate", 0, 3), ("calibrate", 1, 3), ("calibrate", 3, 3), ("tracer", 0, 1), ("tracer", 1, 1),
        ("twin", 0, 9), ("twin", 9, 9),
    ):  # fmt: skip
        show(stage, done, total)
    assert capsys.readouterr().err == "calibrate: 3 of 3, 5.0 s\ntwin: 9 of 9, 5.0 s\n"


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
    print_seconds(stages, False, worth)
    assert capsys.readouterr().out == "  seconds: calibrate 2.00 s (rms 0.1 px), tracer 0.04 s (exact)\n"
    print_seconds(stages, True, worth)
    told = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in told[:3]] == [["calibrate", "2.00"], ["tracer", "0.04"], ["report", "1.50"]]
    assert [line.split("s   ")[-1] for line in told[:2]] == ["rms 0.1 px", "exact"]
    assert [line.split()[-2] for line in told[3:]] == ["1.46", "5.00"]
