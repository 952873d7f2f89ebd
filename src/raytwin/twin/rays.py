"""Pixel to ray in the camera's frame: the inverse of OpenCV's distortion, in float64, on NumPy or Dr.Jit."""

from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from raytwin.errors import InputError
from raytwin.scene import Camera

STEPS = 10


class Lens(NamedTuple):
    """K's numbers and k1, k2, p1, p2, k3 (none: a pinhole), as floats or as Dr.Jit parameters."""

    fx: Any
    fy: Any
    cx: Any
    cy: Any
    coefficients: tuple[Any, ...] = ()


def lens(camera: Camera) -> Lens:
    used = camera.coefficients if any(camera.coefficients) else ()
    return Lens(camera.fx, camera.fy, camera.cx, camera.cy, used)


def distort(x: Any, y: Any, coefficients: tuple[Any, ...]) -> tuple[Any, Any, Any, Any, Any]:
    """x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), y alike; and the Jacobian's xx, xy (= yx), yy."""
    k1, k2, p1, p2, k3 = coefficients
    rr = x * x + y * y
    radial = 1 + rr * (k1 + rr * (k2 + rr * k3))
    slope = 2 * (k1 + rr * (2 * k2 + rr * 3 * k3))  # so that d radial = slope (x dx + y dy)
    xd = x * radial + 2 * p1 * x * y + p2 * (rr + 2 * x * x)
    yd = y * radial + p1 * (rr + 2 * y * y) + 2 * p2 * x * y
    xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
    xy = x * y * slope + 2 * p1 * x + 2 * p2 * y
    yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
    return xd, yd, xx, xy, yy


def undistort(xd: Any, yd: Any, coefficients: tuple[Any, ...]) -> tuple[Any, Any]:
    """The (x, y) that `distort` maps to (xd, yd): STEPS of Newton's method from (xd, yd)."""
    x, y = xd, yd
    for _ in range(STEPS):
        fx, fy, xx, xy, yy = distort(x, y, coefficients)
        ex, ey = fx - xd, fy - yd
        scale = 1 / (xx * yy - xy * xy)
        x, y = x - (yy * ex - xy * ey) * scale, y - (xx * ey - xy * ex) * scale
    return x, y


def directions(xp: ModuleType, lens: Lens, u: Any, v: Any) -> tuple[Any, Any, Any]:
    """(x, y, 1) / |(x, y, 1)|: the unit direction, camera frame, through pixel (u, v); `xp` is numpy or drjit.

    `u`, `v`: float64 pixels, (0, 0) is the centre of the top-left one. float32 would move an outline by 1e-4 of the
    focal length's digits: at 12 MP that is a tenth of a pixel.
    """
    x, y = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    if lens.coefficients:
        x, y = undistort(x, y, lens.coefficients)
    scale = 1 / xp.sqrt(x * x + y * y + 1)
    return x * scale, y * scale, scale


def check_invertible(camera: Camera) -> None:
    """Raise InputError where the distortion cannot be undone somewhere in the image.

    It can where Newton's method comes back to the pixel (to 1e-6 px) and where the Jacobian stays positive from the
    optical axis out to the solution: past a fold, two directions share a pixel. Tested on a grid and along the border.
    """
    if not any(camera.coefficients):
        return
    w, h = camera.image_size
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(-0.5, w - 0.5, 65), np.linspace(-0.5, h - 0.5, 65)))
    xd, yd = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    with np.errstate(all="ignore"):
        x, y = undistort(xd, yd, camera.coefficients)
        bx, by, *_ = distort(x, y, camera.coefficients)
        off = np.hypot((bx - xd) * camera.fx, (by - yd) * camera.fy)
        along = np.linspace(0, 1, 33)[:, None]
        _, _, xx, xy, yy = distort(x * along, y * along, camera.coefficients)
        folded = ((xx * yy - xy * xy <= 0) | (xx + yy <= 0)).any(axis=0)
    bad = ~(off < 1e-6) | folded
    if bad.any():
        i = int(np.argmax(np.where(bad, np.nan_to_num(off, nan=np.inf), -1)))
        how = "two directions share it" if folded[i] and off[i] < 1e-6 else f"off by {off[i]:.3g} px"
        raise InputError(
            "camera.dist",
            "a distortion that can be undone over the whole image",
            f"{list(camera.dist)}, which cannot at pixel ({u[i]:.0f}, {v[i]:.0f}): {how}",
        )
