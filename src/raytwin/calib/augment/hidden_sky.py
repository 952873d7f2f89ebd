"""What spheres hide of a sky that is a map: the light of the part of it that each of them covers.

A sphere that fills a cap of half angle α about the direction d takes π F L̄(d, α) from a surface, with F its share of a
constant sky (`objects`) and L̄ the map's mean over the cap. The means are tabulated for a few angles.
"""

import cv2
import numpy as np

from raytwin.lights import EnvironmentMap
from raytwin.lights.environment_map import environment_map
from raytwin.lights.envmap_tables import texel_directions
from raytwin.scene import Environment

ANGLES = np.radians((3.0, 6.0, 12.0, 24.0, 48.0, 90.0))
"""Half angles of the caps; smaller ones count as the smallest."""

MOST_ROWS = 16
"""Rows of the map that is averaged: a finer one is reduced first."""


class CapMeans:
    """L̄(d, α) of a map."""

    def __init__(self, environment: Environment) -> None:
        self.R = np.array(environment.R_map_board)
        light = environment.radiance.astype(float)
        h = min(len(light), MOST_ROWS)
        weight = np.sin((np.arange(len(light)) + 0.5) * np.pi / len(light))[:, None, None] + 0 * light
        light, weight = (cv2.resize(a, (2 * h, h), interpolation=cv2.INTER_AREA) for a in (light * weight, weight))
        light /= weight
        flat = texel_directions(h, 2 * h).reshape(-1, 3)
        area = np.hypot(flat[:, 0], flat[:, 1])  # the sine of the angle from the top
        cosine = np.clip(flat @ flat.T, -1, 1)
        self.levels: list[EnvironmentMap] = []
        for angle in ANGLES:
            # The cap's edge is as soft as a texel is wide, and a cap smaller than a texel is that texel.
            inside = np.clip((angle - np.arccos(cosine)) * h / np.pi + 0.5, 0, 1) + 1e-9 * (cosine > 1 - 1e-9)
            weight = inside * area
            mean = weight @ light.reshape(-1, 3) / weight.sum(axis=1, keepdims=True)
            texels = mean.reshape(light.shape).astype("<f4").tobytes()
            self.levels.append(environment_map(Environment((2 * h, h), texels, environment.R_map_board)))

    def __call__(self, d: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """(m, 3): the means over caps about d (m, 3), board's axes, of half angles (m,)."""
        place = np.interp(np.log(np.maximum(angle, 1e-6)), np.log(ANGLES), np.arange(len(ANGLES)))
        out = np.zeros((len(d), 3))
        for k, level in enumerate(self.levels):
            weight = np.clip(1 - np.abs(place - k), 0, 1)
            if (mine := weight > 0).any():
                out[mine] += weight[mine, None] * np.stack(level.radiance(tuple(d[mine].T)), axis=1)
        return out
