"""[camera] look_at in a scene.toml is a camera that stands at eye and sees target in its middle."""

import math

import numpy as np
import pytest

from raytwin.errors import InputError
from raytwin.scene.scene_files import read_scene

VIEW = "{ eye = [3, -4, 2], target = [1, 0.5, 0.25], fov_x = 50 }"


def read(folder, look_at, more=""):
    (folder / "scene.toml").write_text(f"[camera]\nimage_size = [101, 81]\nlook_at = {look_at}\n{more}")
    return read_scene(folder).camera


def pixel(camera, point):
    x, y, z = np.asarray(camera.R_cam_board) @ np.asarray(point, float) + np.asarray(camera.t_cam_board)
    assert z > 0
    return camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy


def test_the_target_is_in_the_middle_up_is_up_and_the_field_of_view_is_as_wide_as_asked(tmp_path):
    camera = read(tmp_path, VIEW)
    assert pixel(camera, (1, 0.5, 0.25)) == pytest.approx((50, 40), abs=1e-12)
    u, v = pixel(camera, (1, 0.5, 0.35))
    assert u == pytest.approx(50, abs=1e-9)  # z is up, and the camera is not rolled
    assert v < 40
    assert camera.eye == pytest.approx((3, -4, 2), abs=1e-12)
    # Half of the image's width, to the outer edge of its last pixel, under half of the angle.
    assert math.degrees(2 * math.atan(101 / 2 / camera.fx)) == pytest.approx(50, abs=1e-12)
    assert camera.fx == camera.fy
    assert np.linalg.det(camera.R_cam_board) == pytest.approx(1, abs=1e-12)


def test_up_may_be_any_direction(tmp_path):
    camera = read(tmp_path, "{ eye = [0, 0, 5], target = [0, 0, 0], up = [0, 2, 0], fov_x = 90 }", "dist = [0.1]")
    assert (camera.fx, camera.dist) == (pytest.approx(50.5), (0.1,))
    u, v = pixel(camera, (1, 1, 0))  # seen from above: x to the right, y up
    assert (u, v) == pytest.approx((50 + 10.1, 40 - 10.1), abs=1e-12)


@pytest.mark.parametrize(
    ("look_at", "more", "parts"),
    [
        ("{ eye = [0, 0, 5], target = [0, 0, 5], fov_x = 9 }", "", ("camera.look_at.target", "another point than eye")),
        ("{ eye = [0, 0, 5], target = [0, 0, 0], fov_x = 9 }", "", ("camera.look_at.up", "does not look along")),
        ("{ eye = [0, 0, 5], target = [1, 0, 0], up = [0, 0, 0], fov_x = 9 }", "", ("camera.look_at.up",)),
        ("{ eye = [0, 0, 5], target = [1, 0, 0] }", "", ("camera.look_at.fov_x is missing",)),
        ("{ eye = [0, 0, 5], target = [1, 0, 0], fov_x = 180 }", "", ("camera.look_at.fov_x",)),
        (VIEW, "t_cam_board = [0, 0, 1]", ("camera.t_cam_board is no known key",)),
    ],
)
def test_bad_input_is_named(tmp_path, look_at, more, parts):
    with pytest.raises(InputError) as refused:
        read(tmp_path, look_at, more)
    for part in (str(tmp_path / "scene.toml"), *parts):
        assert part in str(refused.value)
