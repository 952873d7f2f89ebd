"""The light that level ground sends to a sphere, summed over rings of places about it.

A place of radiance L and area dA gives a surface of normal n the irradiance L n·ω cos θ dA / d². Over the sphere that
varies slowly: a polynomial of n describes it.
"""

import numpy as np

DEGREE = 4
"""Degree of the polynomial. At the step beside the sphere's own shadow, 2 errs by up to 12 codes, 4 by up to 3."""


def fibonacci(count: int) -> np.ndarray:
    """(count, 3): unit vectors spread evenly over the sphere, from the top down."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    return np.stack([np.sqrt(1 - z * z) * f(2.399963 * k) for f in (np.cos, np.sin)] + [z], axis=1)


def rings_about(
    center: np.ndarray, radius: float, nearest: float, farthest: float, rings: int, turns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places on the ground (rings turns, 3), ring by ring; how far from below the centre, and the area of each.

    `nearest`, `farthest`: the outer edges of the first and the last ring, in radii. The ground is z = 0, or what
    touches the sphere from below.
    """
    edges = radius * np.concatenate([[0], np.geomspace(nearest, farthest, rings)])
    far = np.repeat((edges[:-1] + edges[1:]) / 2, turns)
    turn = np.tile((np.arange(turns) + 0.5) / turns * 2 * np.pi, rings)
    xy = center[:2] + far[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    at = np.c_[xy, np.full(len(far), min(0.0, float(center[2] - radius)))]
    return at, far, np.repeat(np.pi * np.diff(edges**2) / turns, turns)


def filled(radiance: np.ndarray, turns: int) -> np.ndarray | None:
    """Radiance (rings turns, 3), ring by ring, without NaN; None where it is NaN everywhere.

    What is not seen has the mean of its ring, a ring that is not seen that of its neighbours.
    """
    rings = radiance.reshape(-1, turns, 3)
    seen = np.isfinite(rings).all(axis=-1)
    known = np.flatnonzero(seen.any(axis=1))
    if not known.size:
        return None
    means = np.where(seen[..., None], rings, 0).sum(axis=1)[known] / seen.sum(axis=1)[known, None]
    mean = np.stack([np.interp(np.arange(len(rings)), known, channel) for channel in means.T], axis=1)
    return np.where(seen[..., None], rings, mean[:, None]).reshape(-1, 3)


def weights(center: np.ndarray, radius: float, n: np.ndarray, at: np.ndarray, area: np.ndarray) -> np.ndarray:
    """(m, k): what the radiance of each place (k, 3) adds to the irradiance at normals n (m, 3)."""
    to = at - (center + radius * n)[:, None]
    facing = np.maximum((to * n[:, None]).sum(axis=-1), 0) * np.maximum(-to[..., 2], 0)
    return np.asarray(facing / (to**2).sum(axis=-1) ** 2 * area)


def polynomials(n: np.ndarray) -> np.ndarray:
    """(m, 25): all products of the components of unit normals (m, 3) up to DEGREE; z² is 1 - x² - y²."""
    x, y, z = n.T
    powers = [
        (i, j, k) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i) for k in (0, 1) if i + j + k <= DEGREE
    ]
    return np.stack([x**i * y**j * z**k for i, j, k in powers], axis=1)
