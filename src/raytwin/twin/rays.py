"""Pixel to ray in the camera's frame: the inverse of OpenCV's distortion, in float64, on NumPy or Dr.Jit."""

from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from raytwin.scene import Camera
from raytwin.scene.lens import NEWTON_STEPS, check_lens, distort, newton_step, without_ray

INVERSE_WITHIN_PX = 1e-8
"""Pixels: how closely the inverse must come back."""


class Lens(NamedTuple):
    """K's numbers, k1, k2, p1, p2, k3, as floats or Dr.Jit parameters, and Newton's `steps`: 0 for a pinhole."""

    fx: Any
    fy: Any
    cx: Any
    cy: Any
    coefficients: tuple[Any, ...]
    steps: int


def undistort(xd: Any, yd: Any, coefficients: tuple[Any, ...], steps: int) -> tuple[Any, Any]:
    """The (x, y) that `distort` maps to (xd, yd): some steps of Newton's method from (xd, yd)."""
    x, y = xd, yd
    for _ in range(steps):
        dx, dy = newton_step(x, y, xd, yd, coefficients)
        x, y = x + dx, y + dy
    return x, y


def directions(xp: ModuleType, lens: Lens, u: Any, v: Any) -> tuple[Any, Any, Any]:
    """(x, y, 1) / |(x, y, 1)|: the unit direction, camera frame, through pixel (u, v); `xp` is numpy or drjit.

    `u`, `v`: float64 pixels, (0, 0) is the centre of the top-left one. In float32 the rounding of u alone would move a
    12 MP image's right edge by 1e-4 px.
    """
    x, y = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    if lens.steps:
        x, y = undistort(x, y, lens.coefficients, lens.steps)
    scale = 1 / xp.sqrt(x * x + y * y + 1)
    return x * scale, y * scale, scale


def lens_of(camera: Camera) -> Lens:
    """The camera's numbers with as many of Newton's steps as its distortion needs, at most the tracer's NEWTON_STEPS.

    They come back within INVERSE_WITHIN_PX from every place of a grid that includes the image's border and has rays.
    Where the frame is folded in part, NEWTON_STEPS: the pixels that have rays are those which this many reach. Raises
    InputError where `check_lens` does, the one answer to whether a lens can be undone.
    """
    lens = Lens(camera.fx, camera.fy, camera.cx, camera.cy, camera.coefficients, 0)
    if not any(lens.coefficients):
        return lens
    check_lens(camera)
    if without_ray(camera) is not None:
        return lens._replace(steps=NEWTON_STEPS)
    w, h = camera.image_size
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(-0.5, w - 0.5, 65), np.linspace(-0.5, h - 0.5, 65)))
    xd, yd = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    with np.errstate(all="ignore"):
        for steps in (4, 6, 10):
            back = distort(*undistort(xd, yd, lens.coefficients, steps), lens.coefficients)
            if (np.hypot((back[0] - xd) * lens.fx, (back[1] - yd) * lens.fy) < INVERSE_WITHIN_PX).all():
                return lens._replace(steps=steps)
    return lens._replace(steps=NEWTON_STEPS)
