"""What a mirror ball shows, as maps of the light from all around: without its lamps, and of its lamps alone.

A texel is the mean of the pixels about its direction, each weighed by its solid angle and by a Gaussian of its
distance: the nearest ones fill the texels that no pixel shows. The sun's spot is left out. Clipped pixels beside it are
lamps, of which the photo tells the shape alone.
"""

from dataclasses import dataclass

import numpy as np

from raytwin.photos.boards.board import Board
from raytwin.photos.lighting.linear_photo import LAMP_CODE, LinearPhoto
from raytwin.photos.lighting.mirror_ball import (
    LEAST_COSINE,
    MAX_PIXELS_ACROSS,
    SPOT_MARGIN_PX,
    Ball,
    SunSpot,
    find_ball,
    pixels_about,
    reflect,
    sun_spot,
)
from raytwin.tracer.lights.envmap_tables import texel_directions

MAP_ROWS = 16
"""Rows of the map: more would not change a matt sphere's shading by half a per cent."""

BLUR_DEGREES = 6.0
"""Standard deviation of the Gaussian: about half a texel."""


@dataclass(frozen=True, eq=False)
class MirrorBall:
    """A mirror ball, its reflectance (3), the sun's spot in it, and the maps (rows, 2 rows, 3) of what it shows:
    without lamps, and of clipped lamps alone."""

    ball: Ball
    reflectance: np.ndarray
    spot: SunSpot | None
    dim: np.ndarray
    lamps: np.ndarray


def find_mirror(photo: LinearPhoto, board: Board, center: np.ndarray, radius: float) -> MirrorBall:
    """Return the mirror ball near the given one, see `find_ball`."""
    ball, reflectance = find_ball(photo, board, center, radius)
    spot = sun_spot(photo, ball)
    return MirrorBall(ball, reflectance, spot, *mirrored_maps(photo, ball, reflectance, spot))


def mirrored_maps(
    photo: LinearPhoto, ball: Ball, reflectance: np.ndarray, spot: SunSpot | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return two maps (rows, 2 rows, 3): radiance without lamps, and that of the clipped lamps."""
    uv = pixels_about(photo, ball, most=MAX_PIXELS_ACROSS).reshape(-1, 2)
    uv = uv[np.nan_to_num(reflect(photo, ball, photo.rays(uv))[2]) > LEAST_COSINE]
    if spot:
        uv = uv[np.linalg.norm(uv - spot.middle, axis=1) > spot.length / 2 + SPOT_MARGIN_PX - 1]
    out, right, down = (reflect(photo, ball, photo.rays(uv + np.array(s)))[1] for s in ((0, 0), (0.1, 0), (0, 0.1)))
    steradians = np.linalg.norm(np.cross(right - out, down - out), axis=1)
    radiance = np.maximum(photo.light[uv[:, 1], uv[:, 0]], 0) / reflectance
    lamp = photo.pixels[uv[:, 1], uv[:, 0]].min(axis=1, keepdims=True) >= LAMP_CODE
    texels = texel_directions(MAP_ROWS, 2 * MAP_ROWS).reshape(-1, 3)
    near = np.exp((texels @ out.T - 1) / np.radians(BLUR_DEGREES) ** 2) * steradians
    both = near @ np.c_[radiance * ~lamp, radiance * lamp] / near.sum(axis=1, keepdims=True)
    dim, lamps = both.reshape(MAP_ROWS, -1, 2, 3).transpose(2, 0, 1, 3).astype(np.float32)
    return dim, lamps
