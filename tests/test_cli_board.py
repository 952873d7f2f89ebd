"""`raytwin photo board` as a user meets it."""

import shutil

from photo_helpers import BOARD
from program import raytwin, refused

from raytwin.photos.boards import read_board

GRID = ("photo", "board", "--columns", 3, "--rows", 4, "--tag", "30mm", "--pitch", "38mm")


def test_a_wrong_board_is_one_line_and_nothing_is_written(subtests, tmp_path):
    for arguments, parts in (
        (("--paper", "a3"), ("--paper", "a4, letter", "got a3")),
        (("--rows", 8), ("--paper", "a4, too small for 116 mm x 316.75 mm")),
        (("--tag", "30"), ("--tag", "with its unit", "30")),
        (("--columns", 40, "--rows", 15), ("ids up to 586", "599")),
        (("--family", "tag25h9"), ("--family` was removed in 0.2.0", "board.toml")),
        (("--columns", 0), ("--columns", "from 1", "0")),
        (("--margin", "9mm"), ("--margin` was removed in 0.2.0", "5 mm")),
        (("-o", "board.png"), ("board.png", ".pdf")),
    ):
        with subtests.test(str(arguments)):
            refused(raytwin(*GRID, "-o", "board.pdf", *arguments, cwd=tmp_path), *parts)
            assert not list(tmp_path.iterdir())


def test_without_options_it_is_a_board_that_a4_holds_and_photos_beside_it_are_calibrated_with_it(shoot, tmp_path):
    run = raytwin("photo", "board", "--paper", "A4", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "35 tags on a4" in run.stdout
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF-")
    assert read_board(tmp_path / "board.toml") == BOARD
    photos = tmp_path / "photos"
    photos.mkdir()
    for i in range(4):
        shutil.copy(shoot()[0] / f"photo_0{i}.jpg", photos)
    run = raytwin("photo", "calibrate", "photos", "--model", "k1k2", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "board.toml" in run.stdout.splitlines()[0]
    (tmp_path / "board.toml").unlink()
    refused(raytwin("photo", "calibrate", "photos", cwd=tmp_path), "--board", "no board.toml lies beside the photos")
