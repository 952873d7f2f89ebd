"""A scene is a camera, spheres and rectangles under a sun and a sky: plain frozen records, lengths in metres.

Vectors are tuples of three floats, matrices are tuples of rows. All positions and directions are in the board frame
(right-handed, X and Y in the board's plane, Z out of the printed face towards the viewer) unless a name says otherwise.
"""

import math
from typing import Annotated

import msgspec
import numpy as np

Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]
PixelCount = Annotated[int, msgspec.Meta(ge=1, le=100_000)]

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Albedo = tuple[Fraction, Fraction, Fraction]
Radiance = tuple[NonNegative, NonNegative, NonNegative]


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The base of every record: immutable, compared by value, strict about unknown fields."""


class Camera(Record, frozen=True):
    """`p_cam = R_cam_board @ p_board + t_cam_board`, then distort, then `u = fx x + cx`, `v = fy y + cy`.

    OpenCV's camera frame (x right, y down, z forward) and OpenCV's pixels: (0, 0) is the centre of the top-left pixel.
    `dist` is any prefix of k1, k2, p1, p2, k3. `image_size` is (width, height); K is in pixels; t is in metres.
    """

    image_size: tuple[PixelCount, PixelCount]
    K: Matrix
    R_cam_board: Matrix
    t_cam_board: Vector
    dist: Annotated[tuple[float, ...], msgspec.Meta(max_length=5)] = ()

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
        """k1, k2, p1, p2, k3, the missing ones 0."""
        return (*self.dist, *(0.0,) * (5 - len(self.dist)))

    @property
    def eye(self) -> Vector:
        """The camera's centre in the board frame, metres: -R^T t."""
        return tuple((-np.asarray(self.R_cam_board).T @ np.asarray(self.t_cam_board)).tolist())

    def resized(self, width: int, height: int) -> "Camera":
        """The same camera with another number of pixels over the same sensor.

        Pixel centres are integers, so a scale s maps u to s (u + 1/2) - 1/2: the image's corner stays where it is.
        """
        sx, sy = width / self.width, height / self.height
        K = (
            (self.fx * sx, self.K[0][1] * sx, (self.cx + 0.5) * sx - 0.5),
            (0.0, self.fy * sy, (self.cy + 0.5) * sy - 0.5),
            (0.0, 0.0, 1.0),
        )
        return msgspec.structs.replace(self, image_size=(width, height), K=K)


class PhotoCamera(Record, frozen=True):
    """A camera yet to be found: calibrate it from `photos` of `board`, and stand where `photo` was taken.

    Paths are relative to the scene's folder. `model` names the distortion model to fit.
    """

    photos: str
    board: str
    photo: str
    model: str = "auto"


class Sphere(Record, frozen=True):
    """A Lambertian sphere: centre and radius in metres, albedo per colour channel."""

    center: Vector
    radius: Positive
    albedo: Albedo = (0.8, 0.8, 0.8)


class Plane(Record, frozen=True):
    """A Lambertian rectangle `center ± half_u ± half_v`, seen and lit from both sides.

    `half_u` and `half_v` are perpendicular half-edges in metres. `in_photo` marks what the photo already shows (the
    board, the table): it catches shadows, but augmentation does not draw it.
    """

    center: Vector
    half_u: Vector
    half_v: Vector
    albedo: Albedo = (0.8, 0.8, 0.8)
    in_photo: bool = False

    @property
    def normal(self) -> Vector:
        """Unit normal half_u × half_v / |...|."""
        n = np.cross(self.half_u, self.half_v)
        return tuple((n / np.linalg.norm(n)).tolist())


class Pyramid(Record, frozen=True):
    """A transparent pyramid, only drawn on photos: four vertices, metres; a face's linear colour and opacity."""

    vertices: tuple[Vector, Vector, Vector, Vector]
    color: Albedo = (0.1, 0.5, 0.9)
    opacity: Fraction = 0.35


class Sun(Record, frozen=True):
    """A distant light: `to_light` points to it (any length), `irradiance` is what a surface facing it receives."""

    to_light: Vector
    irradiance: Radiance = (3.0, 3.0, 3.0)

    @property
    def direction(self) -> Vector:
        """`to_light` made unit."""
        length = math.hypot(*self.to_light)
        return tuple(c / length for c in self.to_light)


class Sky(Record, frozen=True):
    """The same radiance from every direction; also what the camera sees past every object."""

    radiance: Radiance = (0.0, 0.0, 0.0)


class Tolerance(Record, frozen=True):
    """When two noise-free images agree: every number is a bound that the comparison tests.

    `mask_pixels`: pixels in which different objects may be seen; `p999_abs`: the 99.9 % quantile of the absolute
    error of radiance, in units of radiance; `outlier_fraction`: how large a share of the pixels may err by
    more than ten times that.
    """

    mask_pixels: Annotated[int, msgspec.Meta(ge=0)] = 0
    p999_abs: Positive = 1e-5
    outlier_fraction: Fraction = 1e-4


class Scene(Record, frozen=True):
    """What is rendered, and how closely two renderings must agree."""

    name: str
    camera: Camera | PhotoCamera
    spheres: tuple[Sphere, ...] = ()
    planes: tuple[Plane, ...] = ()
    sun: Sun = Sun(to_light=(0.0, 0.0, 1.0), irradiance=(0.0, 0.0, 0.0))
    sky: Sky = Sky()
    tolerance: Tolerance = Tolerance()
    folder: str = "."
    pyramids: tuple[Pyramid, ...] = ()

    @property
    def objects(self) -> tuple[Sphere | Plane, ...]:
        """Spheres, then planes; an object's id is its index here, and -1 is the background."""
        return (*self.spheres, *self.planes)

    def with_camera(self, camera: Camera) -> "Scene":
        return msgspec.structs.replace(self, camera=camera)
