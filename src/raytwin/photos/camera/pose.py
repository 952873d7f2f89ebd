"""Where the camera stood: `p_cam = R_cam_board @ p_board + t_cam_board` from one photo of the board."""

import contextlib
import itertools
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.distance import pdist
from scipy.special import fdtrc

from raytwin.errors import InputError
from raytwin.images.photo_files import photo_size
from raytwin.photos.boards.board import Board, in_one_line
from raytwin.photos.camera import lens_model
from raytwin.photos.camera.bias import unbiased
from raytwin.photos.camera.detection import Tag, detect_photo
from raytwin.photos.camera.fit import matched
from raytwin.scene import Camera, Matrix, Record, Vector

WRONGLY_RULED_OUT = 1e-3
"""Probability that noise alone makes the true pose fit so much worse than the other one that it is ruled out."""

SAME_POSE_DEGREES = 1.0
"""Two poses less than this apart are one."""

OUTLIER_SIGMAS, OUTLIER_PX = 15.0, 1.0
"""A tag is rejected when it lies this many standard deviations off, and this many pixels. A real print is never quite
flat: its errors have heavier tails than the detector's noise."""

LEAST_AGREEING = 2 / 3
"""Share of the tags that one homography must explain: with fewer the photos show another board."""


class Pose(Record, frozen=True):
    """`p_cam = R_cam_board @ p_board + t_cam_board`, metres; `rms_px`: root mean squared distance of its tags."""

    R_cam_board: Matrix
    t_cam_board: Vector
    rms_px: float


def refined_pose(K, dist: Sequence[float], tags: Sequence[Tag], board: Board) -> tuple[Pose, float | None]:
    """The pose of least squared pixel distance, and its ambiguity: the error of the second minimum that every planar
    pose has over that of the first, None where there is one only.

    Levenberg-Marquardt from both solutions that a plane has (Collins and Bartoli, Infinitesimal plane-based pose
    estimation, 2014), and from SQPnP's (Terzakis and Lourakis, 2020).
    """
    (points, pixels), flat = matched(tags, board), matched(tags, board.flat())[0]
    K5, d5 = np.asarray(K, float), lens_model.five(dist)
    starts: list[tuple[np.ndarray, np.ndarray]] = []
    # Three of few tags in a line leave IPPE undetermined; SQPnP refuses tags that are a few pixels apart.
    for flag in (cv2.SOLVEPNP_IPPE, cv2.SOLVEPNP_SQPNP):
        with contextlib.suppress(cv2.error):
            _, turns, shifts, _ = cv2.solvePnPGeneric(flat, pixels, K5, d5, flags=flag)
            starts += zip(turns, shifts, strict=True)
    refined = (cv2.solvePnPRefineLM(points, pixels, K5, d5, turn.copy(), shift.copy()) for turn, shift in starts)
    poses = [
        _pose(cv2.Rodrigues(turn)[0], shift.ravel(), tags, board, K, dist)
        for turn, shift in refined
        if np.isfinite([turn, shift]).all()
    ]
    if not poses or not spans_a_plane(tags, board):
        raise InputError("tags", "four or more, not in one line", listed(t.id for t in tags))
    best = min(poses, key=lambda pose: pose.rms_px)
    others = [pose.rms_px for pose in poses if rotation_degrees(pose.R_cam_board, best.R_cam_board) > SAME_POSE_DEGREES]
    return best, min(others) / max(best.rms_px, 1e-9) if others else None


def ambiguous(ratio: float | None, tags: int) -> bool:
    """Whether a pose with `ratio` times the error of the best cannot be ruled out, from this number of tags.

    A tag gives two numbers, a pose takes six: with n tags the squared ratio of two independent errors follows
    Fisher's F with (2 n - 6, 2 n - 6) degrees of freedom. The limit is 1.5² for 35 tags, 32² for four.
    """
    degrees = 2 * max(tags - 3, 1)
    return ratio is not None and bool(fdtrc(degrees, degrees, ratio**2) > WRONGLY_RULED_OUT)


def pose_of_tags(K, dist: Sequence[float], tags: Sequence[Tag], board: Board, photo: str = "photo") -> Pose:
    """The pose from the tags of one photo, without outliers and tags that are not on the board."""
    check_tags(tags, board, photo)
    known = board.centers()
    used = straight = [t for t in tags if t.id in known]
    if not spans_a_plane(used, board):
        raise InputError(photo, "at least 4 tags of the board, not in one line", listed(t.id for t in used))
    inside = kept = consistent(used, board, lens_model.undistort([t.center for t in used], K, dist))
    check_places(int(inside.sum()), len(used), photo)
    for _ in range(3):
        if spans_a_plane([*itertools.compress(used, inside)], board):
            kept = inside
        pose, _ = refined_pose(K, dist, [*itertools.compress(straight, kept)], board)
        straight = unbiased(used, board, pose.R_cam_board, pose.t_cam_board, K, dist)
        error = distances(straight, board, pose.R_cam_board, pose.t_cam_board, K, dist)
        inside = error <= outlier_limit(error)
    return pose


