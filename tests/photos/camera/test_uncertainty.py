import math

import numpy as np
import pytest
from photo_helpers import BOARD, SMALL, a_camera, seen

from raytwin.photos.camera import calibrate_detections, deviations, lens_model, uncertainty_map
from raytwin.photos.synthetic_photos import poses

SIZE = (1008, 756)
PLACES = np.array([[0, 0], [500, 375], [1007, 755], [1007, 0], [200, 400]], float)


@pytest.fixture(scope="module")
def views():
    """A camera, where it stood, and what it saw from there, with noise of 0.2 px."""
    camera = a_camera(*SIZE)
    stands = poses(BOARD, camera, 12, np.random.default_rng(0))
    return camera, stands, seen(camera, stands, noise=0.2, rng=np.random.default_rng(1))


@pytest.mark.parametrize("model", ["none", "full5"])
def test_the_covariance_holds_the_variances_that_opencv_gives(views, model):
    found = calibrate_detections(views[2], SIZE, SMALL, model)
    C = np.array(found.evidence.covariance)
    m = len(found.sigma)
    assert C.shape == (m + 6, m + 6)
    assert np.sqrt(np.diag(C))[:m] == pytest.approx(list(found.sigma.values()), rel=1e-3)


@pytest.mark.nightly
def test_the_predicted_deviations_are_those_of_repeated_calibrations(views):
    camera, stands, _ = views
    rng = np.random.default_rng(3)
    rays = np.c_[lens_model.undistort(PLACES, camera.K, camera.dist), np.ones(len(PLACES))]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    moved, predicted = [], []
    for _ in range(30):
        found = calibrate_detections(seen(camera, stands, noise=0.2, rng=rng), SIZE, SMALL, "k1k2")
        # Points fixed to the true boards, where the found poses put them, on average over the boards.
        far, near = [], []
        for view, (R, t) in zip(found.views, stands, strict=True):
            R_found, t_found = np.array(view.R_cam_board), np.array(view.t_cam_board)
            far.append(rays @ R @ R_found.T)
            near.append((0.3 * rays - t) @ R @ R_found.T + t_found)
        carried = np.concatenate([np.mean(far, axis=0), np.mean(near, axis=0)])
        moved.append(lens_model.project(carried, np.eye(3), np.zeros(3), found.K, found.dist) - np.tile(PLACES, (2, 1)))
        predicted.append(np.concatenate([deviations(found, PLACES, math.inf), deviations(found, PLACES, 0.3)]))
    moved = np.array(moved)
    spread = [math.sqrt(np.linalg.eigvalsh(np.cov(moved[:, i].T))[-1]) for i in range(2 * len(PLACES))]
    # 30 draws know a standard deviation to an eighth; each within three of these.
    assert np.mean(predicted, axis=0) == pytest.approx(spread, rel=0.38)


def test_the_map_covers_the_image_and_is_surest_where_the_boards_were(views):
    found = calibrate_detections(views[2], SIZE, SMALL, "k1k2")
    shown = uncertainty_map(found)
    assert shown.shape == (47, 63)
    assert shown[23, 31] == pytest.approx(deviations(found, [[503.5, 375.5]], found.evidence.distance)[0], rel=0.1)
    assert shown[23, 31] < 0.3 * min(shown[0, 0], shown[0, -1], shown[-1, 0], shown[-1, -1])


def test_half_the_noise_is_half_the_uncertainty(views):
    camera, stands, _ = views
    rng = [np.random.default_rng(5), np.random.default_rng(5)]
    whole, half = (
        deviations(calibrate_detections(seen(camera, stands, noise=n, rng=r), SIZE, SMALL, "k1k2"), PLACES, 0.5)
        for n, r in zip((0.2, 0.1), rng, strict=True)
    )
    assert half == pytest.approx(whole / 2, rel=0.02)
