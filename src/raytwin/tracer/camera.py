"""Pixel to ray: the pinhole `u = fx x + cx`, `v = fy y + cy` behind Brown and Conrady's distortion.

Normalised coordinates (x, y) are the point where the ray meets the plane z = 1 of the camera frame.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.scene import Camera
from raytwin.tracer.arrays import Vec, dot, sqrt

MOST_STEPS = 20


def distort(x: Any, y: Any, dist: tuple) -> tuple[Any, Any]:
    """x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and y' alike: ideal to distorted coordinates.

    `dist` is (k1, k2, p1, p2, k3), in OpenCV's order (Brown 1966; OpenCV, "Camera Calibration and 3D Reconstruction").
    """
    k1, k2, p1, p2, k3 = dist
    rr = x * x + y * y
    radial = 1 + rr * (k1 + rr * (k2 + rr * k3))
    return x * radial + 2 * p1 * x * y + p2 * (rr + 2 * x * x), y * radial + p1 * (rr + 2 * y * y) + 2 * p2 * x * y


def undistort(xd: Any, yd: Any, dist: tuple, steps: int) -> tuple[Any, Any]:
    """The (x, y) with distort(x, y) = (xd, yd), by Newton's method from (xd, yd).

    The Jacobian [[a, b], [b, c]] is symmetric. `newton_steps` tells how many steps a camera needs.
    """
    k1, k2, p1, p2, k3 = dist
    x, y = xd, yd
    for _ in range(steps):
        rr = x * x + y * y
        radial = 1 + rr * (k1 + rr * (k2 + rr * k3))
        slope = 2 * (k1 + rr * (2 * k2 + rr * (3 * k3)))  # d radial / d(rr), doubled
        xy = x * y
        a = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
        b = xy * slope + 2 * p1 * x + 2 * p2 * y
        c = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
        ex = x * radial + 2 * p1 * xy + p2 * (rr + 2 * x * x) - xd
        ey = y * radial + p1 * (rr + 2 * y * y) + 2 * p2 * xy - yd
        scale = 1 / (a * c - b * b)
        x, y = x - (c * ex - b * ey) * scale, y - (a * ey - b * ex) * scale
    return x, y


@lru_cache(maxsize=64)
def newton_steps(camera: Camera) -> int:
    """How many steps undo the camera's distortion to rounding all over the frame: 0 for a pinhole, 3 for most lenses.

    Raises InputError where none do: the model folds over within the frame, and some pixels have no ray.
    """
    if not any(camera.dist):
        return 0
    u = np.linspace(-0.5, camera.width - 0.5, 33)
    v = np.linspace(-0.5, camera.height - 0.5, 33)[:, None]
    xd, yd = np.broadcast_arrays((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    with np.errstate(all="ignore"):
        for steps in range(1, MOST_STEPS):
            x, y = undistort(xd, yd, camera.coefficients, steps)
            bx, by = distort(x, y, camera.coefficients)
            off = np.hypot(bx - xd, by - yd)
            if off.max() < 2e-14 and _monotone(x, y, camera.coefficients):
                return steps
    raise InputError("camera.dist", "a distortion that can be undone all over the frame", list(camera.dist))


def _monotone(x: np.ndarray, y: np.ndarray, dist: tuple) -> bool:
    """The radial part r (1 + k1 r² + ...) grows all the way out to the farthest point."""
    k1, k2, _, _, k3 = dist
    rr = np.linspace(0.0, float((x * x + y * y).max()), 257)
    return bool((1 + rr * (3 * k1 + rr * (5 * k2 + rr * 7 * k3))).min() > 0)


def back_project(u: Any, v: Any, camera: Camera, steps: int | None = None) -> Vec:
    """d = Rᵀ (x, y, 1) / |(x, y, 1)|: the unit direction, in the board frame, of the ray through pixel (u, v).

    `u`, `v`: pixels, (0, 0) is the centre of the top-left one; arrays of one shape, or that broadcast to one.
    `steps`: Newton's, to undo the distortion; None finds out how many.
    """
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    steps = newton_steps(camera) if steps is None else steps
    if steps:
        x, y = undistort(x, y, camera.coefficients, steps)
    scale = 1 / sqrt(x * x + y * y + 1)
    ray = (x * scale, y * scale, scale)
    right, down, forward = camera.R_cam_board
    return tuple(dot(column, ray) for column in zip(right, down, forward, strict=True))
