"""A camera: intrinsics, distortion, and where it stands; or, in a scene.toml, from where it looks at what."""

import math
from typing import Annotated, Any

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.images.limits import MAX_PIXELS
from raytwin.scene.record_base import Matrix, PixelCount, Record, Vector


class Camera(Record, frozen=True):
    """`p_cam = R_cam_board @ p_board + t_cam_board`, then distort, then `u = fx x + cx`, `v = fy y + cy`.

    OpenCV's camera frame (x right, y down, z forward) and OpenCV's pixels: (0, 0) is the centre of the top-left pixel.
    `dist` is any prefix of k1, k2, p1, p2, k3; further terms of OpenCV's are taken where they are 0. `image_size` is
    (width, height); K is in pixels; t is in metres. Raises InputError unless the focal lengths are positive and R is a
    rotation, to 1e-6.
    """

    image_size: tuple[PixelCount, PixelCount]
    K: Matrix
    R_cam_board: Matrix
    t_cam_board: Vector
    dist: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.width * self.height > MAX_PIXELS:
            found = f"{self.width} x {self.height}"
            raise InputError("image_size", f"at most {MAX_PIXELS / 1e6:.0f} megapixels", found)
        (fx, skew, _), (zero, fy, _), last = self.K
        if not (fx > 0 and fy > 0):
            raise InputError("K", "focal lengths > 0 px", f"{fx:g} and {fy:g}")
        if (skew, zero, *last) != (0, 0, 0, 0, 1):
            raise InputError("K", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] (cameras here have no skew)", self.K)
        if wrong := _no_rotation(np.asarray(self.R_cam_board)):
            raise InputError("R_cam_board", "a rotation matrix", wrong)
        if any(self.dist[5:]):
            raise InputError("dist", "k1, k2, p1, p2, k3, and 0 for any further term", list(self.dist))
        msgspec.structs.force_setattr(self, "dist", tuple(self.dist[:5]))

    @property
    def width(self) -> int:
        return self.image_size[0]

    @property
    def height(self) -> int:
        return self.image_size[1]

    @property
    def fx(self) -> float:
        return self.K[0][0]

    @property
    def fy(self) -> float:
        return self.K[1][1]

    @property
    def cx(self) -> float:
        return self.K[0][2]

    @property
    def cy(self) -> float:
        return self.K[1][2]

    @property
    def coefficients(self) -> tuple[float, float, float, float, float]:
        """Return k1, k2, p1, p2, k3, with 0 for those not given."""
        k1, k2, p1, p2, k3 = (*self.dist, *(0.0,) * (5 - len(self.dist)))
        return k1, k2, p1, p2, k3

    @property
    def eye(self) -> Vector:
        """Return the camera's centre in the board frame, metres: -R^T t."""
        x, y, z = (-np.asarray(self.R_cam_board).T @ np.asarray(self.t_cam_board)).tolist()
        return x, y, z

    def grid(self, x: float = 0, y: float = 0, step: float = 1, size: tuple[int, int] | None = None) -> "Camera":
        """Return the camera whose pixel (u, v) sees what this one's (x + step u, y + step v) sees.

        `size` is (width, height), by default this camera's.
        """
        K = (
            (self.fx / step, 0.0, (self.cx - x) / step),
            (0.0, self.fy / step, (self.cy - y) / step),
            (0.0, 0.0, 1.0),
        )
        return msgspec.structs.replace(self, image_size=size or self.image_size, K=K)

    def every(self, step: int) -> "Camera":
        """Return the camera of every `step`-th pixel in every `step`-th row, starting with the first."""
        return self.grid(step=step, size=(-(-self.width // step), -(-self.height // step)))

    def resized(self, width: int, height: int) -> "Camera":
        """Return the same camera with another number of pixels on the same sensor.

        Pixel centres are integers, so a scale s maps u to s (u + 1/2) - 1/2: the image's corner stays where it is.
        """
        sx, sy = width / self.width, height / self.height
        K = (
            (self.fx * sx, 0.0, (self.cx + 0.5) * sx - 0.5),
            (0.0, self.fy * sy, (self.cy + 0.5) * sy - 0.5),
            (0.0, 0.0, 1.0),
        )
        return msgspec.structs.replace(self, image_size=(width, height), K=K)


def _no_rotation(R: np.ndarray) -> str:
    """Return why R is no rotation, and what to write in its place; empty for one, to 1e-6.

    A rounded matrix is not mended in silence: the file, the scene's hash and the dict that a subject gets would each
    have another pose.
    """
    if not np.abs(R).max() <= 1.1:  # NaN too
        return "numbers beyond -1 to 1"
    if np.abs(R @ R.T - np.eye(3)).max() <= 1e-6:
        return "" if np.linalg.det(R) > 0 else "a mirroring (determinant -1): negate an axis"
    u, _, v = np.linalg.svd(R)
    off, nearest = np.abs(R - u @ v).max(), (np.round(u @ v, 9) + 0.0).tolist()
    return f"one that is off by {off:.2g}. The nearest is {nearest}"


UNTURNED: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NOWHERE = Camera((1, 1), UNTURNED, UNTURNED, (0.0, 0.0, 0.0))
"""Stands in for a camera that has yet to be found in photos."""

LEAST_SINE = 1e-6
"""Sine of the angle between the view and `up`: below this, the direction of up is undefined."""


class LookAt(Record, frozen=True):
    """A pinhole in the board's frame, metres. `fov_x`: degrees across the whole image."""

    eye: Vector
    target: Vector
    fov_x: Annotated[float, msgspec.Meta(gt=0, lt=180)]
    up: Vector = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
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
        (w, h), R = self.image_size, self.look_at.rotation()
        f = w / 2 / math.tan(math.radians(self.look_at.fov_x) / 2)
        K = ((f, 0.0, (w - 1) / 2), (0.0, f, (h - 1) / 2), (0.0, 0.0, 1.0))
        rows: Any = tuple(map(tuple, R.tolist()))
        t: Any = tuple((-R @ np.asarray(self.look_at.eye)).tolist())
        return Camera(self.image_size, K, rows, t, self.dist)
