"""The sky in the twin, a row for each kind: as an emitter of Mitsuba, and by NumPy, independent of `raytwin.lights`.

Mitsuba's columns are as ours (`scene.Environment`), but its first and last row lie on the poles. A map of 2 h + 1 rows,
with what is midway between ours in between, is the same function. Mitsuba's y is up and its middle looks along +z,
with +x to the left.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from math import pi
from typing import Any, NamedTuple

import numpy as np

from raytwin.scene import Environment, Scene, Sky

TO_MITSUBA = np.array(((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)))
"""The map's axes to those of `envmap`."""


def turned(environment: Environment, R: Any) -> np.ndarray:
    """(3, 3): from the axes to which R turns the board's into the map's."""
    return np.asarray(environment.R_map_board) @ np.asarray(R).T


def from_pole_to_pole(radiance: np.ndarray) -> np.ndarray:
    """A map (h, w, 3) with 2 h + 1 rows, the first and the last on the poles: the same between them."""
    padded = np.concatenate([radiance[:1], radiance, radiance[-1:]]).astype(np.float64)
    rows = np.empty((2 * len(radiance) + 1, *radiance.shape[1:]))
    rows[1::2], rows[::2] = radiance, (padded[:-1] + padded[1:]) / 2
    return rows


def emitter(environment: Environment, R: Any) -> dict[str, Any]:
    """Mitsuba's dictionary, in the axes to which R turns the board's."""
    import mitsuba as mi

    matrix = np.eye(4)
    matrix[:3, :3] = (TO_MITSUBA @ turned(environment, R)).T
    bitmap = mi.Bitmap(from_pole_to_pole(environment.radiance).astype(np.float32))
    return {"type": "envmap", "bitmap": bitmap, "to_world": mi.ScalarTransform4f(matrix)}


def radiance(environment: Environment, d: np.ndarray) -> np.ndarray:
    """(k, 3): what the map shows along d (k, 3), board's axes."""
    rows, (x, y, z) = from_pole_to_pole(environment.radiance), turned(environment, np.eye(3)) @ d.T
    h, w = len(rows) - 1, rows.shape[1]
    down, along = np.arctan2(np.hypot(x, y), z) / pi * h, (0.5 + np.arctan2(x, y) / (2 * pi)) * w - 0.5
    j, i = np.clip(down.astype(int), 0, h - 1), np.floor(along).astype(int)
    b, a = (down - j)[:, None], (along - i)[:, None]
    upper, lower = ((1 - a) * rows[k, i % w] + a * rows[k, (i + 1) % w] for k in (j, j + 1))
    return np.asarray((1 - b) * upper + b * lower)


def harmonics(environment: Environment, R: Any) -> np.ndarray:
    """M (3, 4, 4), one a channel: ñᵀ M ñ with ñ = (n, 1) is E(n)/π to the second order, n where R turns the board."""
    A = np.eye(4)
    A[:3, :3] = turned(environment, R)
    return np.asarray(A.T @ _own_harmonics(environment) @ A)


@lru_cache(maxsize=4)
def _own_harmonics(environment: Environment) -> np.ndarray:
    """The same in the map's axes.

    Ramamoorthi and Hanrahan's equations 11 and 12, divided by π; the coefficients L_lm by the midpoint rule over a grid
    that is the finer the coarser the map is.
    """
    rows = from_pole_to_pole(environment.radiance)
    h, w = len(rows) - 1, rows.shape[1]
    high, wide = max(1, 1024 // h), max(1, 1024 // w)
    v, u = (np.arange(h * high) + 0.5) / high, (np.arange(w * wide) + 0.5) / wide - 0.5
    j, i = v.astype(int), np.floor(u).astype(int)
    b, a = (v - j)[:, None, None], (u - i)[:, None]
    theta, turn = v * pi / h, ((u + 0.5) / w - 0.5) * 2 * pi
    x, y = np.sin(turn), np.cos(turn)
    # Down the rows first: what is left for each of Y's functions of u is a sum over one row.
    at = (1 - b) * rows[j] + b * rows[j + 1]
    level = np.sin(theta)
    step = pi / (2 * h * high)
    area = (np.cos(theta - step) - np.cos(theta + step)) * 2 * pi / len(u)
    z = np.cos(theta)

    def moment(down: np.ndarray, along: np.ndarray) -> np.ndarray:
        row = np.einsum("jwc,j->wc", at, down * area)
        return np.asarray(along @ ((1 - a) * row[i % w] + a * row[(i + 1) % w]))

    one = np.ones_like(u)
    L00, L10, L20 = 0.282095 * moment(level**0, one), 0.488603 * moment(z, one), 0.315392 * moment(3 * z * z - 1, one)
    L11, L1m = 0.488603 * moment(level, x), 0.488603 * moment(level, y)
    L21, L2m1 = 1.092548 * moment(level * z, x), 1.092548 * moment(level * z, y)
    L2m2, L22 = 1.092548 * moment(level**2, x * y), 0.546274 * moment(level**2, x * x - y * y)
    c1, c2, c3, c4, c5 = 0.429043, 0.511664, 0.743125, 0.886227, 0.247708
    M = np.moveaxis(np.array([
        [c1 * L22, c1 * L2m2, c1 * L21, c2 * L11], [c1 * L2m2, -c1 * L22, c1 * L2m1, c2 * L1m],
        [c1 * L21, c1 * L2m1, c3 * L20, c2 * L10], [c2 * L11, c2 * L1m, c2 * L10, c4 * L00 - c5 * L20],
    ]), -1, 0)  # fmt: skip
    return np.asarray(M / pi)


def map_irradiance(environment: Environment, normal: np.ndarray) -> np.ndarray:
    """E/π by the harmonics, never below 0."""
    n = np.concatenate([normal, np.ones((len(normal), 1))], axis=1)
    return np.maximum(np.einsum("ki,cij,kj->kc", n, harmonics(environment, np.eye(3)), n), 0)


def constant_emitter(sky: Sky, R: Any) -> dict[str, Any]:
    if not any(sky.radiance):
        return {}
    return {"type": "constant", "radiance": {"type": "rgb", "value": list(sky.radiance)}}


def constant(sky: Sky, d: np.ndarray) -> np.ndarray:
    return np.broadcast_to(sky.radiance, d.shape)


class SkyRow(NamedTuple):
    """One kind of sky: Mitsuba's dictionary in the axes to which R turns the board's, {} for none; the radiance along
    d (k, 3) and E/π for normals (k, 3), which is the radiance of a constant sky of the same light, in board's axes."""

    emitter: Callable[..., dict[str, Any]]
    radiance: Callable[..., np.ndarray]
    diffuse_irradiance: Callable[..., np.ndarray]


SKIES = {Sky: SkyRow(constant_emitter, constant, constant), Environment: SkyRow(emitter, radiance, map_irradiance)}
"""Record of the scene -> row; `raytwin.lights.SKIES` has the same keys."""


def sky_of(scene: Scene) -> SkyRow:
    """The row of the scene's sky, whose functions know it."""
    sky = scene.environment or scene.sky
    row = SKIES[type(sky)]
    return SkyRow(partial(row.emitter, sky), partial(row.radiance, sky), partial(row.diffuse_irradiance, sky))
