"""How many steps of Newton's method undo a lens: counted once per camera."""

from functools import lru_cache

import numpy as np

from raytwin.scene import Camera
from raytwin.scene.lens import NEWTON_STEPS, check_lens, distort, undone
from raytwin.tracer.pixel_to_ray import undistort

SAME_ROOT_WITHIN = 1e-4
"""Solutions farther apart than this, in normalised coordinates, are different roots; rounding moves them far less."""


@lru_cache(maxsize=64)
def newton_steps(camera: Camera, precision: str = "float64") -> int:
    """Return the fewest steps of `undistort` that come back to rounding from all over the frame; 0 for a pinhole.

    Raises InputError where `check_lens` does.
    """
    dist = camera.coefficients
    if not any(dist):
        return 0
    check_lens(camera)
    known = undone(camera.K, camera.dist, camera.image_size)
    xd, yd = ((known.pixels[known.found] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)).T
    enough = 2e-14 if precision == "float64" else 2e-8
    with np.errstate(all="ignore"):
        for steps in range(NEWTON_STEPS):
            ended = undistort(xd, yd, dist, steps)
            apart = np.hypot(*(ended - known.ideal[known.found].T)).max()  # large at a root beyond a fold
            if np.hypot(*np.subtract(distort(*ended, dist), (xd, yd))).max() < enough and apart < SAME_ROOT_WITHIN:
                return steps
    return NEWTON_STEPS
