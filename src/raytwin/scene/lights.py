"""Where light comes from.

To add a light, write its record, give Scene a field for it, and see `raytwin.tracer.lights`.
"""

import math

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from raytwin.errors import InputError
from raytwin.scene.camera import UNTURNED
from raytwin.scene.record_base import Matrix, PixelCount, Radiance, Record, Vector


class Sun(Record, frozen=True):
    """[sun]: a distant light: `to_light` points to it, unit; `irradiance` is what a surface facing it receives.

    A direction of another length is normalized when the record is made.
    """

    to_light: Vector
    irradiance: Radiance = (3.0, 3.0, 3.0)

    def __post_init__(self) -> None:
        if not math.hypot(*self.to_light) > 0:
            raise InputError("to_light", "a direction", "the zero vector")
        # A direction that is unit to rounding is left as it is, however often its record is copied.
        while abs((length := math.hypot(*self.to_light)) - 1) > 1e-15:
            x, y, z = self.to_light
            msgspec.structs.force_setattr(self, "to_light", (x / length, y / length, z / length))


class Environment(Record, frozen=True, omit_defaults=True):
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
    R_map_board: Matrix = UNTURNED

    @property
    def radiance(self) -> np.ndarray:
        """(rows, columns, 3)."""
        return np.frombuffer(self.texels, "<f4").reshape(self.size[1], self.size[0], 3)


class Sky(Record, frozen=True):
    """[sky]: `radiance`, the same from every direction, and the background behind all objects; or a map.

    `map` is a file's name, `texels` what was read from it.
    """

    radiance: Radiance = (0.0, 0.0, 0.0)
    map: str | UnsetType = UNSET
    texels: Environment | UnsetType = UNSET

    def __post_init__(self) -> None:
        if self.texels is not UNSET and any(self.radiance):
            raise InputError("radiance", "radiance or map", "both")

    @property
    def environment(self) -> Environment | None:
        """Return the map; None for a constant sky."""
        return None if self.texels is UNSET else self.texels
