"""What the machine or the input refuses is one line and exit code 2: never 1, which says that a comparison failed."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from program import raytwin, raytwin_alone, refused

from raytwin import errors
from raytwin.cli import main
from raytwin.images.exr import write_exr
from raytwin.images.image import Image
from raytwin.images.photo_files import write_picture

pytestmark = pytest.mark.nightly

LONG = "/" + "x" * 300
"""No folder can have this name: asking for it fails, as one that may not be entered does."""
RUBRIC = Path(errors.__file__).parent / "teach" / "grade" / "rubric.toml"
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="a Linux thing")


@pytest.fixture
def pair(tmp_path) -> tuple[Path, Path]:
    """Two images that differ."""
    a = np.random.default_rng(3).random((90, 120, 3)).astype(np.float32)
    for name, image in (("a", a), ("b", 1.5 * a)):
        write_exr(tmp_path / f"{name}.exr", Image(image))
    return tmp_path / "a.exr", tmp_path / "b.exr"


@LINUX
def test_a_full_disk_is_said_and_leaves_nothing_behind(pair, tmp_path):
    """No file may grow beyond 20 kB: the system refuses as it does where the disk is full."""
    (tmp_path / "sitecustomize.py").write_text(
        "import resource, signal\nsignal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))\n"
    )
    (tmp_path / "out").mkdir()
    path = os.pathsep.join([str(tmp_path), str(Path(errors.__file__).parents[1])])
    code = (
        "import numpy as np; import raytwin; import sys\n"
        "for path in sys.argv[1:]:\n"
        "    try: raytwin.write_image(path, raytwin.Image(np.random.rand(90, 120, 3).astype('f')))\n"
        "    except Exception as error: print(error)"
    )
    paths = [tmp_path / "out" / f"x.{ending}" for ending in ("exr", "pfm", "png")]
    child = subprocess.run(
        [sys.executable, "-c", code, *paths], env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )
    assert child.stdout.splitlines() == [f"{path}: expected a writable path, got File too large" for path in paths]
    refused(raytwin_alone("diff", *pair, "-o", tmp_path / "out", PYTHONPATH=path), "out/", "File too large")
    assert not [p for p in (tmp_path / "out").iterdir() if p.suffix != ".json"]


@LINUX
def test_standard_output_that_is_full_is_exit_code_2_and_a_closed_pipe_is_no_failed_comparison(pair):
    def run(words: list[str], stdout) -> tuple[int, str]:
        command = [sys.executable, "-m", "raytwin", *words]
        done = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True)
        return done.returncode, done.stderr

    with Path("/dev/full").open("w") as full:
        said = "raytwin: standard output: expected a working one, got No space left on device\n"
        assert run(["scenes"], full) == (2, said)
    reading, writing = os.pipe()
    os.close(reading)
    assert run(["diff", *map(str, pair)], writing) == (141, "")
    os.close(writing)


@LINUX
def test_a_home_that_cannot_be_entered_costs_the_cache_alone(tmp_path):
    asked = ("compare", "single", "--size", "32x24", "-o", tmp_path / "out")
    run = raytwin_alone(*asked, HOME=LONG, XDG_CACHE_HOME="", RAYTWIN_CACHE="")
    assert run.returncode == 0, run.stderr


@LINUX
def test_a_name_that_is_not_utf8_is_no_traceback(pair, tmp_path):
    odd = os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.png")
    write_picture(odd, np.zeros((4, 5, 3), np.uint8))
    refused(raytwin("diff", odd, tmp_path / "nosuch.png"), "nosuch.png", "no such file")
    refused(raytwin("diff", odd, odd, "--json", tmp_path / "x.json"), "UTF-8", "caf")
    assert raytwin("diff", odd, odd).returncode == 0


def test_pipes_and_devices_are_refused_where_files_are_read(tmp_path, pair):
    os.mkfifo(tmp_path / "pipe")
    for command in (
        ("diff", tmp_path / "pipe", pair[0]),
        ("compare", "single", "--subject", tmp_path / "pipe"),
        ("grade", tmp_path / "pipe", "-r", RUBRIC),
        ("calibrate", tmp_path, "--board", tmp_path / "pipe"),
    ):
        refused(raytwin(*command), "pipe")


def test_an_option_beyond_reason_is_refused(tmp_path):
    (tmp_path / "B").touch()
    light = "photo light B -o l.toml --camera c"
    for command, said in (
        ("compare single --size 100000x100000", "400 megapixels, got 100000x100000, 120 GB an image"),
        (f"{light} --ball 1mm,,2,3", "expected numbers separated by"),
        (f"{light} --ball 1px,2,3,4", "--ball: expected a length"),
        (f"{light} --stand 1mm,2,-3mm", "--stand: expected x,y,h in"),
        ("bench single --sizes 0", "--sizes: expected numbers above 0, got 0"),
        ("bench single --budget -3", "--budget: expected numbers above 0, got -3"),
        ("bench single --methods nonsense", "nonsense"),
        ("bench single --sizes nan", "--sizes: expected finite numbers"),
        ("bench single --sizes 1e9", "--sizes: expected at most 1000, got 1e+09"),
        ("compare single --rung path --samples 99999999999", "whole number from 1 to 16777216, got"),
        ("walk -o B", "B: expected a folder to write, got a file"),
        ("compare single --rung shadwo", "got shadwo (did you mean shadow?)"),
        ("compare single --engine numpy46", "(did you mean numpy64?)"),
        ("compare sinlge", "no such scene (did you mean single?)"),
    ):
        refused(raytwin(*command.split(), cwd=tmp_path), said)


def test_raytwins_own_fault_is_neither_a_failed_comparison_nor_the_inputs(monkeypatch, capsys):
    monkeypatch.setattr("raytwin.cli.app", lambda *_, **__: [][1])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 70
    assert "IndexError" in capsys.readouterr().err
