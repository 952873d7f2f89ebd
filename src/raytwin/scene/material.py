"""How a surface sends light back. To add a material, write its record and add it to the union."""

from raytwin.scene.record import Albedo, Record


class Lambert(Record, frozen=True, tag="lambert"):
    """The same radiance in every direction: albedo/π of the irradiance, per colour channel."""

    albedo: Albedo = (0.8, 0.8, 0.8)


Material = Lambert
