"""A camera that has been found: intrinsics, distortion, and where it stands."""

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.scene.record_base import Matrix, PixelCount, Record, Vector

FURTHER = "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"
"""What follows k3 in OpenCV's order: the terms that this lens lacks."""


class Camera(Record, frozen=True):
    """`p_cam = R_cam_board @ p_board + t_cam_board`, then distort, then `u = fx x + cx`, `v = fy y + cy`.

    OpenCV's camera frame (x right, y down, z forward) and OpenCV's pixels: (0, 0) is the centre of the top-left pixel.
    `dist` is any prefix of k1, k2, p1, p2, k3, or OpenCV's 8, 12 or 14 numbers if all further ones are 0. `image_size`
    is (width, height); K is in pixels; t is in metres.
    """

    image_size: tuple[PixelCount, PixelCount]
    K: Matrix
    R_cam_board: Matrix
    t_cam_board: Vector
    dist: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for number, (name, value) in enumerate(zip(FURTHER, self.dist[5:], strict=False), start=5):
            if value:
                raise InputError(f"dist[{number}]", f"0 ({name}: the lens here has k1, k2, p1, p2, k3 alone)", value)
        if len(self.dist) > 5:
            if len(self.dist) > 5 + len(FURTHER):
                raise InputError("dist", f"at most {5 + len(FURTHER)} numbers", len(self.dist))
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
        (a, s, cx), (z, b, cy), last = self.K
        K = ((a / step, s / step, (cx - x) / step), (z, b / step, (cy - y) / step), last)
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
            (self.fx * sx, self.K[0][1] * sx, (self.cx + 0.5) * sx - 0.5),
            (0.0, self.fy * sy, (self.cy + 0.5) * sy - 0.5),
            (0.0, 0.0, 1.0),
        )
        return msgspec.structs.replace(self, image_size=(width, height), K=K)


UNTURNED: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NOWHERE = Camera((1, 1), UNTURNED, UNTURNED, (0.0, 0.0, 0.0))
"""Stands in for a camera that has yet to be found in photos."""
