"""`raytwin board` as a user meets it."""

import os
import pickle

import pytest
from program import raytwin, refused

from raytwin.calib.boards import read_board

GRID = ("board", "--columns", 3, "--rows", 4, "--tag", "30mm", "--pitch", "38mm")


class Runs:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.system, (f"touch {self.path}",)


def test_board_writes_a_pdf_and_its_toml(tmp_path):
    run = raytwin(*GRID, "--paper", "letter", "--first-id", 9, "-o", tmp_path / "board.pdf")
    assert run.returncode == 0, run.stderr
    assert "12 tags on 215.9 x 279.4 mm" in run.stdout
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF-")
    board = read_board(tmp_path / "board.toml")
    assert board.family == "tag36h11"
    assert board.tag_edge == 0.03
    assert board.centers()[13] == (0.038, 0.038)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("--paper", "90mmx90mm"), ("--paper", "at least 124 mm x", "90 mm x 90 mm")),
        (("--pitch", "30mm"), ("--pitch", "at least 33.75 mm", "got 30 mm")),
        (("--tag", "30"), ("--tag", "30mm", "30 without a unit")),
        (("--first-id", 580), ("ids up to 586", "591")),
        (("--first-id", -1), ("--first-id", "from 0", "-1")),
        (("--columns", 0), ("--columns", "from 1", "0")),
        (("--margin", "1km"), ("--margin", "1km")),
        (("--family", "tag99"), ("--family", "tag36h11", "tag99")),
        (("--unit", "mm"), ("--unit", "without --import")),
        (("-o", "board.png"), ("board.png", ".pdf")),
    ],
)
def test_a_wrong_board_is_one_line_and_nothing_is_written(arguments, parts, tmp_path):
    refused(raytwin(*GRID, "-o", "board.pdf", *arguments, cwd=tmp_path), *parts)
    assert not list(tmp_path.iterdir())


def test_board_imports_a_pickle_by_name_and_lists_its_names(tmp_path):
    entries = [{"tag_family": "tag36h11", "tag_id": i, "center": [i % 2, i // 2, 0]} for i in range(4)]
    (tmp_path / "b.pickle").write_bytes(pickle.dumps({"coarse": entries, "fine": entries}))
    load = ("board", "--import", tmp_path / "b.pickle")
    refused(raytwin(*load, cwd=tmp_path), "--name", "coarse, fine")
    refused(raytwin(*load, "--name", "fine", "--tag", "0.8in", "-o", "b.toml", cwd=tmp_path), "--unit", "nothing")
    refused(raytwin(*load, "--name", "fine", "--rows", 3, cwd=tmp_path), "--rows", "with --import")
    run = raytwin(*load, "--name", "fine", "--unit", "inch", "--tag", "0.8in", "-o", "b.toml", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    board = read_board(tmp_path / "b.toml")
    assert board.tag_edge == 0.02032
    assert board.centers()[3] == (0.0254, 0.0254)


def test_a_hostile_pickle_runs_nothing_and_writes_nothing(tmp_path):
    (tmp_path / "b.pickle").write_bytes(pickle.dumps({"fine": [Runs(tmp_path / "ran")]}))
    run = raytwin(
        "board", "--import", "b.pickle", "--name", "fine", "--unit", "mm", "--tag", "1in", "-o", "b.toml", cwd=tmp_path
    )
    refused(run, "b.pickle", "plain data", "system")
    assert [p.name for p in tmp_path.iterdir()] == ["b.pickle"]
