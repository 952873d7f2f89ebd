"""Pixel to ray: the pinhole `u = fx x + cx`, `v = fy y + cy` behind Brown and Conrady's distortion.

Normalised coordinates (x, y) are the point where the ray meets the plane z = 1 of the camera frame.
"""

from typing import Any

from raytwin.scene import Camera
from raytwin.tracer.arrays import Vec, dot, sqrt

NEWTON_STEPS = 6


def distort(x: Any, y: Any, dist: tuple) -> tuple[Any, Any]:
    """x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and y' alike: ideal to distorted coordinates.

    `dist` is (k1, k2, p1, p2, k3), in OpenCV's order (Brown 1966; OpenCV, "Camera Calibration and 3D Reconstruction").
    """
    k1, k2, p1, p2, k3 = dist
    rr = x * x + y * y
    radial = 1 + rr * (k1 + rr * (k2 + rr * k3))
    return x * radial + 2 * p1 * x * y + p2 * (rr + 2 * x * x), y * radial + p1 * (rr + 2 * y * y) + 2 * p2 * x * y


def undistort(xd: Any, yd: Any, dist: tuple) -> tuple[Any, Any]:
    """The (x, y) with distort(x, y) = (xd, yd), by Newton's method from (xd, yd).

    The Jacobian [[a, b], [b, c]] is symmetric. Six steps reach rounding wherever the distortion is monotone and moves a
    point by less than about a third of its distance from the centre; whether it did is for the caller to check, by
    distorting again.
    """
    k1, k2, p1, p2, k3 = dist
    x, y = xd, yd
    for _ in range(NEWTON_STEPS):
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


def back_project(u: Any, v: Any, camera: Camera) -> Vec:
    """d = Rᵀ (x, y, 1) / |(x, y, 1)|: the unit direction, in the board frame, of the ray through pixel (u, v).

    `u`, `v`: pixels, (0, 0) is the centre of the top-left one; arrays of one shape, or that broadcast to one.
    """
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    if camera.dist:
        x, y = undistort(x, y, camera.coefficients)
    scale = 1 / sqrt(x * x + y * y + 1)
    ray = (x * scale, y * scale, scale)
    right, down, forward = camera.R_cam_board
    return tuple(dot(column, ray) for column in zip(right, down, forward, strict=True))
