import math

import numpy as np

from raytwin.photos.camera import lens_model


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
