"""Pixels to rays, against OpenCV."""

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from raytwin.fast.boxes import field_of_view
from raytwin.fast.frame import newton_steps
from raytwin.scene import Camera
from raytwin.scene.lens import distort, inverse
from raytwin.scene.scene_files import read_scene
from raytwin.tracer import back_project, undistort
from raytwin.tracer.pixel_to_ray import to_board


def reals(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def cameras(draw, distorted: bool = True) -> Camera:
    """Cameras of any place, turn and lens whose distortion can be inverted over the frame."""
    w, h = draw(st.integers(50, 4000)), draw(st.integers(50, 4000))
    f = draw(reals(0.6, 3)) * max(w, h)
    K = (
        (f, 0.0, draw(reals(0.4, 0.6)) * w),
        (0.0, f * draw(reals(0.9, 1.1)), draw(reals(0.4, 0.6)) * h),
        (0.0, 0.0, 1.0),
    )
    R = cv2.Rodrigues(np.array([draw(reals(-3, 3)) for _ in range(3)]))[0]
    t = tuple(draw(reals(-2, 2)) for _ in range(3))
    bounds = (0.3, 0.1, 0.005, 0.005, 0.05)
    dist = tuple(draw(reals(-b, b)) for b in bounds[: draw(st.sampled_from([0, 1, 2, 4, 5]))]) if distorted else ()
    camera = Camera((w, h), K, tuple(map(tuple, R.tolist())), t, dist)
    assume(field_of_view(camera) is not None)
    return camera


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


def opencv_undistort(camera: Camera, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(n, 2) by OpenCV's loop, given the steps that its default of 5 denies it."""
    # OpenCV 4 keeps the criteria to a function of their own.
    undistort_points = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-10)
    K, dist = np.asarray(camera.K), np.asarray(camera.coefficients)
    pixels = np.stack([u, v], axis=-1)[:, None]
    return undistort_points(pixels, K, dist, R=np.eye(3), P=np.eye(3), criteria=criteria).reshape(-1, 2)


@settings(max_examples=60, deadline=None)
@given(cameras())
def test_undistort_agrees_with_opencv_iterated_to_the_end(camera):
    u, v = pixels_of(camera)
    xd, yd = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    x, y = undistort(xd, yd, camera.coefficients, newton_steps(camera))
    np.testing.assert_allclose(undistort(xd, yd, camera.coefficients), (x, y), rtol=0, atol=1e-13)
    np.testing.assert_allclose(distort(x, y, camera.coefficients), (xd, yd), rtol=0, atol=5e-14)
    theirs = opencv_undistort(camera, u, v)
    # Their loop may stop short, or never converge: only where it round-trips is it a reference.
    again = distort(*theirs.T, camera.coefficients)
    good = np.hypot(again[0] - xd, again[1] - yd) * camera.fx < 1e-9
    assume(good.any())
    np.testing.assert_allclose(np.stack([x, y], axis=-1)[good], theirs[good], rtol=0, atol=1e-10)


@settings(max_examples=50, deadline=None)
@given(cameras(), st.integers(1, 500), st.integers(1, 500))
def test_a_resized_camera_keeps_the_rays_through_its_corners_and_its_middle(camera, width, height):
    small = camera.resized(width, height)
    assert small.image_size == (width, height)
    for a, b in ((0, 0), (0, 1), (1, 0), (1, 1), (0.5, 0.5)):
        there = back_project(a * camera.width - 0.5, b * camera.height - 0.5, camera)
        here = back_project(a * width - 0.5, b * height - 0.5, small)
        np.testing.assert_allclose(here, there, rtol=0, atol=1e-12)


def test_the_rays_of_a_known_camera_point_where_they_should(single):
    # It looks straight down on the board: the image's right is the board's right, its top the board's +y.
    camera = single.camera
    np.testing.assert_allclose(to_board(back_project(319.5, 239.5, camera), camera), (0, 0, -1), atol=1e-16)
    right, top = (to_board(back_project(*at, camera), camera) for at in ((1119.5, 239.5), (319.5, 239.5 - 800)))
    np.testing.assert_allclose(right, np.array([1, 0, -1]) / 2**0.5, atol=1e-15)
    np.testing.assert_allclose(top, np.array([0, 1, -1]) / 2**0.5, atol=1e-15)
    assert camera.eye == pytest.approx((0, 0, 0.45))


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


REAL = {
    "april_fine": ((1000, 1333), (1019.11, 1018.80, 506.46, 664.29), (0.20098, -0.92751, 7.41e-4, -3.52e-4, 1.26708)),
    "desk_tilted": ((4032, 3024), (2944.56, 2927.88, 1991.72, 1658.76), (0.19585, -1.13457, 0.00622, 5.88e-4, 2.16731)),
    "desk_degenerate": (
        (4032, 3024),
        (3050.48, 3030.40, 2010.24, 1502.67),
        (0.21919, -1.38252, 7.35e-4, 0.00137, 3.02485),
    ),
}
"""Real lenses: (image size, (fx, fy, cx, cy), dist) of three published sets of photos, five coefficients fitted."""


@pytest.mark.parametrize("name", REAL)
def test_a_real_lens_is_undone_from_the_middle_of_the_frame_to_its_corners(name):
    """There and back again to rounding, to before any fold. OpenCV's five steps
    are pixels off at a corner."""
    (w, h), (fx, fy, cx, cy), dist = REAL[name]
    u, v = np.array([(0, 0), (w - 1, 0), (0, h - 1), (w - 1, h - 1)]).T
    for way in np.linspace(0.1, 1, 10):
        xd, yd = way * (u - cx) / fx, way * (v - cy) / fy
        *ideal, found = inverse(xd, yd, dist)
        assert found.all()
        x, y = undistort(xd, yd, dist)
        np.testing.assert_allclose((x, y), ideal, rtol=0, atol=1e-12)
        np.testing.assert_allclose(distort(x, y, dist), (xd, yd), rtol=0, atol=1e-14)


def test_another_grid_of_pixels_sees_what_lies_there(scenes):
    """Beside the pixel by a part of one; every third of every third row; and a pixel more all round."""
    camera = read_scene(scenes / "distorted").camera
    for grid, (x, y) in (
        (camera.grid(0.25, -0.5), (10.25, 19.5)), (camera.every(3), (30.0, 60.0)), (camera.grid(-1, -1), (9.0, 19.0)),
    ):  # fmt: skip
        np.testing.assert_allclose(back_project(10.0, 20.0, grid), back_project(x, y, camera), rtol=0, atol=1e-9)
    assert camera.grid().image_size == (800, 600)
    assert camera.every(7).image_size == (115, 86)
