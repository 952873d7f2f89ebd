"""camera.toml carries the shape of the board it was calibrated with, and lends it to that board alone."""

from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from photo_helpers import BOARD, SMALL, a_camera

from raytwin.cli.photo_commands import calibrate_command
from raytwin.errors import InputError
from raytwin.photos.boards import Board, BoardTag, Grid, write_board
from raytwin.photos.camera import (
    camera_at,
    pose_of_photo,
    read_board_shapes,
    with_shape,
    write_camera_file,
)
from raytwin.scene.scene_files import read_camera, write_camera
from raytwin.study import augment_photos

BENT = msgspec.structs.replace(SMALL, offsets=tuple((0.0, 1e-5, 1e-4 * i) for i in range(35)))


@pytest.mark.nightly
def test_augment_uses_the_boards_shape_in_the_camera_file(shoot, bent_found, scenes, tmp_path, monkeypatch):
    """A sheet bent by 3 mm: with its shape the tags lie where calibrate found them, taken for flat they do not."""
    photo = shoot(14, bend=3e-3)[0] / bent_found.views[3].photo
    write_board(tmp_path / "board.toml", BOARD)
    report = pose_of_photo(bent_found, photo, BOARD)
    write_camera_file(tmp_path / "c.toml", camera_at(bent_found, report.refined), bent_found.basis.board)
    (tmp_path / "out").mkdir()
    for name in ("fast_engine", "augment"):  # what is drawn is another test's
        monkeypatch.setattr(augment_photos, name, lambda pixels, *_, **__: SimpleNamespace(pixels=pixels))
    monkeypatch.setattr(augment_photos.twin, "chosen", lambda: SimpleNamespace(variant=""))
    (row,) = augment_photos.augment_photos(
        [photo], scenes / "desk", tmp_path / "out", camera=tmp_path / "c.toml", board=tmp_path / "board.toml"
    )
    assert row["pose_rms_px"] == pytest.approx(report.refined.rms_px, rel=0.01)
    flat = msgspec.structs.replace(bent_found, evidence=None)
    assert pose_of_photo(flat, photo, BOARD).refined.rms_px > 3 * row["pose_rms_px"]


def test_the_file_gives_the_same_camera_and_the_same_board_back(tmp_path):
    write_camera_file(tmp_path / "c.toml", a_camera(), BENT)
    assert read_camera(tmp_path / "c.toml") == a_camera()
    shapes = read_board_shapes(tmp_path / "c.toml")
    assert with_shape(SMALL, shapes) == BENT
    as_tags = Board(SMALL.family, SMALL.tag_edge, tags=tuple(BoardTag(i, xy) for i, xy in SMALL.centers().items()))
    assert with_shape(as_tags, shapes).offsets == BENT.offsets
    np.testing.assert_array_equal(with_shape(as_tags, shapes).points(range(35)), BENT.points(range(35)))

    # Another board does not get the shape.
    for changes in (
        *({"grid": grid} for grid in (Grid(5, 7, 0.0380001), Grid(5, 7, 0.038, 1), Grid(5, 7, 0.038, order="down"))),
        {"tag_edge": 0.0011},
        {"family": "tag25h9"},
    ):
        other = msgspec.structs.replace(SMALL, **changes)
        assert with_shape(other, shapes) == other


def test_a_camera_file_without_shapes_still_reads(tmp_path):
    write_camera(tmp_path / "old.toml", a_camera())
    write_camera_file(tmp_path / "flat.toml", a_camera(), SMALL)
    assert (tmp_path / "old.toml").read_text() == (tmp_path / "flat.toml").read_text()
    assert read_board_shapes(tmp_path / "old.toml") == ()


def test_a_shape_that_is_none_is_refused_with_its_place(tmp_path):
    file, head = tmp_path / "c.toml", f'[[boards]]\nboard = "{SMALL.digest}"\n'
    for text, said in (
        (
            head + "offsets = [[0.0, 0.0, 0.0]]",
            "^boards: offsets: expected three finite numbers for each of 35 tags, got 1",
        ),
        (head + "offsets = [[0.0, 0.0]]", r"c.toml: boards\[0\].offsets\[0\]: expected a list of length 3"),
        (head + "heights = 1", r"c.toml: boards\[0\]: expected offsets, .* got heights, removed in 0.2.0"),
        ("boards = 3", "c.toml: boards: expected a list, got 3"),
        ("boards = [3]", r"c.toml: boards\[0\]: expected a table, got 3"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=said):
            with_shape(SMALL, read_board_shapes(file))


def test_calibrate_writes_the_camera_with_its_boards_shape(shoot, tmp_path):
    write_board(tmp_path / "board.toml", BOARD)
    photos = sorted(shoot(14, bend=3e-3)[0].glob("*.jpg"))
    calibrate_command(photos, [tmp_path / "board.toml"], model="k1k2", out=tmp_path / "camera.toml")
    (shape,) = read_board_shapes(tmp_path / "camera.toml")
    assert shape.board == BOARD.digest
    assert read_camera(tmp_path / "camera.toml").fx == pytest.approx(a_camera().fx, rel=1e-3)