def place_camera(photo: str | os.PathLike, lens: Camera, board: Board) -> tuple[Camera, Pose]:
    """The camera where it took the photo's file, and its pose. Raises InputError for a photo of another size."""
    if (size := photo_size(photo)) != lens.image_size:
        turned = ": the same, turned by a quarter" if size[::-1] == lens.image_size else ""
        got = f"{size[0]} x {size[1]}{turned}"
        raise InputError(photo, f"{lens.width} x {lens.height} pixels, as the camera's", got)
    tags = detect_photo(photo, board.family)
    pose = pose_of_tags(lens.K, lens.dist, tags, board, Path(photo).name)
    return camera_at(lens, pose), pose


def camera_at(calibration, pose) -> Camera:
    """The calibrated camera (anything with image_size, K and dist) at a pose: a Pose, or a View of the calibration."""
    return Camera(calibration.image_size, calibration.K, pose.R_cam_board, pose.t_cam_board, calibration.dist)


def consistent(tags: Sequence[Tag], board: Board, image: Any) -> np.ndarray:
    """(n,) bool: which tags, seen at `image` (n, 2), one homography puts nearer to their own place than to any other.

    A lens or a bend moves a tag by less than half of the distance between neighbours, another board by all of it.
    RANSAC, with OpenCV's own fixed seed.
    """
    if not spans_a_plane(tags, board):
        return np.zeros(len(tags), bool)
    half = pdist([*board.centers().values()]).min() / 2
    _, inside = cv2.findHomography(np.array(image), matched(tags, board)[0][:, :2], cv2.RANSAC, half, maxIters=500)
    return np.ones(len(tags), bool) if inside is None else inside.ravel().astype(bool)


def spans_a_plane(tags: Sequence[Tag], board: Board) -> bool:
    """Whether the tags are four or more of the board's, not in one line."""
    return not in_one_line(matched(tags, board)[0][:, :2])


def check_tags(tags: Iterable[Tag], board: Board, where: str) -> None:
    """Raise InputError unless some tag is on the board."""
    shown, known = {t.id for t in tags}, set(board.centers())
    if shown and not shown & known:
        raise InputError(where, f"tags of the board ({listed(known)})", f"other tags ({listed(shown)})")


def check_places(agree: int, tags: int, where: str) -> None:
    """Raise InputError unless LEAST_AGREEING of the tags lie where one homography of the board puts them."""
    if agree < LEAST_AGREEING * tags:
        got = f"{agree} of {tags} that do: is its number of columns the one in the photos?"
        raise InputError(where, "tags that lie as the board's file says", got)


def outlier_limit(errors: np.ndarray) -> float:
    """The pixel distance beyond which a tag is an outlier, by all distances.

    The median of a two-dimensional normal distribution's distances is 1.1774 of its standard deviations.
    """
    return max(OUTLIER_PX, OUTLIER_SIGMAS * float(np.median(errors)) / 1.1774)


def distances(tags: Sequence[Tag], board: Board, R, t, K, dist: Sequence[float]) -> np.ndarray:
    """(n,) pixels from where the camera sees the tags' places on the board to where they were found."""
    points, pixels = matched(tags, board)
    return np.linalg.norm(lens_model.project(points, R, t, K, dist) - pixels, axis=1)


def rotation_degrees(A, B) -> float:
    """The angle of the rotation A B^T, degrees."""
    return math.degrees(np.linalg.norm(cv2.Rodrigues(np.asarray(A, float) @ np.asarray(B, float).T)[0]))


def rotation(R: np.ndarray) -> Matrix:
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(R, float).tolist()
    return (a, b, c), (d, e, f), (g, h, i)


def _pose(R: np.ndarray, t: np.ndarray, tags: Sequence[Tag], board: Board, K, dist: Sequence[float]) -> Pose:
    rms = math.sqrt((distances(tags, board, R, t, K, dist) ** 2).mean())
    return Pose(rotation(R), tuple(np.asarray(t, float).tolist()), rms)


def listed(ids: Iterable[int]) -> str:
    """Ids as text, the least and the largest of many."""
    some = sorted(ids)
    return f"ids {', '.join(map(str, some))}" if len(some) < 5 else f"ids {some[0]}..{some[-1]}"
