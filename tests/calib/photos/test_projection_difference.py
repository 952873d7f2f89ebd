"""Two cameras compared by where they project, and a camera written for other programs and read back."""

import ast
import math

import cv2
import msgspec
import numpy as np
import pytest
import scipy.optimize
import yaml
from photo_helpers import BOARD, SMALL, a_camera
from test_trust import SIZE, views

from raytwin import files
from raytwin.calib.boards import write_board
from raytwin.calib.photos import (
    EXPORTS,
    calibrate_detections,
    camera_at,
    deviations,
    export_camera,
    lens_model,
    projection_difference,
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


@pytest.mark.parametrize("distance", [None, 0.3, math.inf])
def test_a_camera_does_not_differ_from_itself(found, distance):
    apart = projection_difference(found, other(found), distance)
    assert apart.worst < 1e-6
    assert apart.turn_degrees < 1e-6
    assert apart.distance == (found.basis.distance if distance is None else distance)


def test_a_moved_centre_is_a_turned_camera_and_little_else(found):
    """cx off by 5 px turns the camera by atan(5 / fx); without a turn every pixel were 5 px off."""
    apart = projection_difference(found, other(found, cx=found.K[0][2] + 5), math.inf)
    assert apart.turn_degrees == pytest.approx(math.degrees(math.atan(5 / found.K[0][0])), rel=0.2)
    assert apart.median < 0.6
    assert apart.shift_metres == 0


def test_a_longer_focal_length_is_a_shift_at_a_distance_and_shows_at_infinity(found):
    """f off by 1 %: at infinity the pixel at r from the middle moves by r / 100; on a sphere of points about the camera
    a step back undoes most of it."""
    (fx, _, _), (_, fy, _), _ = found.K
    longer = other(found, fx=1.01 * fx, fy=1.01 * fy)
    far, near = (projection_difference(found, longer, d) for d in (math.inf, 0.5))
    corner = math.hypot(*SIZE) / 2
    assert 0.5 < far.worst / (0.01 * corner) < 1.1
    assert near.median < 0.5 * far.median
    assert near.shift_metres == pytest.approx(0.005, rel=0.5)
    assert far.px.shape == near.px.shape == (47, 63)
    assert far.median < far.p95 < far.worst == pytest.approx(np.nanmax(far.px))


@pytest.mark.parametrize("distance", [math.inf, 0.5])
def test_the_turn_and_shift_are_those_of_least_weighted_squares(found, distance):
    """By SciPy's least squares on OpenCV's projectPoints, with weights of one over the deviations."""
    second = other(found, cx=found.K[0][2] + 3, fx=1.003 * found.K[0][0])
    pixels, _ = cell_middles(found.image_size)
    rays = np.c_[lens_model.undistort(pixels, found.K, found.dist), np.ones(len(pixels))]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    weight = 1 / deviations(found, pixels, distance)[:, None]
    n = 3 if math.isinf(distance) else 6

    def off(x: np.ndarray) -> np.ndarray:
        turn, shift = np.split(np.append(x, np.zeros(6 - n)), 2)
        return cv2.projectPoints(rays, turn, shift, np.array(second.K), np.array(second.coefficients))[0][:, 0] - pixels

    best = scipy.optimize.least_squares(lambda x: (off(x) * weight).ravel(), np.zeros(n), xtol=1e-12, ftol=1e-12).x
    apart = projection_difference(found, second, distance)
    np.testing.assert_allclose(apart.px.ravel(), np.linalg.norm(off(best), axis=1), atol=1e-4)
    assert apart.turn_degrees == pytest.approx(math.degrees(np.linalg.norm(best[:3])), rel=1e-3)


def test_a_camera_of_another_size_is_refused(found):
    with pytest.raises(InputError, match=r"--against: expected a camera of 1008 x 756 pixels, got 500 x 400"):
        projection_difference(found, a_camera(500, 400))


# ---------------------------------------------------------------------------------- other programs' files


def read_opencv(path):
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    size = store.getNode("image_width").real(), store.getNode("image_height").real()
    return size, store.getNode("camera_matrix").mat(), store.getNode("distortion_coefficients").mat().ravel()


def read_ros(path):
    read = yaml.safe_load(path.read_text())
    assert read["distortion_model"] == "plumb_bob"
    matrices = ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")
    K, dist, R, P = (np.reshape(read[m]["data"], (read[m]["rows"], read[m]["cols"])) for m in matrices)
    np.testing.assert_array_equal(P, np.c_[K @ R, np.zeros(3)])
    return (read["image_width"], read["image_height"]), K, dist.ravel()


def read_kalibr(path):
    read = yaml.safe_load(path.read_text())["cam0"]
    assert (read["camera_model"], read["distortion_model"]) == ("pinhole", "radtan")
    return read["resolution"], matrix(*read["intrinsics"]), [*read["distortion_coeffs"], 0]


def read_mrcal(path):
    """A .cameramodel is a Python literal."""
    read = ast.literal_eval(path.read_text())
    assert (read["lensmodel"], read["extrinsics"]) == ("LENSMODEL_OPENCV5", [0.0] * 6)
    return read["imagersize"], matrix(*read["intrinsics"][:4]), read["intrinsics"][4:]


def matrix(fx, fy, cx, cy):
    return [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]


READERS = {"opencv": read_opencv, "ros": read_ros, "kalibr": read_kalibr, "mrcal": read_mrcal}


@pytest.mark.parametrize("kind", EXPORTS)
def test_an_exported_camera_is_read_back_to_the_last_bit(found, tmp_path, kind):
    camera = msgspec.structs.replace(found, dist=(0.1, -2e-16, 1e-5, 3e-7)) if kind == "kalibr" else found
    export_camera(tmp_path / "c", camera, kind)
    size, K, dist = READERS[kind](tmp_path / "c")
    assert tuple(size) == found.image_size
    np.testing.assert_array_equal(K, found.K)
    np.testing.assert_array_equal(dist, [*camera.dist, *(0.0,) * (5 - len(camera.dist))])


def test_kalibr_gets_no_k3(found, tmp_path):
    with pytest.raises(InputError, match=r"c.yaml: expected a lens without k3"):
        export_camera(tmp_path / "c.yaml", found, "kalibr")
    assert not (tmp_path / "c.yaml").exists()


def test_an_ending_that_says_no_format_is_refused_and_so_is_an_unknown_format(found, tmp_path):
    with pytest.raises(InputError, match=r"--format"):
        export_camera(tmp_path / "c.txt", found)
    with pytest.raises(InputError, match=r"--format: expected one of opencv, ros, kalibr, mrcal"):
        export_camera(tmp_path / "c.yaml", found, "matlab")


def test_calibrate_compares_draws_and_exports(shoot, tmp_path, capsys):
    photos = sorted(shoot()[0].glob("*.jpg"))
    write_board(tmp_path / "board.toml", BOARD)
    files.write_camera(tmp_path / "true.toml", a_camera(*SIZE))
    calibrate_command(
        photos, [tmp_path / "board.toml"], against=tmp_path / "true.toml", difference=tmp_path / "d.svg",
        export=tmp_path / "c.cameramodel",
    )  # fmt: skip
    said = capsys.readouterr().out
    assert "against the other camera at 0." in said
    assert float(said.split("median ")[1].split(" px")[0]) < 0.2
    assert (tmp_path / "d.svg").read_text().startswith("<svg")
    assert "LENSMODEL_OPENCV5" in (tmp_path / "c.cameramodel").read_text()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"distance": 1.0}, "--against: expected a camera to compare with, got none"),
        ({"distance": -1.0, "against": "true.toml"}, "--distance: expected metres > 0, or inf, got -1"),
    ],
)
def test_options_that_make_no_sense_are_refused_before_any_photo_is_read(options, line, tmp_path):
    files.write_camera(tmp_path / "true.toml", a_camera(*SIZE))
    options = options | ({"against": tmp_path / "true.toml"} if "against" in options else {})
    with pytest.raises(InputError) as refused:
        calibrate_command([tmp_path / "missing.jpg"], [tmp_path / "missing.toml"], **options)
    assert str(refused.value) == line
