"""The light that the ground sends up to a sphere drawn on it, as the photo shows that ground.

A surface of normal n above level ground sees that ground in the share (1 - n.z)/2 of its hemisphere, weighed by the
cosine. What it receives is that share of the ground's mean radiance, in which a place weighs n·ω cos θ dA / d². It
varies slowly with n: a polynomial describes it.
"""

from collections.abc import Callable

import numpy as np

from raytwin.lights.environment_map import environment_map
from raytwin.scene import Environment, Scene, Sphere

RINGS, TURNS = 32, 48
"""Places on the ground about a sphere."""

NEAREST, FARTHEST = 0.2, 40.0
"""Radii of the first ring and of the last, as multiples of the sphere's."""

NORMALS = 300
"""Normals at which the light is summed up."""

DEGREE = 4
"""The polynomial's: the sphere's own shadow beside it is a step of up to 12 codes off at 2, and of 3 at 4."""

SHARP_ROWS = 32
"""A map of fewer rows is made finer before it is cut at the horizon."""

Look = Callable[[np.ndarray], np.ndarray]
"""Places on the ground (m, 3), metres, board's axes -> their radiance (m, 3), NaN where the photo shows none."""


def ground_for_sky(scene: Scene, sphere: Sphere, look: Look) -> np.ndarray:
    """(25, 3): factors of `basis` for E/π that `sphere` gets from the ground, less what it gets from the sky below.

    All 0 where the photo shows no ground about the sphere.
    """
    z = 1 - (2 * np.arange(NORMALS) + 1) / NORMALS
    turn, level = 2.399963 * np.arange(NORMALS), np.sqrt(1 - z * z)
    n = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
    places, area = _places(sphere)
    radiance = _filled(look(places))
    if radiance is None:
        return np.zeros((basis(n).shape[1], 3))
    to = places - (np.array(sphere.center) + sphere.radius * n)[:, None]
    facing = np.maximum((to * n[:, None]).sum(axis=-1), 0) * np.maximum(-to[..., 2], 0)
    weight = facing / (to**2).sum(axis=-1) ** 2 * area
    mean = weight @ radiance / np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
    gained = (1 - n[:, 2:]) / 2 * mean - _sky_below(scene, n)
    return np.linalg.lstsq(basis(n), gained, rcond=None)[0]


def basis(n: np.ndarray) -> np.ndarray:
    """(m, 25): all products of the components of unit normals (m, 3) up to DEGREE; z² is 1 - x² - y²."""
    x, y, z = n.T
    powers = [
        (i, j, k) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i) for k in (0, 1) if i + j + k <= DEGREE
    ]
    return np.stack([x**i * y**j * z**k for i, j, k in powers], axis=1)


def _places(sphere: Sphere) -> tuple[np.ndarray, np.ndarray]:
    """(RINGS TURNS, 3) on the ground, ring by ring, and the area of each."""
    edges = sphere.radius * np.concatenate([[0], np.geomspace(NEAREST, FARTHEST, RINGS)])
    turn = (np.arange(TURNS) + 0.5) / TURNS * 2 * np.pi
    far = (edges[:-1] + edges[1:])[:, None] / 2
    x, y, z = sphere.center
    at = np.stack([x + far * np.cos(turn), y + far * np.sin(turn), 0 * far * turn + min(0.0, z - sphere.radius)], -1)
    area = np.pi * np.diff(edges**2) / TURNS
    return at.reshape(-1, 3), np.repeat(area, TURNS)


def _filled(radiance: np.ndarray) -> np.ndarray | None:
    """What is not seen has the mean of its ring, a ring that is not seen that of its neighbours; None without any."""
    rings = radiance.reshape(RINGS, TURNS, 3)
    seen = np.isfinite(rings).all(axis=-1)
    known = np.flatnonzero(seen.any(axis=1))
    if not known.size:
        return None
    means = np.where(seen[..., None], rings, 0).sum(axis=1)[known] / seen.sum(axis=1)[known, None]
    mean = np.stack([np.interp(np.arange(RINGS), known, channel) for channel in means.T], axis=1)
    return np.where(seen[..., None], rings, mean[:, None]).reshape(-1, 3)


def _sky_below(scene: Scene, n: np.ndarray) -> np.ndarray:
    """(m, 3): E/π at normals (m, 3) of that part of the sky that lies below the horizon."""
    if scene.environment is None:
        return (1 - n[:, 2:]) / 2 * np.array(scene.sky.radiance)
    around = scene.environment
    finer = -(-SHARP_ROWS // around.size[1])
    light = around.radiance.repeat(finer, axis=0).repeat(finer, axis=1)
    h, w = light.shape[:2]
    down, turn = (np.arange(h)[:, None] + 0.5) * np.pi / h, ((np.arange(w) + 0.5) / w * 2 - 1) * np.pi
    axes = np.array(around.R_map_board)[:, 2]  # the board's z in the map's axes
    up = np.sin(down) * (axes[0] * np.sin(turn) + axes[1] * np.cos(turn)) + axes[2] * np.cos(down)
    below = np.where((up < 0)[..., None], light, np.float32(0))
    lower = environment_map(Environment((w, h), below.astype("<f4").tobytes(), around.R_map_board))
    return np.stack(lower.diffuse_irradiance(tuple(n.T)), axis=1)
