"""Pixel to ray: the pinhole `u = fx x + cx`, `v = fy y + cy` behind Brown and Conrady's distortion.

Normalised coordinates (x, y) are the point where the ray meets the plane z = 1 of the camera frame.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from raytwin.errors import InputError
from raytwin.scene import Camera
from raytwin.tracer.arrays import Vec, dot, sqrt

MOST_STEPS, GUESS_TERMS = 20, 5


def distort(x: Any, y: Any, dist: tuple) -> tuple[Any, Any]:
    """x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and y' alike: ideal to distorted coordinates.

    `dist` is (k1, k2, p1, p2, k3), in OpenCV's order (Brown 1966; OpenCV, "Camera Calibration and 3D Reconstruction").
    """
    k1, k2, p1, p2, k3 = dist
    rr = x * x + y * y
    radial = 1 + rr * (k1 + rr * (k2 + rr * k3))
    return x * radial + 2 * p1 * x * y + p2 * (rr + 2 * x * x), y * radial + p1 * (rr + 2 * y * y) + 2 * p2 * x * y


class Inverse(NamedTuple):
    """How to undo a camera's distortion: `steps` of Newton's, from (xd, yd) (1 + g1 r² + g2 r⁴ + ...).

    The tangential terms at (xd, yd) are taken off that guess. Without any g there is nothing to undo.
    """

    steps: int
    guess: tuple = (0.0,)


def undistort(xd: Any, yd: Any, dist: tuple, inverse: Inverse) -> tuple[Any, Any]:
    """The (x, y) with distort(x, y) = (xd, yd), by Newton's method; its Jacobian [[a, b], [b, c]] is symmetric."""
    if not inverse.guess:
        return xd, yd
    k1, k2, p1, p2, k3 = dist
    rr = xd * xd + yd * yd
    scale = inverse.guess[-1]
    for g in inverse.guess[-2::-1]:
        scale = g + rr * scale
    # What p1 and p2 add to a point is small: taken off at the distorted point, it is right to second order.
    x = xd + xd * (rr * scale) - 2 * p1 * xd * yd - p2 * (rr + 2 * xd * xd)
    y = yd + yd * (rr * scale) - p1 * (rr + 2 * yd * yd) - 2 * p2 * xd * yd
    for _ in range(inverse.steps):
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
def invert_lens(camera: Camera, precision: str = "float64") -> Inverse:
    """The cheapest Inverse that undoes the camera's distortion to rounding all over the frame; no step for a pinhole.

    The guess is fitted to the frame, so that one step serves in float32 for most lenses, and two in float64. Raises
    InputError where none does: the model folds over within the frame, and some pixels have no ray.
    """
    if not any(camera.dist):
        return Inverse(0, ())
    u = np.linspace(-0.5, camera.width - 0.5, 33)
    v = np.linspace(-0.5, camera.height - 0.5, 33)[:, None]
    xd, yd = np.broadcast_arrays((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    with np.errstate(all="ignore"):
        x, y = undistort(xd, yd, camera.coefficients, Inverse(MOST_STEPS))
        if not (_error(x, y, xd, yd, camera) < 2e-14 and _monotone(x, y, camera.coefficients)):
            found = list(camera.dist)
            raise InputError("camera.dist", "a distortion that can be undone all over the frame", found)
        rr = xd * xd + yd * yd
        p1, p2 = camera.coefficients[2:4]
        dx = x - xd + 2 * p1 * xd * yd + p2 * (rr + 2 * xd * xd)
        dy = y - yd + p1 * (rr + 2 * yd * yd) + 2 * p2 * xd * yd
        wanted = (dx * xd + dy * yd).ravel()  # x/xd - 1 by least squares, each point weighed by r²
        powers = np.stack([rr.ravel() ** k for k in range(2, 2 + GUESS_TERMS)], axis=-1)
        guess = tuple(np.linalg.lstsq(powers, wanted, rcond=None)[0].tolist())
        enough = 2e-14 if precision == "float64" else 2e-8
        for start in (guess, (0.0,)):
            for steps in range(1, MOST_STEPS):
                inverse = Inverse(steps, start)
                if _error(*undistort(xd, yd, camera.coefficients, inverse), xd, yd, camera) < enough:
                    return inverse
    return Inverse(MOST_STEPS)


def _error(x: np.ndarray, y: np.ndarray, xd: np.ndarray, yd: np.ndarray, camera: Camera) -> float:
    bx, by = distort(x, y, camera.coefficients)
    return float(np.hypot(bx - xd, by - yd).max())


def _monotone(x: np.ndarray, y: np.ndarray, dist: tuple) -> bool:
    """The radial part r (1 + k1 r² + ...) grows all the way out to the farthest point."""
    k1, k2, _, _, k3 = dist
    rr = np.linspace(0.0, float((x * x + y * y).max()), 257)
    return bool((1 + rr * (3 * k1 + rr * (5 * k2 + rr * 7 * k3))).min() > 0)


def back_project(u: Any, v: Any, camera: Camera, inverse: Inverse | None = None) -> Vec:
    """d = Rᵀ (x, y, 1) / |(x, y, 1)|: the unit direction, in the board frame, of the ray through pixel (u, v).

    `u`, `v`: pixels, (0, 0) is the centre of the top-left one; arrays of one shape, or that broadcast to one.
    `inverse` undoes the distortion; without one, the camera's own is found.
    """
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    x, y = undistort(x, y, camera.coefficients, inverse or invert_lens(camera))
    scale = 1 / sqrt(x * x + y * y + 1)
    ray = (x * scale, y * scale, scale)
    right, down, forward = camera.R_cam_board
    return tuple(dot(column, ray) for column in zip(right, down, forward, strict=True))
