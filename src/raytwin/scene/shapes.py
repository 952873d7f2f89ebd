"""What rays meet. To add a shape, write its record with the answers that these two give, and add it to the union.

Rays meet it by `tracer.world.intersect`, kernels look it up in `fast.fast_world.SHAPES`, boxes are round it in
`fast.boxes`, and Mitsuba's is made in `twin.twin_scene`.
"""

import math
from itertools import product
from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from raytwin.errors import InputError
from raytwin.scene.record_base import Albedo, Positive, Record, Vector, unchecked

ObjectName = Annotated[str, msgspec.Meta(min_length=1, max_length=40)]


class Painted:
    """A shape's last fields: Lambert's albedo, Phong's highlight where it has `specular` and `exponent`, and a name.

    f = albedo/π + specular (n + 2)/(2π) max(0, r·v)ⁿ, per colour channel: n is the `exponent`; r = 2 (n·l) n - l for a
    light towards l, v points to the eye. By the factor (n + 2)/(2π) a highlight sends back at most `specular` of the
    light, and just that where it is lit head on (Lafortune and Willems, "Using the Modified Phong Reflectance Model for
    Physically Based Rendering", 1994, eq. 8).

    What is unset is not in the scene's hash, so that a new key leaves the hashes of old scenes as they were.
    """

    __slots__ = ()
    albedo: Albedo
    specular: Albedo | UnsetType
    exponent: float | UnsetType
    name: str | UnsetType

    def __post_init__(self) -> None:
        if (self.specular is UNSET) != (self.exponent is UNSET):
            raise InputError("specular", "both specular and exponent", "one of them")
        if self.highlight:
            most = max(a + s for a, s in zip(self.albedo, self.highlight[0], strict=True))
            if most > 1 + 1e-12:
                raise InputError("specular", "albedo and specular that sum to 1 at most", f"{most:g}")

    @property
    def highlight(self) -> tuple[Albedo, float] | None:
        """Return specular and exponent; None where it is matt."""
        return None if self.specular is UNSET or self.exponent is UNSET else (self.specular, self.exponent)


class Sphere(Record, Painted, frozen=True):
    """[[spheres]]: |p - center| = radius, metres. `name`: what people call it."""

    kind: ClassVar[str] = "sphere"
    in_photo: ClassVar[bool] = False
    center: Vector
    radius: Positive
    albedo: Albedo = (0.8, 0.8, 0.8)
    specular: Albedo | UnsetType = UNSET
    exponent: Positive | UnsetType = UNSET
    name: ObjectName | UnsetType = UNSET

    @property
    def facing(self) -> tuple[Vector, float]:
        """Return (flat, curvature), metres⁻¹: the normal at p is flat + curvature (p - center)."""
        return (0.0, 0.0, 0.0), 1 / self.radius

    @property
    def sizes(self) -> tuple[float, ...]:
        """Return its lengths, metres; none of its points is farther from the centre than their hypotenuse."""
        return (self.radius,)

    def extent(self, axes: np.ndarray) -> Vector:
        """Return half of its size along each of three unit vectors, the rows of `axes`, metres."""
        return self.radius, self.radius, self.radius

    def corners(self) -> np.ndarray:
        """Return (8, 3): those of the cube around it, from its centre, metres."""
        return np.array(list(product((-self.radius, self.radius), repeat=3)))

    def turned(self, R: np.ndarray, center: Vector) -> "Sphere":
        """Return the sphere about `center`; a rotation R (3, 3) changes no more."""
        return unchecked(self, center=center)


class Rectangle(Record, Painted, frozen=True):
    """[[planes]]: `center ± half_u ± half_v`, visible and lit from both sides.

    `half_u` and `half_v` are half-edges in metres, perpendicular to 1e-6. `in_photo` marks what a photo already shows
    (the board, the table): it catches shadows, but `photo draw` does not draw it.
    """

    kind: ClassVar[str] = "plane"
    center: Vector
    half_u: Vector
    half_v: Vector
    albedo: Albedo = (0.8, 0.8, 0.8)
    specular: Albedo | UnsetType = UNSET
    exponent: Positive | UnsetType = UNSET
    in_photo: bool = False
    name: ObjectName | UnsetType = UNSET

    def __post_init__(self) -> None:
        super().__post_init__()
        u, v = math.hypot(*self.half_u), math.hypot(*self.half_v)
        if not u * v > 0:
            raise InputError("half_u", "half_u and half_v longer than 0 m", f"{self.half_u}, {self.half_v}")
        cosine = sum(a / u * b / v for a, b in zip(self.half_u, self.half_v, strict=True))
        if abs(cosine) > 1e-6:
            found = f"{math.degrees(math.acos(min(max(cosine, -1), 1))):.4g} degrees"
            raise InputError("half_v", "a vector perpendicular to half_u", found)

    @property
    def normal(self) -> Vector:
        """Return the unit normal half_u × half_v / |half_u × half_v|."""
        n = np.cross(self.half_u, self.half_v)
        x, y, z = (n / np.linalg.norm(n)).tolist()
        return x, y, z

    @property
    def facing(self) -> tuple[Vector, float]:
        """Return (flat, curvature), metres⁻¹: the normal at p is flat + curvature (p - center)."""
        return self.normal, 0.0

    @property
    def sizes(self) -> tuple[float, ...]:
        """Return its lengths, metres; none of its points is farther from the centre than their hypotenuse."""
        return math.hypot(*self.half_u), math.hypot(*self.half_v)

    def extent(self, axes: np.ndarray) -> Vector:
        """Return half of its size along each of three unit vectors, the rows of `axes`, metres."""
        x, y, z = np.abs(np.array([self.half_u, self.half_v]) @ axes.T).sum(axis=0).tolist()
        return x, y, z

    def corners(self) -> np.ndarray:
        """Return (4, 3): its corners, from its centre, metres."""
        u, v = np.array([self.half_u, self.half_v])
        return np.array([i * u + j * v for i, j in product((-1, 1), repeat=2)])

    def turned(self, R: np.ndarray, center: Vector) -> "Rectangle":
        """Return the rectangle about `center`, its edges turned by R (3, 3)."""
        edges: Any = (np.array([self.half_u, self.half_v]) @ R.T).tolist()
        return unchecked(self, center=center, half_u=tuple(edges[0]), half_v=tuple(edges[1]))


Shape = Sphere | Rectangle
