"""The lens: OpenCV's Brown-Conrady distortion, its inverse, and where it turns back.

x, y = X/Z, Y/Z; r² = x² + y²; radial g = 1 + k1 r² + k2 r⁴ + k3 r⁶;
x' = x g + 2 p1 x y + p2 (r² + 2 x²), y' = y g + p1 (r² + 2 y²) + 2 p2 x y; u = fx x' + cx, v = fy y' + cy.
"""

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from raytwin.scene.lens import newton


def project(points: np.ndarray, R: Any, t: Any, K: Any, dist: Sequence[float]) -> np.ndarray:
    """Pixels (n, 2) of board points (n, 3): cv2.projectPoints with a rotation matrix."""
    rvec = cv2.Rodrigues(np.asarray(R, float))[0]
    pixels, _ = cv2.projectPoints(
        np.asarray(points, float).reshape(-1, 1, 3), rvec, np.asarray(t, float), np.asarray(K, float), five(dist)
    )
    return pixels.reshape(-1, 2)


def undistort(pixels: Any, K: Any, dist: Sequence[float]) -> np.ndarray:
    """Normalised x, y (n, 2) of pixels (n, 2); right where the lens can be undone (`raytwin.scene.lens`).

    OpenCV's own stops after 5 steps without looking at what is left, and with more does not always converge.
    """
    (fx, _, cx), (_, fy, cy), _ = K
    u, v = np.asarray(pixels, float).reshape(-1, 2).T
    return np.stack(newton((u - cx) / fx, (v - cy) / fy, five(dist).tolist()), axis=1)


def turning_radius(dist: Sequence[float]) -> float:
    """The smallest r at which r (1 + k1 r² + k2 r⁴ + k3 r⁶) stops growing; infinite where it never does.

    Past it the lens model folds back: two directions would share a pixel. (r = 1000 is 90 degrees off the axis.)
    """
    k1, k2, _, _, k3 = five(dist)
    slope = np.array([7 * k3, 5 * k2, 3 * k1, 1.0])  # of r² as the variable
    roots = np.roots(np.where(np.abs(slope) < 1e-12, 0.0, slope))
    squares = [z.real for z in roots if abs(z.imag) < 1e-9 * max(1.0, abs(z)) and 0 < z.real < 1e6]
    return math.sqrt(min(squares)) if squares else math.inf


def grows(rays: np.ndarray, dist: Sequence[float]) -> np.ndarray:
    """(n,) bool: whether the lens has not folded back before the camera's ray (n, 3)."""
    return np.hypot(rays[:, 0], rays[:, 1]) < turning_radius(dist) * rays[:, 2]


def corner_radius(intrinsics: Sequence[float], image_size: tuple[int, int]) -> float:
    """The distance of the image's farthest corner from the lens's centre, in focal lengths, given fx, fy, cx, cy."""
    fx, fy, cx, cy = intrinsics
    width, height = image_size
    return math.hypot(max(cx + 0.5, width - 0.5 - cx) / fx, max(cy + 0.5, height - 0.5 - cy) / fy)


def five(dist: Sequence[float]) -> np.ndarray:
    """k1, k2, p1, p2, k3 of any prefix of them, the missing ones 0."""
    return np.array([*dist, *(0.0,) * (5 - len(dist))], float)
