"""camera.toml carries the bent board that it was calibrated with, and lends its shape to that board alone."""

from types import SimpleNamespace

import msgspec
import pytest
from photo_helpers import BOARD, SMALL, a_camera

from raytwin.cli.photo_commands import calibrate_command
from raytwin.errors import InputError
from raytwin.photos.boards import Grid, write_board
from raytwin.photos.camera import camera_at, detect_photo, pose_of_tags, with_shape, write_camera_file
from raytwin.scene.scene_files import read_camera
from raytwin.study import augment_photos

BENT = msgspec.structs.replace(SMALL, offsets=tuple((0.0, 1e-5, 1e-4 * i) for i in range(35)))


@pytest.mark.nightly
def test_augment_uses_the_boards_shape_in_the_camera_file(shoot, bent_found, scenes, tmp_path, monkeypatch):
    """A sheet bent by 3 mm: with its shape the tags lie where calibrate found them, taken for flat they do not."""
    view = bent_found.views[3]
    photo = shoot(14, bend=3e-3)[0] / view.photo
    write_board(tmp_path / "board.toml", BOARD)
    write_camera_file(tmp_path / "c.toml", camera_at(bent_found, view), bent_found.evidence.board)
    (tmp_path / "out").mkdir()
    for name in ("fast_engine", "augment"):  # what is drawn is another test's
        monkeypatch.setattr(augment_photos, name, lambda pixels, *_, **__: SimpleNamespace(pixels=pixels))
    monkeypatch.setattr(augment_photos.twin, "chosen", lambda: SimpleNamespace(variant=""))
    (row,) = augment_photos.augment_photos(
        [photo], scenes / "desk", tmp_path / "out", camera=tmp_path / "c.toml", board=tmp_path / "board.toml"
    )
    assert row["pose_rms_px"] == pytest.approx(view.rms_px, rel=0.01)
    assert pose_of_tags(bent_found.K, bent_found.dist, detect_photo(photo), BOARD).rms_px > 3 * row["pose_rms_px"]


def test_the_file_gives_the_same_camera_back_and_its_shape_to_the_same_board_alone(tmp_path):
    file = tmp_path / "c.toml"
    write_camera_file(file, a_camera(), BENT)
    assert read_camera(file) == a_camera()
    assert with_shape(SMALL, file) == BENT
    for changes in (
        {"grid": Grid(5, 7, 0.0380001)}, {"grid": Grid(5, 7, 0.038, 1)}, {"tag_edge": 0.0011}, {"family": "tag25h9"},
    ):  # fmt: skip
        other = msgspec.structs.replace(SMALL, **changes)
        assert with_shape(other, file) == other
    write_camera_file(file, a_camera(), SMALL)
    assert with_shape(SMALL, file) == SMALL


def test_a_shape_that_is_none_is_refused_with_its_place(tmp_path):
    file, head = tmp_path / "c.toml", '[board]\nfamily = "tag36h11"\ntag_edge = 0.001\n'
    grid = "grid = { columns = 5, rows = 7, pitch = 0.038 }\n"
    for text, said in (
        (
            head + grid + "offsets = [[0.0, 0.0, 0.0]]",
            "c.toml: board: offsets: expected one for each of 35 tags, got 1",
        ),
        (
            head + grid + "offsets = [[0.0, nan, 0.0]]",
            r"c.toml: board.offsets\[0\]\[1\]: expected a number, got",
        ),
        (head + "heights = 1", r"c.toml: board.heights is no known key"),
        ("board = 3", "c.toml: board: expected a table, got 3"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=said):
            with_shape(SMALL, file)


def test_calibrate_writes_the_camera_with_its_boards_shape(shoot, tmp_path):
    write_board(tmp_path / "board.toml", BOARD)
    photos = sorted(shoot(14, bend=3e-3)[0].glob("*.jpg"))
    calibrate_command(photos, [tmp_path / "board.toml"], model="k1k2", out=tmp_path / "camera.toml")
    assert with_shape(BOARD, tmp_path / "camera.toml").offsets is not None
    assert read_camera(tmp_path / "camera.toml").fx == pytest.approx(a_camera().fx, rel=1e-3)
