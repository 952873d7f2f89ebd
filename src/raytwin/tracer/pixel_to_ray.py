"""Pixel to ray: the pinhole `u = fx x + cx`, `v = fy y + cy` behind Brown and Conrady's distortion.

Normalised coordinates (x, y) are the point where the ray meets the plane z = 1 of the camera frame.
"""

from collections.abc import Callable
from typing import Any

from raytwin.scene import Camera
from raytwin.scene.lens import NEWTON_STEPS
from raytwin.tracer.arrays import Vec, rotate, sqrt


def undistort(xd: Any, yd: Any, dist: Any, steps: int = NEWTON_STEPS) -> tuple[Any, Any]:
    """Return the (x, y) that the lens maps to (xd, yd), by Newton's method; its Jacobian [[a, b], [b, c]] is symmetric.

    xd = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and yd alike: ideal to distorted coordinates.
    `dist` is (k1, k2, p1, p2, k3), in OpenCV's order (Brown 1966; OpenCV, "Camera Calibration and 3D Reconstruction").
    It starts at (xd, yd).
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


def back_project(u: Any, v: Any, camera: Camera, undo: Callable[..., Any] = undistort) -> Vec:
    """(x, y, 1) / |(x, y, 1)|: the unit direction, in the camera's frame, of the ray through pixel (u, v).

    `u`, `v`: pixels, (0, 0) is the centre of the top-left one; arrays of one shape, or that broadcast to one.
    `undo` maps distorted to ideal coordinates.
    """
    (fx, _, cx), (_, fy, cy), _ = camera.K
    x, y = undo((u - cx) * (1 / fx), (v - cy) * (1 / fy), camera.coefficients)
    scale = 1 / sqrt(x * x + y * y + 1)
    return x * scale, y * scale, scale


def to_board(vector: Vec, camera: Camera) -> Vec:
    """Rᵀ vector: from the camera's axes to the board's."""
    return rotate(tuple(zip(*camera.R_cam_board, strict=True)), vector)
