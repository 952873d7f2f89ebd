import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from photo_helpers import a_camera

from raytwin.photos.camera import lens_model
from raytwin.scene.lens import undone

SIZE = (1008, 756)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), st.floats(-0.005, 0.005), st.floats(-0.005, 0.005))
def test_undistorting_and_distorting_comes_back_to_the_pixel(k1, k2, p1, p2):
    camera = a_camera(dist=(k1, k2, p1, p2))
    if not undone(camera.K, camera.dist, SIZE).fault:
        pixels = np.stack(np.meshgrid(np.linspace(0, 1007, 33), np.linspace(0, 755, 25)), axis=-1).reshape(-1, 2)
        rays = np.c_[lens_model.undistort(pixels, camera.K, camera.dist), np.ones(len(pixels))]
        back = lens_model.project(rays, np.eye(3), np.zeros(3), camera.K, camera.dist)
        np.testing.assert_allclose(back, pixels, rtol=0, atol=1e-9)


def test_a_lens_grows_out_to_its_fold_and_one_without_a_fold_wherever_the_camera_looks():
    """k1 alone folds at 1 / √(-3 k1); p1 alone above the middle, where every radial slope grows: y' = y + 3 p1 y² turns
    at y = -1 / (6 p1)."""
    for k1 in (-2.0, -0.3, -0.01):
        r = np.array([0.1, 0.98, 1.02, 1.5, 30]) / math.sqrt(-3 * k1)
        rays = np.c_[0.6 * r, -0.8 * r, np.ones(5)]
        assert lens_model.grows(2.5 * rays, (k1,)).tolist() == [True, True, False, False, False]
    rays = np.array([[0, y, 1.0] for y in (-0.49, -0.51, 0.51)])
    assert lens_model.grows(rays, (0, 0, 1 / 3)).tolist() == [True, False, True]
    rays = np.array([[0.3, 0.2, 1], [50, -80, 1], [0.3, 0.2, -1], [0.3, 0.2, 0]])
    for dist in ((), (0.1, 0.2, 0, 0, 0.3)):
        assert lens_model.grows(rays, dist).tolist() == [True, True, False, False]
