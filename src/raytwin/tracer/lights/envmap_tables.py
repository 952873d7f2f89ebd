"""The tables of an environment map, computed once however it is turned: shares of its light, and its harmonics."""

from functools import lru_cache
from math import pi
from typing import Any, NamedTuple

import numpy as np

from raytwin.scene.lights import Environment

REC_709 = np.array((0.2126, 0.7152, 0.0722))
"""Luminance of linear red, green, blue."""

Channels = tuple[Any, Any, Any]


class Tables(NamedTuple):
    """The fields of `EnvironmentMap` that do not depend on its axes."""

    texels: Channels
    rows: np.ndarray
    columns: np.ndarray
    heights: np.ndarray
    densities: np.ndarray
    harmonics: tuple[tuple[float, ...], ...]


def texel_directions(h: int, w: int) -> np.ndarray:
    """(h, w, 3): unit vectors to the texels' centres, in the map's axes: z to the top row, y to the middle column."""
    down, turn = (np.arange(h)[:, None] + 0.5) * pi / h, ((np.arange(w) + 0.5) / w * 2 - 1) * pi
    return np.stack([np.sin(down) * np.sin(turn), np.sin(down) * np.cos(turn), np.cos(down) + 0 * turn], axis=-1)


SQUARES = np.array([1, *[1 / 3] * 3, *[1 / 15] * 3, 4 / 15, 4 / 5])
"""Over the sphere the means of the squares of `environment_map.polynomials`."""
TRANSFER = np.array([1, *[2 / 3] * 3, *[1 / 4] * 5])
"""Â_l / π."""


@lru_cache(maxsize=4)
def tabulate(size: tuple[int, int], texels: bytes) -> Tables:
    """All that does not depend on which way the map is turned."""
    w, h = size
    light = np.asarray(Environment(size, texels).radiance, float)
    edges = np.cos(np.linspace(0, pi, h + 1))
    steradians = (edges[:-1] - edges[1:])[:, None] * (2 * pi / w)
    # The mean of the bilinear map over each texel: above 0 wherever any part of the texel is.
    mean = light @ REC_709
    mean = (np.roll(mean, 1, 1) + 6 * mean + np.roll(mean, -1, 1)) / 8
    padded = np.pad(mean, ((1, 1), (0, 0)), "edge")
    share = ((padded[:-2] + 6 * mean + padded[2:]) / 8 + (0 if mean.any() else 1)) * steradians
    share /= share.sum()
    of_row = share.sum(axis=1)
    rows = np.concatenate([[0], np.cumsum(of_row)])
    within = np.cumsum(share / np.where(of_row > 0, of_row, 1)[:, None], axis=1)
    columns = np.concatenate([np.zeros((h, 1)), within], axis=1).ravel()
    r, g, b = (tuple(c) for c in _harmonics(light).tolist())
    red, green, blue = (light[..., c].ravel() for c in range(3))
    return Tables((red, green, blue), rows, columns, edges, (share / steradians).ravel(), (r, g, b))


def _harmonics(light: np.ndarray) -> np.ndarray:
    """(3, 9): the factors of `diffuse_irradiance`'s polynomials for a map (h, w, 3).

    Each is Â_l / π times the mean of the map times the polynomial, over that polynomial's mean square: exact for what
    is bilinear between centres.

    A hat of a column's width 2π/w about its centre a has ∫ hat cos(m φ) = 2π/w sinc²(m π/w) cos(m a); down the rows
    Gauss's rule with 8 points in each half texel is exact to rounding.
    """
    h, w = light.shape[:2]
    turn = (2 * (np.arange(w) + 0.5) / w - 1) * pi
    narrow = [np.sinc(m / w) ** 2 / w for m in range(3)]
    c, s, c2, s2 = np.cos(turn), np.sin(turn), np.cos(2 * turn), np.sin(2 * turn)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    v = (np.arange(2 * h)[:, None] + (nodes + 1) / 2).ravel() / 2  # in rows from the top
    z, level = np.cos(v * pi / h), np.sin(v * pi / h)
    area = np.tile(weights, 2 * h) * (pi / (8 * h)) * level  # of a sphere of area 1
    place = np.clip(v - 0.5, 0, h - 1)
    upper = np.minimum(place.astype(int), h - 2)

    def down(f: np.ndarray) -> np.ndarray:
        """What each row's texels have of the integral of f down the rows."""
        lower = (place - upper) * area * f
        return np.bincount(upper, area * f - lower, h) + np.bincount(upper + 1, lower, h)

    even = narrow[0] + 0 * turn
    pairs = (
        (1 + 0 * z, even), (level, narrow[1] * s), (level, narrow[1] * c), (z, even), (level**2, narrow[2] * s2 / 2),
        (level * z, narrow[1] * c), (level * z, narrow[1] * s), (level**2, -narrow[2] * c2), (3 * z * z - 1, even),
    )  # fmt: skip
    means = np.array([np.einsum("hwc,h,w->c", light, down(f), g, optimize=True) for f, g in pairs])
    return np.asarray((means / SQUARES[:, None] * TRANSFER[:, None]).T)
