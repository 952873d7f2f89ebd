"""The light that the ground sends up to a sphere drawn on it, as the photo shows that ground.

A surface of normal n above level ground sees that ground in the share (1 - n.z)/2 of its hemisphere, weighed by the
cosine. What it receives is that share of the ground's mean radiance (`ground_rings`).
"""

from collections.abc import Callable

import numpy as np

from raytwin.calib.ground_rings import fibonacci, filled, polynomials, rings_about, weights
from raytwin.lights.environment_map import environment_map
from raytwin.lights.envmap_tables import texel_directions
from raytwin.scene import Environment, Scene, Sphere

RINGS, TURNS = 32, 48
"""Places on the ground about a sphere."""

NEAREST, FARTHEST = 0.2, 40.0
"""Radii of the first ring and of the last, as multiples of the sphere's."""

NORMALS = 300
"""Normals at which the light is summed up."""

SHARP_ROWS = 32
"""A map of fewer rows is made finer before it is cut at the horizon."""

Look = Callable[[np.ndarray], np.ndarray]
"""Places on the ground (m, 3), metres, board's axes -> their radiance (m, 3), NaN where the photo shows none."""


def ground_for_sky(scene: Scene, sphere: Sphere, look: Look) -> np.ndarray:
    """(25, 3): factors of `polynomials` for what `sphere` gets from the ground, less that from the sky below, as E/π.

    All 0 where the photo shows no ground about the sphere.
    """
    n, center = fibonacci(NORMALS), np.array(sphere.center)
    places, _, area = rings_about(center, sphere.radius, NEAREST, FARTHEST, RINGS, TURNS)
    radiance = filled(look(places), TURNS)
    if radiance is None:
        return np.zeros((polynomials(n).shape[1], 3))
    weight = weights(center, sphere.radius, n, places, area)
    mean = weight @ radiance / np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
    gained = (1 - n[:, 2:]) / 2 * mean - _sky_below(scene, n)
    return np.linalg.lstsq(polynomials(n), gained, rcond=None)[0]


def _sky_below(scene: Scene, n: np.ndarray) -> np.ndarray:
    """(m, 3): E/π at normals (m, 3) of that part of the sky that lies below the horizon."""
    if scene.environment is None:
        return (1 - n[:, 2:]) / 2 * np.array(scene.sky_radiance)
    around = scene.environment
    finer = -(-SHARP_ROWS // around.size[1])
    light = around.radiance.repeat(finer, axis=0).repeat(finer, axis=1)
    h, w = light.shape[:2]
    up = texel_directions(h, w) @ np.array(around.R_map_board)[:, 2]  # the board's z in the map's axes
    below = np.where((up < 0)[..., None], light, np.float32(0))
    lower = environment_map(Environment((w, h), below.astype("<f4").tobytes(), around.R_map_board))
    return np.stack(lower.diffuse_irradiance(tuple(n.T)), axis=1)
