"""What rays meet. To add a shape, write its record and add it to the union."""

import math

import numpy as np
from msgspec import UNSET, UnsetType

from raytwin.scene.material import Lambert, Material
from raytwin.scene.record_base import Albedo, Positive, Record, Vector


class Sphere(Record, frozen=True, tag="sphere"):
    """|p - center| = radius, metres. `name`: what people call it."""

    center: Vector
    radius: Positive
    material: Material = Lambert()
    name: str | UnsetType = UNSET

    @property
    def reach(self) -> float:
        """Return how far its farthest point is from its centre, metres."""
        return self.radius

    def extent(self) -> Vector:
        """Return half of its size along each of the board's axes, metres."""
        return self.radius, self.radius, self.radius

    @property
    def albedo(self) -> Albedo:
        """Return the material's diffuse albedo."""
        return self.material.albedo


class Rectangle(Record, frozen=True, tag="rectangle"):
    """`center ± half_u ± half_v`, visible and lit from both sides.

    `half_u` and `half_v` are perpendicular half-edges in metres. `in_photo` marks what a photo already shows (the
    board, the table): it catches shadows, but `augment` does not draw it.
    """

    center: Vector
    half_u: Vector
    half_v: Vector
    material: Material = Lambert()
    in_photo: bool = False
    name: str | UnsetType = UNSET

    @property
    def reach(self) -> float:
        """Return how far its farthest point is from its centre, metres."""
        return math.hypot(*self.half_u, *self.half_v)

    def extent(self) -> Vector:
        """Return half of its size along each of the board's axes, metres."""
        x, y, z = (abs(u) + abs(v) for u, v in zip(self.half_u, self.half_v, strict=True))
        return x, y, z

    @property
    def albedo(self) -> Albedo:
        """Return the material's diffuse albedo."""
        return self.material.albedo

    @property
    def normal(self) -> Vector:
        """Return the unit normal half_u × half_v / |half_u × half_v|."""
        n = np.cross(self.half_u, self.half_v)
        x, y, z = (n / np.linalg.norm(n)).tolist()
        return x, y, z


Shape = Sphere | Rectangle
