import cv2
import msgspec
import numpy as np
import pytest
from scene_of import changed, scene_of

from raytwin.scene import Sphere
from raytwin.scene.lens import without_ray
from raytwin.scene.scene_files import read_scene
from raytwin.twin import render
from raytwin.twin.opencv_sensor import lens_at

STRAIGHT = tuple(map(tuple, np.eye(3).tolist()))
LENSES = [(), (-0.22, 0.045), (0.1, -0.05, 0.002, -0.003), (-0.22, 0.045, 0.0012, -0.0008, -0.0035)]


@pytest.mark.parametrize("dist", LENSES)
def test_opencv_projects_every_ray_back_to_its_pixel(scenes, compiled, dist):
    import mitsuba as mi
    from drjit.llvm import Float64

    camera = msgspec.structs.replace(read_scene(scenes / "distorted").camera, dist=dist, R_cam_board=STRAIGHT)
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(-0.5, 799.5, 40), np.linspace(-0.5, 599.5, 30)))
    eye = mi.load_dict(lens_at(camera, np.zeros(3)))
    d = np.stack([axis.numpy() for axis in eye.direction(Float64(u), Float64(v))], axis=1)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, rtol=1e-14)
    found, _ = cv2.projectPoints(d, np.zeros(3), np.zeros(3), np.array(camera.K), np.array(camera.coefficients))
    np.testing.assert_allclose(found[:, 0], np.stack([u, v], axis=1), atol=1e-7)


def test_small_spheres_stand_where_opencv_projects_them(scenes, compiled):
    camera = read_scene(scenes / "distorted").camera
    x, y = np.meshgrid(np.linspace(-0.22, 0.22, 5), np.linspace(-0.16, 0.16, 4))
    centers = np.stack([x.ravel(), y.ravel(), 0.05 * np.sin(20 * x.ravel())], axis=1)
    scene = scene_of("dots", camera, tuple(Sphere(tuple(c), 0.003) for c in centers.tolist()))
    rotation, _ = cv2.Rodrigues(np.array(camera.R_cam_board))
    K, dist = np.array(camera.K), np.array(camera.coefficients)
    expected, _ = cv2.projectPoints(centers, rotation, np.array(camera.t_cam_board), K, dist)
    ideal, _ = cv2.projectPoints(centers, rotation, np.array(camera.t_cam_board), K, None)
    assert abs(expected - ideal).max() > 40  # the lens does something
    ids = render(scene, "surface").surface.ids
    for i, (u, v) in enumerate(expected[:, 0]):
        rows, columns = np.nonzero(ids == i)
        assert columns.mean() == pytest.approx(u, abs=0.25)
        assert rows.mean() == pytest.approx(v, abs=0.25)


@pytest.mark.filterwarnings("ignore::raytwin.scene.lens.Folds")
@pytest.mark.parametrize("rung", ["shadow", "path"])
def test_past_where_a_lens_folds_over_the_twin_is_black_and_meets_nothing(scenes, compiled, rung):
    scene = read_scene(scenes / "single")
    camera = msgspec.structs.replace(scene.camera, dist=(-1.3,)).resized(80, 60)
    sphere = msgspec.structs.replace(scene.objects[0], radius=0.2)
    made = render(changed(scene, camera=camera, objects=(sphere,)), rung, samples=4, cache=False)
    lost = without_ray(camera)
    assert 0.2 < lost.mean() < 0.5
    assert (made.surface.ids == np.where(lost, -1, 0)).all()
    assert not made.mean[lost].any()
    assert np.isfinite(made.mean).all()
    assert (made.mean[~lost].min(axis=-1) > 0.05).all()
    assert made.variance is None or not made.variance[lost].any()


def test_a_rotated_camera_reports_normals_in_the_boards_frame(scenes, compiled):
    scene = read_scene(scenes / "overlap")
    scene = scene.with_camera(scene.camera.resized(160, 120))
    surface = render(scene, "surface").surface
    floor = surface.ids == 3
    np.testing.assert_allclose(surface.normal[floor], np.tile((0, 0, 1), (floor.sum(), 1)), atol=1e-6)
    assert (abs(np.linalg.norm(surface.normal[surface.mask], axis=1) - 1) < 1e-5).all()
