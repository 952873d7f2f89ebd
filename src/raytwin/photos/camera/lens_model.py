"""The lens by OpenCV: what it makes of points, its inverse, and where it folds back (`raytwin.scene.lens`)."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from raytwin.scene.lens import ALONG, LEAST_DETERMINANT, determinant, newton


def project(points: np.ndarray, R: Any, t: Any, K: Any, dist: Sequence[float]) -> np.ndarray:
    """Pixels (n, 2) of board points (n, 3): cv2.projectPoints with a rotation matrix."""
    at, turn, shift, K = (np.asarray(array, float) for array in (points, R, t, K))
    return cv2.projectPoints(at.reshape(-1, 1, 3), cv2.Rodrigues(turn)[0], shift, K, five(dist))[0].reshape(-1, 2)


def linearise(
    points: np.ndarray, pixels: np.ndarray, K: np.ndarray, dist: Sequence[float] | np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (..., 2) of camera points (..., 3), and their derivatives by the nine numbers of the lens
    (..., 2, 9) and by the point (..., 2, 3)."""
    none = np.zeros(3)
    there, J = cv2.projectPoints(points.reshape(-1, 1, 3), none, none, np.asarray(K, float), five(dist))
    # Its columns: a turn, a shift (which moves every point alike), fx, fy, cx, cy, and the coefficients.
    J = J.reshape(*points.shape[:-1], 2, 15)
    return there.reshape(pixels.shape) - pixels, J[..., 6:], J[..., 3:6]


def of_pose(points: np.ndarray, of_point: np.ndarray) -> np.ndarray:
    """(..., 2, 6): d residuals / d(omega, tau) at camera points (..., 3)."""
    return np.concatenate([np.cross(points[..., None, :], of_point), of_point], axis=-1)


def undistort(pixels: Any, K: Any, dist: Sequence[float]) -> np.ndarray:
    """Normalised x, y (n, 2) of pixels (n, 2), where the lens can be undone."""
    (fx, _, cx), (_, fy, cy), _ = K
    u, v = np.asarray(pixels, float).reshape(-1, 2).T
    return np.stack(newton((u - cx) / fx, (v - cy) / fy, five(dist).tolist()), axis=1)


def grows(rays: np.ndarray, dist: Sequence[float]) -> np.ndarray:
    """(n,) bool: whether the lens does not fold back between its middle and the camera's ray (n, 3)."""
    with np.errstate(all="ignore"):
        x, y = (ALONG * (rays[:, i] / rays[:, 2]) for i in (0, 1))
        return (rays[:, 2] > 0) & (determinant(x, y, five(dist).tolist()) >= LEAST_DETERMINANT).all(axis=0)


def matrix(lens: np.ndarray) -> np.ndarray:
    """K of fx, fy, cx, cy."""
    return np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])


def five(dist: Sequence[float] | np.ndarray) -> np.ndarray:
    """k1, k2, p1, p2, k3 of any prefix of them, the missing ones 0."""
    return np.array([*dist, *(0.0,) * (5 - len(dist))], float)
