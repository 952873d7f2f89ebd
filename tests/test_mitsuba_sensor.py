"""OpenCV's camera for others' Mitsuba scenes: a Mitsuba sensor, beside cv2's own projection."""

import cv2
import numpy as np
import pytest

import raytwin
from raytwin import twin
from raytwin.errors import InputError
from raytwin.scene import Camera

STRONG = (-0.22, 0.045, 0.0012, -0.0008, -0.0035)


def camera_of(dist: tuple[float, ...] = STRONG, aspect: float = 1.02) -> Camera:
    R, _ = cv2.Rodrigues(np.array([2.7, 0.3, -0.4]))
    K = ((84.0, 0.0, 80.9), (0.0, 84.0 * aspect, 58.3), (0.0, 0.0, 1.0))
    return Camera((160, 120), K, tuple(map(tuple, R.tolist())), (0.02, -0.05, 0.8), dist)


def seen_by_cv2(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Return where OpenCV projects points (n, 3) of the board's frame: (n, 2) pixels."""
    rotation, _ = cv2.Rodrigues(np.array(camera.R_cam_board))
    t, K, dist = (np.array(a, float) for a in (camera.t_cam_board, camera.K, camera.coefficients))
    return cv2.projectPoints(points.reshape(-1, 1, 3), rotation, t, K, dist)[0][:, 0]


@pytest.fixture
def mi():
    twin.activate("llvm_ad_rgb")
    import mitsuba

    return mitsuba


@pytest.mark.parametrize(("dist", "aspect"), [((), 1.0), ((), 1.02), (STRONG, 1.0)])
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_the_sensor_sees_each_point_where_opencv_projects_it(mi, dist, aspect, unit):
    """A wall's points, as a Mitsuba scene in metres or millimetres renders them: within half a pixel of its pixel, and
    without a shift (the mean of 16 x 19200 places in a pixel: 0.0006 px)."""
    camera = camera_of(dist, aspect)
    sensor = raytwin.mitsuba_sensor(camera, samples=16, unit=unit)
    wall = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale([50 * unit, 50 * unit, 1])}
    world = {"type": "scene", "wall": wall, "sensor": sensor, "integrator": {"type": "aov", "aovs": "at:position"}}
    points = np.array(mi.render(mi.load_dict(world)), float)[..., -3:] / unit
    at = seen_by_cv2(camera, points.reshape(-1, 3)).reshape(120, 160, 2)
    u, v = np.meshgrid(np.arange(160), np.arange(120))
    off = at - np.stack([u, v], axis=-1)
    # A pixel's mean place on a slanted wall is not its centre's; half a pixel bounds it.
    assert np.abs(off).max() < 0.5
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.01


def test_a_crop_sees_its_part_of_the_frame(mi):
    camera = camera_of()
    sensor = raytwin.mitsuba_sensor(camera)
    sensor["film"] |= {"crop_width": 20, "crop_height": 10, "crop_offset_x": 40, "crop_offset_y": 25}
    made = mi.load_dict(sensor)
    ray, _ = made.sample_ray(0.0, 0.5, mi.Point2f(0.25, 0.5), mi.Point2f(0.0), True)
    point = np.array(ray.o).ravel() + np.array(ray.d).ravel()
    place = np.array([0.25, 0.5]) * (20, 10) + (40, 25) - 0.5
    np.testing.assert_allclose(seen_by_cv2(camera, point), place[None], atol=1e-3)


def test_a_scalar_variant_refuses_it(mi):
    before = mi.variant()
    mi.set_variant("scalar_rgb")
    try:
        with pytest.raises(InputError, match="written in Python, got scalar_rgb"):
            raytwin.mitsuba_sensor(camera_of())
    finally:
        mi.set_variant(before)
