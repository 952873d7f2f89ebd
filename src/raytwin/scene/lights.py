"""Where light comes from. To add a light, write its record, add it to the union, and see `raytwin.lights`."""

import math

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.scene.record_base import Matrix, PixelCount, Radiance, Record, Vector


class Sun(Record, frozen=True, tag="sun"):
    """A distant light: `to_light` points to it, unit; `irradiance` is what a surface facing it receives.

    A direction of another length is normalized when the record is made.
    """

    to_light: Vector
    irradiance: Radiance = (3.0, 3.0, 3.0)

    def __post_init__(self) -> None:
        if not math.hypot(*self.to_light) > 0:
            raise InputError("Sun.to_light", "a direction", "the zero vector")
        # A direction that is unit to rounding is left as it is, however often its record is copied.
        while abs((length := math.hypot(*self.to_light)) - 1) > 1e-15:
            x, y, z = self.to_light
            msgspec.structs.force_setattr(self, "to_light", (x / length, y / length, z / length))


class Sky(Record, frozen=True, tag="sky"):
    """A constant sky: the same radiance from every direction, and the background behind all objects."""

    radiance: Radiance = (0.0, 0.0, 0.0)


class Environment(Record, frozen=True, tag="environment"):
    """A sky that differs by direction: a map of columns x rows pixels, also what the camera sees past every object.

    For the direction (x, y, z) in the map's axes, z up, u = 1/2 + atan2(x, y) / 2π runs along the columns and
    v = acos(z) / π down the rows: the middle of the map looks along +y, with +x to its right and +z at its top. Pixel
    (i, j) has its centre at u = (i + 1/2) / columns, v = (j + 1/2) / rows; between centres the map is bilinear, round
    and round along u, and constant from the first and last row's centres to the poles.

    `texels`: linear radiance, float32, little-endian, row by row, three per pixel; `R_map_board` turns the board's axes
    into the map's.
    """

    size: tuple[PixelCount, PixelCount]
    texels: bytes
    R_map_board: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    @property
    def radiance(self) -> np.ndarray:
        """(rows, columns, 3)."""
        return np.frombuffer(self.texels, "<f4").reshape(self.size[1], self.size[0], 3)

    def scaled(self, by: float) -> "Environment":
        return msgspec.structs.replace(self, texels=(self.radiance * np.float32(by)).tobytes())


Light = Sun | Sky | Environment
