"""Sun and sky from all that stands beside the board, and no more of a model than a matt sphere would show.

White paper in full light has a_p (E l.z/π + Ls) = P, which is known: a sky of Ls leaves E to the sun. A shadow's
darkness and a mirror ball's map each tell Ls, and their mean by inverse variance is taken. A map is scaled to it; where
there is no sun, clipped lamps in it are given what the rest leaves of the paper's light, spread over their texels.

The sky is constant if a matt sphere could not tell it from the map. Sharp edges that a mirror shows do not count, since
no matt surface shows them.
"""

from dataclasses import dataclass, replace

import numpy as np

from raytwin.photos.boards.board import PAPER
from raytwin.photos.lighting.mirror_ball import Ball, SunSpot
from raytwin.photos.lighting.stand_shadow import Shadow
from raytwin.scene import Environment, Sky
from raytwin.tracer.lights.envmap_tables import REC_709, texel_directions

VISIBLE = 0.01
"""Share of a matt sphere's light by which a constant sky may be off the map: one code of 8 bits, which is 2.2/255 of
white and more of darker greys."""

SUN_SIGMAS = 3.0
"""A sun is accepted if its irradiance exceeds this many of its standard deviations."""

PAPER_SD, REFLECTANCE_SD = 0.01, 0.03
"""As shares: how well the paper's light, and a mirror's reflectance, are known."""

_K = np.arange(100)
_Z = 1 - (2 * _K + 1) / 200
NORMALS = np.stack([*(np.sqrt(1 - _Z * _Z) * f(2.399963 * _K) for f in (np.cos, np.sin)), _Z], axis=1)
"""Normals that look up, spread evenly over a sphere along a spiral, at which its shading is compared."""

Sun = tuple[np.ndarray, float]
"""A direction, and its standard deviation in radians."""


@dataclass(frozen=True, eq=False)
class MirrorBall:
    """A mirror ball, its reflectance (3), the sun's spot in it, and the maps (rows, 2 rows, 3) of what it shows:
    without lamps, and of clipped lamps alone."""

    ball: Ball
    reflectance: np.ndarray
    spot: SunSpot | None
    dim: np.ndarray
    lamps: np.ndarray


@dataclass(frozen=True, eq=False)
class Evidence:
    """What shows the light; `paper` (3): the radiance of white paper in full light."""

    paper: np.ndarray
    shadow: Shadow | None = None
    mirror: MirrorBall | None = None

    @property
    def suns(self) -> list[tuple[str, np.ndarray, float]]:
        """(what showed it, direction, standard deviation in radians) of all that shows where the sun is."""
        spot = self.mirror.spot if self.mirror else None
        shown = ("stand", self.shadow), ("mirror ball", spot)
        return [(name, by.to_light, by.sigma) for name, by in shown if by]


@dataclass(frozen=True, eq=False)
class Light:
    """The sun's direction `to_light` (None without one), its `sigma` (radians), E (3), and the sky: Ls (3), and the map
    (rows, 2 rows, 3) or None; standard deviations of E and Ls, of a map that of its irradiance on level paper.

    A map's lower half is the ground: it lights from below what is drawn there.
    """

    to_light: np.ndarray | None
    sigma: float
    E: np.ndarray
    E_sd: np.ndarray
    Ls: np.ndarray
    Ls_sd: np.ndarray
    around: np.ndarray | None

    @property
    def sky(self) -> Sky:
        if self.around is None:
            return Sky(tuple(self.Ls.tolist()))
        return Sky(texels=Environment(self.around.shape[1::-1], np.ascontiguousarray(self.around, "<f4").tobytes()))

    @property
    def shading(self) -> np.ndarray:
        """(n, 3): radiance over albedo that a matt sphere has at NORMALS."""
        sun = self.E / np.pi * np.maximum(NORMALS @ self.to_light, 0)[:, None] if self.to_light is not None else 0
        return sun + (self.Ls * (1 + NORMALS[:, 2:]) / 2 if self.around is None else received(self.around, NORMALS))


@dataclass(frozen=True)
class Trial:
    """A model; `rows` of its map, 0 for a constant sky; `on_sphere`: how far it is off the map, as a share of a matt
    sphere's mean shading."""

    name: str
    rows: int
    sun: bool
    on_sphere: float


