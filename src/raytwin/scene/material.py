"""How a surface sends light back. To add a material, write its record and add it to the union."""

from raytwin.errors import InputError
from raytwin.scene.record_base import Albedo, Positive, Record


class Lambert(Record, frozen=True):
    """The same radiance in every direction: albedo/π of the irradiance, per colour channel."""

    albedo: Albedo = (0.8, 0.8, 0.8)


class Phong(Record, frozen=True):
    """albedo/π + specular (n + 2)/(2π) max(0, r·v)ⁿ: Lambert's, and a highlight about r, the mirrored light.

    n is the `exponent`; r = 2 (n·l) n - l for a light towards l, v points to the eye. By the factor (n + 2)/(2π) a
    highlight sends back at most `specular` of the light, and just that where it is lit head on (Lafortune and Willems,
    "Using the Modified Phong Reflectance Model for Physically Based Rendering", 1994, eq. 8).
    """

    albedo: Albedo = (0.5, 0.5, 0.5)
    specular: Albedo = (0.2, 0.2, 0.2)
    exponent: Positive = 20.0

    def __post_init__(self) -> None:
        if (most := max(a + s for a, s in zip(self.albedo, self.specular, strict=True))) > 1 + 1e-12:
            raise InputError("specular", "albedo and specular that sum to 1 at most", f"{most:g}")


Material = Lambert | Phong
