"""A sky of the same radiance in every direction."""

from math import pi
from typing import Any, NamedTuple

from raytwin.scene import Sky
from raytwin.tracer.arrays import Vec, cos, maximum, sin, sqrt


class ConstantSky(NamedTuple):
    """The record of rays: L is its radiance."""

    L: Vec

    @property
    def sampled(self) -> bool:
        return False  # directions by the cosine serve it best

    def radiance(self, d: Vec) -> Vec:
        """L, whatever the direction."""
        return self.L

    def diffuse_irradiance(self, normal: Vec) -> Vec:
        """E/π = L, whichever way the surface faces: ∫ L max(0, n·ω) dω = π L."""
        return self.L

    def sample(self, a: Any, b: Any) -> tuple[Vec, Any]:
        """A uniform direction over the sphere from two numbers in [0, 1), and its density 1/4π per steradian."""
        z = 1 - 2 * a
        level = sqrt(maximum(1 - z * z, 0.0))
        return (level * cos(2 * pi * b), level * sin(2 * pi * b), z), 1 / (4 * pi)

    def density(self, d: Vec) -> Any:
        """The density of `sample`, per steradian."""
        return 1 / (4 * pi)


def constant_sky(sky: Sky) -> ConstantSky:
    return ConstantSky(sky.radiance)
