"""Pixels to rays, against OpenCV."""

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_of import cameras, reals

from raytwin.fast.frame import newton_steps
from raytwin.scene import Camera
from raytwin.scene.lens import distort
from raytwin.scene.scene_files import read_scene
from raytwin.tracer import back_project, undistort
from raytwin.tracer.pixel_to_ray import to_board


def pixels_of(camera: Camera, n: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """Points all over the frame, its edges included."""
    u, v = np.meshgrid(np.linspace(-0.5, camera.width - 0.5, n), np.linspace(-0.5, camera.height - 0.5, n))
    return u.ravel(), v.ravel()


@settings(max_examples=100, deadline=None)
@given(cameras(), reals(0.1, 10))
def test_opencv_projects_a_point_of_the_ray_back_onto_the_pixel(camera, distance):
    u, v = pixels_of(camera)
    d = np.stack(back_project(u, v, camera), axis=-1)
    points = np.asarray(camera.eye) + distance * np.stack(to_board(tuple(d.T), camera), axis=-1)
    K, dist = np.asarray(camera.K), np.asarray(camera.coefficients)
    # In the camera's frame already: OpenCV's rotation vector would lose a turn of 1e-10.
    seen = points @ np.asarray(camera.R_cam_board).T + np.asarray(camera.t_cam_board)
    found = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), K, dist)[0].reshape(-1, 2)
    np.testing.assert_allclose(found, np.stack([u, v], axis=-1), rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(d, axis=-1), 1, rtol=1e-14)


@settings(max_examples=50, deadline=None)
@given(cameras(), st.integers(1, 500), st.integers(1, 500))
def test_a_resized_camera_keeps_the_rays_through_its_corners_and_its_middle(camera, width, height):
    small = camera.resized(width, height)
    assert small.image_size == (width, height)
    for a, b in ((0, 0), (0, 1), (1, 0), (1, 1), (0.5, 0.5)):
        there = back_project(a * camera.width - 0.5, b * camera.height - 0.5, camera)
        here = back_project(a * width - 0.5, b * height - 0.5, small)
        np.testing.assert_allclose(here, there, rtol=0, atol=1e-12)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_no_fewer_steps_of_newtons_undo_a_phones_lens(single, precision):
    """As many as are counted come back to rounding at every pixel of its sides, and one fewer does not."""
    enough = {"float32": 2e-8, "float64": 2e-14}[precision]
    wide = single.camera.resized(4032, 3024)
    K = ((2917.0, 0.0, 2016.0), (0.0, 2907.0, 1500.0), (0.0, 0.0, 1.0))
    assert newton_steps(wide, precision) == 0
    xd, yd = (np.array([(0, 4031), (0, 3023)]) - [[2016], [1500]]) / [[2917], [2907]]
    for dist in ((0.1, -0.2, 0.001, -0.0005, 0.05), (0.17, -0.55, 0.0008, -0.0003, 0.6), (-0.2, 0.05)):
        camera = msgspec.structs.replace(wide, K=K, dist=dist)
        steps = newton_steps(camera, precision)
        worst = []
        for n in (steps, steps - 1):
            back = distort(*undistort(xd, yd, camera.coefficients, n), camera.coefficients)
            worst.append(np.hypot(back[0] - xd, back[1] - yd).max())
        assert worst[0] < enough < worst[1]


def test_another_grid_of_pixels_sees_what_lies_there(scenes):
    """Beside the pixel by a part of one; every third of every third row; and a pixel more all round."""
    camera = read_scene(scenes / "distorted").camera
    for grid, (x, y) in (
        (camera.grid(0.25, -0.5), (10.25, 19.5)), (camera.every(3), (30.0, 60.0)), (camera.grid(-1, -1), (9.0, 19.0)),
    ):  # fmt: skip
        np.testing.assert_allclose(back_project(10.0, 20.0, grid), back_project(x, y, camera), rtol=0, atol=1e-9)
    assert camera.grid().image_size == (800, 600)
    assert camera.every(7).image_size == (115, 86)
