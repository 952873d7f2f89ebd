"""The records: immutable, and consistent with the conventions."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytwin.image import Image, Surface
from raytwin.scene import Camera, Plane, Scene, Sky, Sphere, Sun

CAMERA = Camera(
    (640, 480),
    ((800.0, 0.0, 310.0), (0.0, 790.0, 250.0), (0.0, 0.0, 1.0)),
    ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    (0.1, 0.2, 0.5),
    (-0.1, 0.02),
)


def test_records_cannot_be_changed():
    with pytest.raises(AttributeError):
        CAMERA.t_cam_board = (0.0, 0.0, 0.0)
    assert hash(CAMERA) == hash(msgspec.structs.replace(CAMERA))


def test_the_eye_is_where_the_camera_frame_begins():
    R, t = np.asarray(CAMERA.R_cam_board), np.asarray(CAMERA.t_cam_board)
    np.testing.assert_allclose(R @ CAMERA.eye + t, 0, atol=1e-16)
    assert all(type(c) is float for c in CAMERA.eye)


def test_missing_coefficients_are_zero():
    assert CAMERA.coefficients == (-0.1, 0.02, 0, 0, 0)
    assert msgspec.structs.replace(CAMERA, dist=()).coefficients == (0,) * 5


@given(st.integers(1, 5000), st.integers(1, 5000))
def test_resizing_keeps_corners_and_is_undone_by_resizing_back(width, height):
    small = CAMERA.resized(width, height)
    sx, sy = width / 640, height / 480
    # The corner at -1/2 stays at -1/2, the opposite one at W - 1/2 goes to the new W - 1/2, on the same rays.
    assert (-0.5 - small.cx) / small.fx == pytest.approx((-0.5 - CAMERA.cx) / CAMERA.fx, rel=1e-12)
    assert (width - 0.5 - small.cx) / small.fx == pytest.approx((639.5 - CAMERA.cx) / CAMERA.fx, rel=1e-12)
    assert (height - 0.5 - small.cy) / small.fy == pytest.approx((479.5 - CAMERA.cy) / CAMERA.fy, rel=1e-12)
    assert (small.fx, small.fy) == (800 * sx, 790 * sy)
    np.testing.assert_allclose(small.resized(640, 480).K, CAMERA.K, rtol=1e-12, atol=1e-12)
    assert (small.dist, small.R_cam_board, small.t_cam_board) == (CAMERA.dist, CAMERA.R_cam_board, CAMERA.t_cam_board)


@pytest.mark.parametrize("scale", [1e-300, 1e-3, 1, 1e300])
def test_the_suns_direction_is_a_unit_vector_whatever_the_length_given(scale):
    d = Sun((3 * scale, 0.0, 4 * scale)).direction
    assert d == pytest.approx((0.6, 0, 0.8), rel=1e-15)
    assert all(type(c) is float for c in d)


def test_a_planes_normal_is_perpendicular_and_follows_the_right_hand():
    plane = Plane((1.0, 2.0, 3.0), (2.0, 0.0, 0.0), (0.0, 0.3, 0.4))
    assert plane.normal == pytest.approx((0, -0.8, 0.6))
    assert math.hypot(*plane.normal) == pytest.approx(1, rel=1e-15)


def test_ids_count_spheres_and_then_planes():
    a, b, c = Sphere((0.0,) * 3, 1.0), Sphere((1.0,) * 3, 1.0), Plane((0.0,) * 3, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    scene = Scene("x", CAMERA, (a, b), (c,))
    assert scene.objects == (a, b, c)
    assert scene.with_camera(CAMERA.resized(10, 10)).camera.image_size == (10, 10)
    assert scene.sky == Sky((0.0, 0.0, 0.0))
    assert scene.sun.irradiance == (0, 0, 0)


def test_a_surfaces_mask_is_where_an_object_is_seen():
    ids = np.array([[-1, 0], [3, -1]], np.int32)
    surface = Surface(ids, np.zeros((2, 2), np.float32), np.zeros((2, 2, 3), np.float32))
    np.testing.assert_array_equal(surface.mask, [[False, True], [True, False]])
    assert Image(np.zeros((2, 2, 3), np.float32), surface=surface).shape == (2, 2, 3)
