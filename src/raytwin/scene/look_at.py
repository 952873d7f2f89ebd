"""[camera] look_at in a scene.toml: a pinhole camera by where it stands and what it looks at."""

import math
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from raytwin.errors import InputError
from raytwin.scene import PixelCount, Positive, Record, Vector
from raytwin.scene.toml_json import to_record

LEAST_SINE = 1e-6
"""Sine of the angle between the view and `up`: below this, the direction of up is undefined."""


class LookAt(Record, frozen=True):
    """Metres in the board's frame. `fov_x`: degrees across the whole image; or `fx`: the focal length in pixels."""

    eye: Vector
    target: Vector
    up: Vector = (0.0, 0.0, 1.0)
    fov_x: Annotated[float, msgspec.Meta(gt=0, lt=180)] | UnsetType = UNSET
    fx: Positive | UnsetType = UNSET


class LookAtCamera(Record, frozen=True):
    """The [camera] table with `look_at`: square pixels, no distortion unless `dist` is given."""

    image_size: tuple[PixelCount, PixelCount]
    look_at: LookAt
    dist: tuple[float, ...] = ()


def camera_table(file: Path, table: dict[str, Any]) -> dict[str, Any]:
    """The same [camera] with K, R_cam_board and t_cam_board in the place of `look_at`."""
    where = f"{file}: camera.look_at"
    if given := table.keys() & {"K", "R_cam_board", "t_cam_board"}:
        raise InputError(f"{file}: camera", f"look_at or {', '.join(sorted(given))}", "both")
    written = to_record(file, table, LookAtCamera, "camera")
    at, (w, h) = written.look_at, written.image_size
    if (at.fov_x is UNSET) == (at.fx is UNSET):
        raise InputError(where, "fov_x or fx", "neither" if at.fx is UNSET else "both")
    fx = at.fx if isinstance(at.fx, float) else w / 2 / math.tan(math.radians(float(at.fov_x or 0)) / 2)
    eye, up = np.asarray(at.eye), np.asarray(at.up)
    forward = np.asarray(at.target) - eye
    away, tall = float(np.linalg.norm(forward)), float(np.linalg.norm(up))
    if not away > 0:
        raise InputError(f"{where}.target", "another point than eye", at.target)
    if not tall > 0:
        raise InputError(f"{where}.up", "a direction", "the zero vector")
    right = np.cross(forward / away, up / tall)
    if np.linalg.norm(right) < LEAST_SINE:
        raise InputError(f"{where}.up", "a direction that the camera does not look along", at.up)
    right /= np.linalg.norm(right)
    R = np.array([right, np.cross(forward / away, right), forward / away])
    return {
        "image_size": [w, h],
        "K": [[fx, 0.0, (w - 1) / 2], [0.0, fx, (h - 1) / 2], [0.0, 0.0, 1.0]],
        "R_cam_board": R.tolist(),
        "t_cam_board": (-R @ eye).tolist(),
        "dist": list(written.dist),
    }