def received(around: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(n, 3): irradiance over π that the map's upper half gives surfaces with such `normals` (n, 3)."""
    rows, columns = around.shape[:2]
    edges = np.cos(np.linspace(0, np.pi, rows + 1))
    light = (around * ((edges[:-1] - edges[1:]) * 2 * np.pi / columns)[:, None, None])[: rows // 2]
    directions = texel_directions(rows, columns)[: rows // 2]
    return np.maximum(normals @ directions.reshape(-1, 3).T, 0) @ light.reshape(-1, 3) / np.pi


def upward(around: np.ndarray) -> np.ndarray:
    """(3): the irradiance on level paper over π: the constant sky that gives it as much light."""
    return received(around, np.array([[0.0, 0.0, 1.0]]))[0]


def simplest_light(found: Evidence) -> tuple[Light, list[Trial], int]:
    """The light, the models tried, and the number of the one taken. Without a mirror ball the sky is constant."""
    sun = _mean_direction(found.suns)
    light = _solve(found, sun)
    if sun and SUN_SIGMAS * light.E_sd @ REC_709 > light.E @ REC_709:
        sun, light = None, _solve(found, None)
    prefix = "sun + " if sun else ""
    even = Trial(f"{prefix}constant sky", 0, sun is not None, 0.0)
    if light.around is None:
        return light, [even], 0
    whole = light.shading
    plain = replace(light, around=None)
    off = float(np.sqrt(((plain.shading - whole) ** 2).mean()) / whole.mean())
    rows = len(light.around)
    trials = [replace(even, on_sphere=off), Trial(f"{prefix}map of {rows} rows", rows, sun is not None, 0.0)]
    return (plain, trials, 0) if off <= VISIBLE else (light, trials, 1)


def _mean_direction(suns: list[tuple[str, np.ndarray, float]]) -> Sun | None:
    """Weighed by inverse variance; None where nothing shows a sun that lights the board."""
    if not suns:
        return None
    weight = np.array([sd for *_, sd in suns]) ** -2.0
    d = weight @ np.array([d for _, d, _ in suns])
    return d / np.linalg.norm(d), float(1 / np.sqrt(weight.sum()))


def _solve(found: Evidence, sun: Sun | None) -> Light:
    """The light of all evidence, with the map where a mirror ball shows one, and the `sun` if there is one."""
    whole, zero, mirror, around = found.paper / PAPER, np.zeros(3), found.mirror, None
    if sun is None:
        if mirror:
            strength = np.maximum((whole - upward(mirror.dim)) / np.maximum(upward(mirror.lamps), 1e-9), 1)
            around = _scaled(mirror.dim + mirror.lamps * strength, whole)
        return Light(None, 0.0, zero, zero, whole, PAPER_SD * whole, around)
    to_light, sigma = sun
    estimates: list[tuple[np.ndarray, np.ndarray]] = []
    if found.shadow:
        estimates.append((found.shadow.dark * whole / found.shadow.left, found.shadow.dark_sd * whole))
    if mirror:
        level = upward(mirror.dim + mirror.lamps)
        estimates.append((level, REFLECTANCE_SD * level))
    weight = np.array([sd**-2.0 for _, sd in estimates])
    mean = (weight * np.array([value for value, _ in estimates])).sum(axis=0) / weight.sum(axis=0)
    Ls = np.clip(mean, 1e-6, whole)  # no light takes any away
    Ls_sd = np.hypot(weight.sum(axis=0) ** -0.5, PAPER_SD * Ls)
    E = np.pi * (whole - Ls) / to_light[2]
    slant = np.hypot(*to_light[:2]) / to_light[2]
    E_sd = np.hypot(np.pi / to_light[2] * np.hypot(Ls_sd, PAPER_SD * whole), E * slant * sigma)
    around = _scaled(mirror.dim + mirror.lamps, Ls) if mirror else None
    return Light(to_light, sigma, E, E_sd, Ls, Ls_sd, around)


def _scaled(around: np.ndarray, level: np.ndarray) -> np.ndarray:
    return (around * (level / np.maximum(upward(around), 1e-9))).astype(np.float32)
