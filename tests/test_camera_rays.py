"""OpenCV's camera for others' renderers: rays and a Mitsuba sensor, beside cv2's own projection."""

import cv2
import numpy as np
import pytest

import raytwin
from raytwin import twin
from raytwin.errors import InputError, MachineError
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


@pytest.mark.parametrize("dist", [(), STRONG[:2], STRONG], ids=len)
def test_a_point_on_each_ray_is_projected_into_its_pixel_by_opencv(dist):
    camera = camera_of(dist)
    rays = raytwin.camera_rays(camera)
    assert rays.directions.shape == (120, 160, 3)
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=-1), 1, rtol=1e-15)
    at = seen_by_cv2(camera, rays.origin + 0.7 * rays.directions.reshape(-1, 3)).reshape(120, 160, 2)
    u, v = np.meshgrid(np.arange(160), np.arange(120))
    np.testing.assert_allclose(at, np.stack([u, v], axis=-1), atol=1e-8)


def test_other_places_and_the_cameras_own_frame():
    camera, places = camera_of(), np.random.default_rng(3).uniform((-0.5, -0.5), (159.5, 119.5), (40, 2))
    board, own = raytwin.camera_rays(camera, places), raytwin.camera_rays(camera, places, frame="camera")
    np.testing.assert_allclose(seen_by_cv2(camera, board.origin + board.directions), places, atol=1e-8)
    np.testing.assert_allclose(own.directions, board.directions @ np.transpose(camera.R_cam_board), atol=1e-14)
    assert own.origin.tolist() == [0, 0, 0]
    with pytest.raises(InputError, match="places"):
        raytwin.camera_rays(camera, [1.0, 2.0, 3.0])


def test_where_the_lens_folds_back_there_is_no_ray():
    folded = camera_of((-0.15, 0.0), 1.0).with_(K=((84.0, 0.0, 40.0), (0.0, 84.0, 58.3), (0.0, 0.0, 1.0)))
    with pytest.warns(UserWarning, match="no ray belongs"):
        d = raytwin.camera_rays(folded).directions
    lost = np.isnan(d).any(axis=-1)
    assert 0.01 < lost.mean() < 0.5
    assert not lost[58, 40]


@pytest.fixture
def mi():
    try:
        twin.activate("llvm_ad_rgb")
    except MachineError as error:
        pytest.skip(f"llvm_ad_rgb does not work here: {error.got}")
    import mitsuba

    return mitsuba


@pytest.mark.parametrize(("dist", "aspect", "kind"), [((), 1.0, "perspective"), ((), 1.02, "raytwin_lens"),
                                                      (STRONG, 1.0, "raytwin_lens")])  # fmt: skip
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_the_sensor_sees_each_point_where_opencv_projects_it(mi, dist, aspect, kind, unit):
    """A wall's points, as a Mitsuba scene in metres or millimetres renders them: within half a pixel of its pixel, and
    without a shift (the mean of 16 x 19200 places in a pixel: 0.0006 px)."""
    camera = camera_of(dist, aspect)
    sensor = raytwin.mitsuba_sensor(camera, samples=16, unit=unit)
    assert sensor["type"] == kind
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


def test_a_scalar_variant_refuses_a_lens(mi):
    before = mi.variant()
    mi.set_variant("scalar_rgb")
    try:
        with pytest.raises(InputError, match="no distortion"):
            raytwin.mitsuba_sensor(camera_of())
        assert raytwin.mitsuba_sensor(camera_of((), 1.0))["type"] == "perspective"
    finally:
        mi.set_variant(before)
