"""[camera] look_at in a scene.toml: a pinhole camera by where it stands and what it looks at."""

import math
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from raytwin.errors import InputError
from raytwin.scene.camera import Camera
from raytwin.scene.record_base import PixelCount, Positive, Record, Vector

LEAST_SINE = 1e-6
"""Sine of the angle between the view and `up`: below this, the direction of up is undefined."""


class LookAt(Record, frozen=True):
    """Metres in the board's frame. `fov_x`: degrees across the whole image; or `fx`: the focal length in pixels."""

    eye: Vector
    target: Vector
    up: Vector = (0.0, 0.0, 1.0)
    fov_x: Annotated[float, msgspec.Meta(gt=0, lt=180)] | UnsetType = UNSET
    fx: Positive | UnsetType = UNSET

    def __post_init__(self) -> None:
        if (self.fov_x is UNSET) == (self.fx is UNSET):
            raise InputError("fov_x", "fov_x or fx", "neither" if self.fx is UNSET else "both")
        self.rotation()

    def rotation(self) -> np.ndarray:
        """Return R_cam_board (3, 3): its rows are right, down and forward. Raises InputError where it is undefined."""
        if self.target == self.eye:
            raise InputError("target", "another point than eye", self.target)
        way = np.subtract(self.target, self.eye)
        forward = way / np.linalg.norm(way)
        right = np.cross(forward, np.divide(self.up, np.linalg.norm(self.up) or 1))
        if np.linalg.norm(right) < LEAST_SINE:
            raise InputError("up", "a direction that the camera does not look along", self.up)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(forward, right), forward])


class LookAtCamera(Record, frozen=True):
    """The [camera] table with `look_at`: square pixels, no distortion unless `dist` is given."""

    image_size: tuple[PixelCount, PixelCount]
    look_at: LookAt
    dist: tuple[float, ...] = ()

    def camera(self) -> Camera:
        (w, h), at, R = self.image_size, self.look_at, self.look_at.rotation()
        fx = at.fx if isinstance(at.fx, float) else w / 2 / math.tan(math.radians(float(at.fov_x or 0)) / 2)
        K = ((fx, 0.0, (w - 1) / 2), (0.0, fx, (h - 1) / 2), (0.0, 0.0, 1.0))
        rows: Any = tuple(map(tuple, R.tolist()))
        t: Any = tuple((-R @ np.asarray(self.look_at.eye)).tolist())
        return Camera(self.image_size, K, rows, t, self.dist)
