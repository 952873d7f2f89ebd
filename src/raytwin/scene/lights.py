"""Where light comes from. To add a light, write its record and add it to the union."""

import math

import msgspec

from raytwin.errors import InputError
from raytwin.scene.record import Radiance, Record, Vector


class Sun(Record, frozen=True, tag="sun"):
    """A distant light: `to_light` points to it, unit; `irradiance` is what a surface facing it receives.

    A direction of any other length is made unit when the record is made.
    """

    to_light: Vector
    irradiance: Radiance = (3.0, 3.0, 3.0)

    def __post_init__(self) -> None:
        if not math.hypot(*self.to_light) > 0:
            raise InputError("Sun.to_light", "a direction", "the zero vector")
        # One that is unit to rounding keeps its last bits, however often its record is made again.
        while abs((length := math.hypot(*self.to_light)) - 1) > 1e-15:
            x, y, z = self.to_light
            msgspec.structs.force_setattr(self, "to_light", (x / length, y / length, z / length))


class Sky(Record, frozen=True, tag="sky"):
    """The same radiance from every direction; also what the camera sees past every object."""

    radiance: Radiance = (0.0, 0.0, 0.0)


Light = Sun | Sky
