"""Two cameras compared by where they project."""

import math

import cv2
import msgspec
import numpy as np
import pytest
import scipy.optimize
from photo_helpers import BOARD, SMALL, a_camera
from test_trust import SIZE, views

from raytwin import files
from raytwin.calib.boards import write_board
from raytwin.calib.photos import (
    calibrate_detections,
    camera_at,
    deviations,
    lens_model,
    projection_difference,
    read_board_shapes,
)
from raytwin.calib.photos.pose import Pose
from raytwin.calib.photos.uncertainty import cell_middles
from raytwin.cli.photo_commands import calibrate_command
from raytwin.errors import InputError


@pytest.fixture(scope="module")
def found():
    return calibrate_detections(views(noise=0.1)[2], SIZE, SMALL, "full5")


def other(found, **numbers):
    """The same camera, some of fx, fy, cx, cy changed."""
    (fx, _, cx), (_, fy, cy), _ = found.K
    n = {"fx": fx, "fy": fy, "cx": cx, "cy": cy} | numbers
    K = ((n["fx"], 0.0, n["cx"]), (0.0, n["fy"], n["cy"]), (0.0, 0.0, 1.0))
    pose = Pose(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 0.0, 1.0), 0.0)
    return msgspec.structs.replace(camera_at(found, pose), K=K)


def test_a_camera_does_not_differ_from_itself(found):
    apart = projection_difference(found, other(found))
    assert max(apart.worst, apart.turn_degrees, apart.shift_metres) < 1e-6
    assert apart.distance == found.basis.distance


def test_a_moved_centre_is_a_camera_moved_aside_and_a_longer_focal_length_a_step_back(found):
    """cx off by 5 px is a shift by 5 / fx of the points' distance; f off by 1 % one by 1 % of it."""
    (fx, _, cx), (_, fy, _), _ = found.K
    moved = projection_difference(found, other(found, cx=cx + 5))
    assert moved.shift_metres == pytest.approx(5 / fx * moved.distance, rel=0.2)
    assert moved.median < 0.6
    longer = projection_difference(found, other(found, fx=1.01 * fx, fy=1.01 * fy))
    assert longer.shift_metres == pytest.approx(0.01 * longer.distance, rel=0.5)
    assert longer.median < longer.p95 < longer.worst < 0.01 * math.hypot(*SIZE) / 2


def test_the_turn_and_shift_are_those_of_least_weighted_squares(found):
    """By SciPy's least squares on OpenCV's projectPoints, with weights of one over the deviations."""
    second = other(found, cx=found.K[0][2] + 3, fx=1.003 * found.K[0][0])
    pixels, _ = cell_middles(found.image_size)
    rays = np.c_[lens_model.undistort(pixels, found.K, found.dist), np.ones(len(pixels))]
    rays *= found.basis.distance / np.linalg.norm(rays, axis=1, keepdims=True)
    weight = 1 / deviations(found, pixels, found.basis.distance)[:, None]
    K, dist = np.array(second.K), np.array(second.coefficients)

    def off(x: np.ndarray) -> np.ndarray:
        return cv2.projectPoints(rays, x[:3], x[3:], K, dist)[0][:, 0] - pixels

    best = scipy.optimize.least_squares(lambda x: (off(x) * weight).ravel(), np.zeros(6), xtol=1e-12, ftol=1e-12).x
    apart, left = projection_difference(found, second), np.linalg.norm(off(best), axis=1)
    assert (apart.median, apart.p95, apart.worst) == pytest.approx(np.quantile(left, (0.5, 0.95, 1)), abs=1e-4)
    assert apart.turn_degrees == pytest.approx(math.degrees(np.linalg.norm(best[:3])), rel=1e-3)
    assert apart.shift_metres == pytest.approx(np.linalg.norm(best[3:]), rel=1e-3)


def test_a_camera_of_another_size_is_refused(found):
    with pytest.raises(InputError, match=r"--against: expected a camera of 1008 x 756 pixels, got 500 x 400"):
        projection_difference(found, a_camera(500, 400))


def test_calibrate_compares_with_another_camera_and_writes_one_with_its_boards_shape(shoot, tmp_path, capsys):
    photos = sorted(shoot(14, bend=3e-3)[0].glob("*.jpg"))
    write_board(tmp_path / "board.toml", BOARD)
    files.write_camera(tmp_path / "true.toml", a_camera(*SIZE))
    made = tmp_path / "camera.toml"
    calibrate_command(photos, [tmp_path / "board.toml"], model="k1k2", out=made, against=tmp_path / "true.toml")
    said = capsys.readouterr().out
    assert "against the other camera at 0." in said
    assert float(said.split("median ")[1].split(" px")[0]) < 0.2
    (shape,) = read_board_shapes(made)
    assert shape.board == BOARD.digest
