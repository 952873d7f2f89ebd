import cv2
import msgspec
import numpy as np
import pytest
from photo_helpers import BOARD, SMALL, a_camera, seen

from raytwin.errors import InputError
from raytwin.photos.camera.pose import (
    ambiguous,
    camera_at,
    matched,
    outlier_limit,
    pose_of_tags,
    refined_pose,
    rotation_degrees,
    spans_a_plane,
)
from raytwin.photos.synthetic_photos import poses

CAMERA = a_camera(dist=(0.08, -0.16, 0.002, -0.001))


@pytest.fixture(scope="module")
def stands():
    return poses(BOARD, CAMERA, 6, np.random.default_rng(3))  # on tags large enough to be seen


def leaning(distance: float) -> tuple[np.ndarray, tuple[float, float, float]]:
    tilt = np.deg2rad(30)
    R = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]) @ np.diag([1, -1, -1])
    return R, (-0.08, 0.1, distance)


def test_the_pose_of_exact_detections_is_the_truth(stands):
    for tags, (R, t) in zip(seen(CAMERA, stands).values(), stands, strict=True):
        pose = pose_of_tags(CAMERA.K, CAMERA.dist, tags, SMALL)
        assert rotation_degrees(pose.R_cam_board, R) < 2e-4
        assert np.abs(np.subtract(pose.t_cam_board, t)).max() < 2e-6
        camera_at(CAMERA, pose)  # whose rotation is one, or it raises


def test_the_pose_is_the_least_squares_one(stands):
    rng = np.random.default_rng(5)
    for tags in seen(CAMERA, stands, noise=0.5, rng=rng).values():
        pose = pose_of_tags(CAMERA.K, CAMERA.dist, tags, SMALL)
        points, pixels = matched(tags, SMALL)
        _, rvec, tvec = cv2.solvePnP(points, pixels, np.array(CAMERA.K), np.array(CAMERA.coefficients))
        assert rotation_degrees(pose.R_cam_board, cv2.Rodrigues(rvec)[0]) < 2e-3
        assert np.abs(pose.t_cam_board - tvec.ravel()).max() < 1e-5


def test_how_much_worse_a_second_pose_must_fit_to_be_ruled_out_is_fishers_f():
    """At 1 in 1000; with 2 and 2 degrees of freedom F's tail is 1 / (1 + F): F = 999."""
    assert ambiguous(999**0.5 - 0.01, 4)
    assert not ambiguous(999**0.5 + 0.01, 4)
    assert not ambiguous(1.6, 35)
    assert not ambiguous(None, 4)


def test_a_pose_from_few_tags_is_right_or_said_to_be_ambiguous():
    """Tags drawn at random, three of them often in a line, which leaves their homography undetermined."""
    rng, wrong, stand = np.random.default_rng(5), 0, leaning(0.6)
    for count in 40 * (4, 5):
        tags = seen(CAMERA, [stand], noise=0.3, rng=rng)["view_00"]
        tags = [tags[i] for i in rng.permutation(len(tags))[:count]]
        if spans_a_plane(tags, SMALL):
            found, ratio = refined_pose(CAMERA.K, CAMERA.dist, tags, SMALL)
            wrong += rotation_degrees(found.R_cam_board, stand[0]) > 15 and not ambiguous(ratio, count)
    assert wrong == 0


def test_tags_that_lie_elsewhere_are_left_out(stands):
    tags = seen(CAMERA, stands[:1], noise=0.05, rng=np.random.default_rng(1))["view_00"]
    clean, wrong = pose_of_tags(CAMERA.K, CAMERA.dist, tags, SMALL), list(tags)
    for i, by in ((3, (2.0, 0.0)), (7, (120.0, -80.0)), (11, (20.0, 10.0))):
        wrong[i] = msgspec.structs.replace(tags[i], center=tuple(np.array(tags[i].center) + by))
    found = pose_of_tags(CAMERA.K, CAMERA.dist, wrong, SMALL)
    assert rotation_degrees(found.R_cam_board, clean.R_cam_board) < 0.02


def test_too_few_tags_or_tags_in_a_line_give_no_pose(stands):
    for ids in ([0, 1, 2], [0, 1, 2, 3, 4], []):
        tags = [t for t in seen(CAMERA, stands[:1])["view_00"] if t.id in ids]
        for pose in (pose_of_tags, refined_pose):
            with pytest.raises(InputError):
                pose(CAMERA.K, CAMERA.dist, tags, SMALL)


def test_no_tag_within_a_pixel_or_fifteen_deviations_is_an_outlier():
    assert outlier_limit(np.full(20, 0.01)) == 1
    off = np.random.default_rng(0).normal(0, 0.5, (100_000, 2))
    assert outlier_limit(np.linalg.norm(off, axis=1)) == pytest.approx(15 * 0.5, rel=0.02)
