"""How far off a projected pixel may be: sqrt of the largest eigenvalue of Var[q] = J C J^T, over the whole image.

A camera that is a little wrong is for the most part a camera that looks a little elsewhere, and every pose found with
it looks elsewhere by the same amount: such an error is invisible in use. What counts is what is left. So a point fixed
to the boards, not to the camera, is followed: the perturbed poses carry it along, on average over the views, by a turn
omega and a shift tau, and only then is it projected through the perturbed lens:

    q' = project(p + omega x p + tau; intrinsics + d),  J = dq' / d(intrinsics, omega, tau).

After mrcal's projection uncertainty (Kogan, mrcal.secretsauce.net/uncertainty.html), to first order.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from raytwin.boards.board import Board
from raytwin.photos import lens, pose
from raytwin.photos.fit import MODELS, NAMES, Fit, Seen
from raytwin.photos.model import ModelTrial
from raytwin.scene import Record

CELL = 16
"""The map has one value for each CELL x CELL pixels."""


class Evidence(Record, frozen=True):
    """What a calibration rests on, and what may be said from it; not part of its JSON.

    `coverage`: the share of the frame's 10 x 10 cells with a tag's centre. `tilts`: the angle between the board's
    normal and the line of sight, degrees, by view. `distance`: the board's middle from the camera, the median over the
    views, metres. `covariance`: of (fx, fy, cx, cy, the model's coefficients, omega, tau), see above; pixels, radians,
    metres. `trials`: what came of each model, where one was to be chosen. `seen`: the tags' centres in all the photos,
    pixels.
    """

    coverage: float
    tilts: tuple[float, ...]
    distance: float
    covariance: tuple[tuple[float, ...], ...]
    trials: dict[str, ModelTrial]
    seen: tuple[tuple[float, float], ...]


def covariance(views: Sequence[Seen], board: Board, found: Fit, model: str) -> np.ndarray:
    """T s² (J^T J)^-1 T^T: of the intrinsics and of the views' mean omega and tau, s² = residuals² / (2 n - columns).

    J has a row for each coordinate of each tag and a column for each intrinsic and for each view's own omega and tau;
    T averages the latter.
    """
    intrinsics = 4 + len(MODELS[model])
    count = intrinsics + 6 * len(views)
    normal = np.zeros((count, count))
    squares, rows = 0.0, 0
    for i, (view, (R, t)) in enumerate(zip(views, found.poses, strict=True)):
        points, pixels = pose.matched(view.tags, board)
        projected, of_lens, of_pose = _jacobians(points @ R.T + t, found.K, found.dist, model)
        J = np.zeros((len(of_lens), count))
        J[:, :intrinsics] = of_lens
        J[:, intrinsics + 6 * i : intrinsics + 6 * (i + 1)] = of_pose
        normal += J.T @ J
        squares, rows = squares + float(((projected - pixels) ** 2).sum()), rows + len(J)
    # Pixels, radians and metres differ by orders of magnitude: make the diagonal 1 before inverting.
    scale = 1 / np.sqrt(np.diag(normal))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    T = np.zeros((intrinsics + 6, count))
    T[:intrinsics, :intrinsics] = np.eye(intrinsics)
    T[intrinsics:, intrinsics:] = np.tile(np.eye(6), len(views)) / len(views)
    return squares / max(rows - count, 1) * T @ inverse @ T.T


def deviations(calibration, pixels: np.ndarray, distance: float = math.inf) -> np.ndarray:
    """(n,): one standard deviation, in the direction that is worst, of what is seen at `pixels` (n, 2), in pixels.

    What is seen lies `distance` metres from the camera. At infinity, shifts of the camera make no difference.
    """
    rays = np.c_[lens.undistort(pixels, calibration.K, calibration.dist), np.ones(len(pixels))]
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    _, of_lens, of_pose = _jacobians(unit, calibration.K, calibration.dist, calibration.model)
    # On unit rays d/d tau is that of a point 1 m away.
    of_pose[:, 3:] /= distance
    J = np.concatenate([of_lens, of_pose], axis=1).reshape(len(pixels), 2, -1)
    variance = J @ np.array(calibration.evidence.covariance) @ J.transpose(0, 2, 1)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(variance)[:, -1], 0))


def uncertainty_map(calibration, distance: float | None = None) -> np.ndarray:
    """(h, w): `deviations` at the middles of h x w equal cells of the image, about CELL pixels wide.

    `distance`: metres, by default the median distance of the boards.
    """
    width, height = calibration.image_size
    w, h = max(2, round(width / CELL)), max(2, round(height / CELL))
    u, v = np.meshgrid((np.arange(w) + 0.5) * width / w - 0.5, (np.arange(h) + 0.5) * height / h - 0.5)
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)
    where = calibration.evidence.distance if distance is None else distance
    return deviations(calibration, pixels, where).reshape(h, w)


def _jacobians(points: np.ndarray, K, dist: Sequence[float], model: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (n, 2) of camera points (n, 3); d/d(fx, fy, cx, cy, coefficients) (2n, m); d/d(omega, tau) (2n, 6)."""
    # OpenCV's Jacobian at the identity: d/d rvec is d/d omega, d/d tvec is d/d tau.
    pixels, J = cv2.projectPoints(
        np.ascontiguousarray(points, float), np.zeros(3), np.zeros(3), np.asarray(K, float), lens.five(dist)
    )[:2]
    columns = [6, 7, 8, 9, *(10 + NAMES.index(n) for n in MODELS[model])]
    return pixels.reshape(-1, 2), J[:, columns], J[:, :6].copy()
