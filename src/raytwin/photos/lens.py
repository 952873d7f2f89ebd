"""The lens: OpenCV's Brown-Conrady distortion, its inverse, and how far each may be trusted.

x, y = X/Z, Y/Z; r² = x² + y²; radial g = 1 + k1 r² + k2 r⁴ + k3 r⁶;
x' = x g + 2 p1 x y + p2 (r² + 2 x²), y' = y g + p1 (r² + 2 y²) + 2 p2 x y; u = fx x' + cx, v = fy y' + cy.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

CONVERGED_PX = 1e-3
"""A distortion inverse that comes back farther away than this, anywhere in the image, has not converged."""

_UNTIL = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-10)


def project(points: np.ndarray, R: np.ndarray, t: np.ndarray, K: np.ndarray, dist: Sequence[float]) -> np.ndarray:
    """Pixels (n, 2) of board points (n, 3): cv2.projectPoints with a rotation matrix."""
    rvec = cv2.Rodrigues(np.asarray(R, float))[0]
    pixels, _ = cv2.projectPoints(
        np.asarray(points, float).reshape(-1, 1, 3), rvec, np.asarray(t, float), np.asarray(K, float), five(dist)
    )
    return pixels.reshape(-1, 2)


def undistort(pixels: np.ndarray, K: np.ndarray, dist: Sequence[float]) -> np.ndarray:
    """Normalised x, y (n, 2) of pixels (n, 2), iterated to convergence where there is one.

    OpenCV's default stops after 5 steps without looking at what is left: pixels wrong at the corners.
    """
    pixels = np.asarray(pixels, float).reshape(-1, 1, 2)
    K, dist = np.asarray(K, float), five(dist)
    if hasattr(cv2, "undistortPointsIter"):  # OpenCV 4; version 5 gives undistortPoints the argument instead
        xy = cv2.undistortPointsIter(pixels, K, dist, np.eye(3), np.eye(3), _UNTIL)
    else:
        xy = cv2.undistortPoints(pixels, K, dist, criteria=_UNTIL)
    return xy.reshape(-1, 2)


def inverse_error(K: np.ndarray, dist: Sequence[float], image_size: tuple[int, int]) -> tuple[float, tuple[int, int]]:
    """The largest |distort(undistort(p)) - p| over the image, borders and corners included, in pixels, and that p."""
    width, height = image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, 33).round(), np.linspace(0, height - 1, 25).round())
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)
    with np.errstate(all="ignore"):
        xy = undistort(pixels, K, dist)
        back = project(np.c_[xy, np.ones(len(xy))], np.eye(3), np.zeros(3), K, dist)
        error = np.nan_to_num(np.linalg.norm(back - pixels, axis=1), nan=math.inf)
    worst = int(error.argmax())
    return float(error[worst]), (int(pixels[worst, 0]), int(pixels[worst, 1]))


def turning_radius(dist: Sequence[float]) -> float:
    """The smallest r at which r (1 + k1 r² + k2 r⁴ + k3 r⁶) stops growing; infinite where it never does.

    Past it the lens model folds back: two directions would share a pixel. (r = 1000 is 90 degrees off the axis.)
    """
    k1, k2, _, _, k3 = five(dist)
    slope = np.array([7 * k3, 5 * k2, 3 * k1, 1.0])  # of r² as the variable
    roots = np.roots(np.where(np.abs(slope) < 1e-12, 0.0, slope))
    squares = [z.real for z in roots if abs(z.imag) < 1e-9 * max(1.0, abs(z)) and 0 < z.real < 1e6]
    return math.sqrt(min(squares)) if squares else math.inf


def is_monotone(K: np.ndarray, dist: Sequence[float], image_size: tuple[int, int]) -> bool:
    """Whether the radial distortion grows all the way to the image's farthest corner."""
    r = turning_radius(dist)
    if math.isinf(r):
        return True
    k1, k2, _, _, k3 = five(dist)
    s = r * r
    reached = r * (1 + s * (k1 + s * (k2 + s * k3)))
    width, height = image_size
    x = max(K[0][2] + 0.5, width - 0.5 - K[0][2]) / K[0][0]
    y = max(K[1][2] + 0.5, height - 0.5 - K[1][2]) / K[1][1]
    return bool(reached > math.hypot(x, y))


def five(dist: Sequence[float]) -> np.ndarray:
    """k1, k2, p1, p2, k3 of any prefix of them, the missing ones 0."""
    return np.array([*dist, *(0.0,) * (5 - len(dist))], float)
