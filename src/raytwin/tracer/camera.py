"""Pixel to ray: the pinhole `u = fx x + cx`, `v = fy y + cy` behind Brown and Conrady's distortion.

Normalised coordinates (x, y) are the point where the ray meets the plane z = 1 of the camera frame.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from raytwin.errors import InputError
from raytwin.scene import Camera
from raytwin.tracer.arrays import Vec, dot, fma, sqrt

MOST_STEPS = 20
GUESS_TERMS = 8, 3
"""Of the radial and of the tangential series: with 3 of these, float32 needs one step for most lenses."""


def distort(x: Any, y: Any, dist: tuple) -> tuple[Any, Any]:
    """x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and y' alike: ideal to distorted coordinates.

    `dist` is (k1, k2, p1, p2, k3), in OpenCV's order (Brown 1966; OpenCV, "Camera Calibration and 3D Reconstruction").
    """
    k1, k2, p1, p2, k3 = dist
    rr = x * x + y * y
    radial = 1 + rr * (k1 + rr * (k2 + rr * k3))
    return x * radial + 2 * p1 * x * y + p2 * (rr + 2 * x * x), y * radial + p1 * (rr + 2 * y * y) + 2 * p2 * x * y


class Inverse(NamedTuple):
    """How to undo a camera's distortion: a guess, then `steps` of Newton's.

    With r² = xd² + yd² and s = p2 xd + p1 yd, the guess is x = xd (1 + r² A(r²) + s B(r²)) + p2 r² C(r²), and y alike
    with p1: what the inverse of a lens is to first order in p1 and p2. A is `radial`; B, C are `along`, `across`.
    """

    steps: int
    radial: tuple = (0.0,)
    along: tuple = ()
    across: tuple = ()


def _series(c: tuple, rr: Any) -> Any:
    """c0 + c1 r² + c2 r⁴ + ..., by Estrin's scheme: pairs that do not wait for one another."""
    while len(c) > 1:
        c = tuple(fma(c[i + 1], rr, c[i]) if i + 1 < len(c) else c[i] for i in range(0, len(c), 2))
        rr = rr * rr
    return c[0]


def undistort(xd: Any, yd: Any, dist: tuple, inverse: Inverse) -> tuple[Any, Any]:
    """The (x, y) with distort(x, y) = (xd, yd), by Newton's method; its Jacobian [[a, b], [b, c]] is symmetric."""
    if not inverse.radial:
        return xd, yd
    k1, k2, p1, p2, k3 = dist
    rr = xd * xd + yd * yd
    scale = rr * _series(inverse.radial, rr)
    if inverse.along:
        scale = scale + (p2 * xd + p1 * yd) * _series(inverse.along, rr)
    x, y = xd + xd * scale, yd + yd * scale
    if inverse.across:
        shift = rr * _series(inverse.across, rr)
        x, y = x + p2 * shift, y + p1 * shift
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
def invert_lens(camera: Camera, precision: str = "float64", fitted: bool = True) -> Inverse:
    """The cheapest Inverse that undoes the camera's distortion to rounding all over the frame; no step for a pinhole.

    The guess is `fitted` to the frame, so that one step serves in float32 for most lenses, and two in float64; for
    single numbers more steps from the distorted point itself are quicker. Raises InputError where none does: the model
    folds over within the frame, and some pixels have no ray.
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
        enough = 2e-14 if precision == "float64" else 2e-8
        guess = _fit(xd.ravel(), yd.ravel(), x.ravel(), y.ravel(), camera) if fitted else Inverse(0)
        for start in (guess, Inverse(0)):
            for steps in range(MOST_STEPS):
                inverse = start._replace(steps=steps)
                if _error(*undistort(xd, yd, camera.coefficients, inverse), xd, yd, camera) < enough:
                    return inverse
    return Inverse(MOST_STEPS)


def _fit(xd: np.ndarray, yd: np.ndarray, x: np.ndarray, y: np.ndarray, camera: Camera) -> Inverse:
    """The guess that takes (xd, yd) closest to (x, y), by least squares over both coordinates."""
    p1, p2 = camera.coefficients[2:4]
    rr, s = xd * xd + yd * yd, p2 * xd + p1 * yd
    radial, tangential = GUESS_TERMS[0], GUESS_TERMS[1] if p1 or p2 else 0
    columns = [(xd * rr**k, yd * rr**k) for k in range(1, radial + 1)]
    columns += [(xd * s * rr**k, yd * s * rr**k) for k in range(tangential)]
    columns += [(p2 * rr**k, p1 * rr**k) for k in range(1, tangential + 1)]
    a = np.array([np.concatenate(pair) for pair in columns]).T
    size = np.abs(a).max(axis=0)
    found = (np.linalg.lstsq(a / size, np.concatenate([x - xd, y - yd]), rcond=None)[0] / size).tolist()
    ends = radial, radial + tangential
    return Inverse(0, tuple(found[: ends[0]]), tuple(found[ends[0] : ends[1]]), tuple(found[ends[1] :]))


def _error(x: np.ndarray, y: np.ndarray, xd: np.ndarray, yd: np.ndarray, camera: Camera) -> float:
    bx, by = distort(x, y, camera.coefficients)
    return float(np.hypot(bx - xd, by - yd).max())


def _monotone(x: np.ndarray, y: np.ndarray, dist: tuple) -> bool:
    """The radial part r (1 + k1 r² + ...) grows all the way out to the farthest point."""
    k1, k2, _, _, k3 = dist
    rr = np.linspace(0.0, float((x * x + y * y).max()), 257)
    return bool((1 + rr * (3 * k1 + rr * (5 * k2 + rr * 7 * k3))).min() > 0)


def camera_ray(u: Any, v: Any, camera: Camera, inverse: Inverse | None = None) -> Vec:
    """(x, y, 1) / |(x, y, 1)|: the unit direction, in the camera's frame, of the ray through pixel (u, v).

    `u`, `v`: pixels, (0, 0) is the centre of the top-left one; arrays of one shape, or that broadcast to one.
    `inverse` undoes the distortion; without one, the camera's own is found.
    """
    x, y = (u - camera.cx) * (1 / camera.fx), (v - camera.cy) * (1 / camera.fy)
    x, y = undistort(x, y, camera.coefficients, inverse or invert_lens(camera))
    scale = 1 / sqrt(x * x + y * y + 1)
    return x * scale, y * scale, scale


def back_project(u: Any, v: Any, camera: Camera, inverse: Inverse | None = None) -> Vec:
    """Rᵀ camera_ray: the same direction in the board's frame."""
    return to_board(camera_ray(u, v, camera, inverse), camera)


def to_board(vector: Vec, camera: Camera) -> Vec:
    """Rᵀ vector: from the camera's axes to the board's."""
    return tuple(dot(column, vector) for column in zip(*camera.R_cam_board, strict=True))
