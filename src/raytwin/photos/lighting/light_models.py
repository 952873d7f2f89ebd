"""A photo's light: a sun, and a sky that is constant or the map that a mirror ball shows.

White paper in full light has radiance a (E l.z/π + Ls), which is known: a sky of Ls leaves E to the sun. Ls comes from
the mirror ball's map or from how dark an upright's shadow is. Without a sun, the map's clipped lamps get what the rest
leaves of the paper's light, spread over their texels.

The sky is constant where a matt sphere would hardly look different under the map. Sharp edges that a mirror shows do
not count, since no matt surface shows them.
"""

from dataclasses import dataclass, replace

import numpy as np

from raytwin.photos.boards.board import PAPER
from raytwin.photos.lighting.mirror_ball import MirrorBall, SunSpot
from raytwin.photos.lighting.stand_shadow import SKY_SHARE_SD, Shadow
from raytwin.scene import Environment, Sky
from raytwin.tracer.lights.envmap_tables import REC_709, texel_directions

VISIBLE_SHARE = 0.01
"""Error of a matt sphere's shading above which a constant sky is not taken, as a share of its mean: about one code of
8 bits."""

SUN_SIGMAS = 3.0
"""A sun is accepted if its irradiance exceeds this many of its standard deviations."""

PAPER_SD, REFLECTANCE_SD = 0.01, 0.03
"""Standard deviations, as shares, of the paper's light and of a mirror's reflectance."""

_K = np.arange(100)
_Z = 1 - (2 * _K + 1) / 200
NORMALS = np.stack([*(np.sqrt(1 - _Z * _Z) * f(2.399963 * _K) for f in (np.cos, np.sin)), _Z], axis=1)
"""Normals that look up, spread evenly along a spiral, at which a sphere's shading is compared."""


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
    def name(self) -> str:
        sky = "constant sky" if self.around is None else f"map of {len(self.around)} rows"
        return sky if self.to_light is None else f"sun + {sky}"

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


def received(around: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the irradiance over π (n, 3) that the map's upper half gives surfaces with `normals` (n, 3)."""
    rows, columns = around.shape[:2]
    edges = np.cos(np.linspace(0, np.pi, rows + 1))
    light = (around * ((edges[:-1] - edges[1:]) * 2 * np.pi / columns)[:, None, None])[: rows // 2]
    directions = texel_directions(rows, columns)[: rows // 2]
    return np.maximum(normals @ directions.reshape(-1, 3).T, 0) @ light.reshape(-1, 3) / np.pi


def upward(around: np.ndarray) -> np.ndarray:
    """Return the irradiance on level paper over π (3): the constant sky that gives it as much light."""
    return received(around, np.array([[0.0, 0.0, 1.0]]))[0]


def light_of(paper: np.ndarray, by: Shadow | MirrorBall) -> Light:
    """Return the light by which paper in full light has radiance `paper` (3), with the map where a mirror shows one."""
    whole, zero = paper / PAPER, np.zeros(3)
    sun: Shadow | SunSpot | None
    if isinstance(by, Shadow):
        sun, around, Ls, Ls_sd = by, None, by.sky_share * whole, SKY_SHARE_SD * whole
    else:
        sun, around = by.spot, by.dim + by.lamps
        Ls = upward(around)
        Ls_sd = REFLECTANCE_SD * Ls
    if sun:
        Ls = np.clip(Ls, 1e-6, whole)  # no light takes any away
        Ls_sd = np.hypot(Ls_sd, PAPER_SD * Ls)
        E = np.pi * (whole - Ls) / sun.to_light[2]
        slant = np.hypot(*sun.to_light[:2]) / sun.to_light[2]
        E_sd = np.hypot(np.pi / sun.to_light[2] * np.hypot(Ls_sd, PAPER_SD * whole), E * slant * sun.sigma)
        if SUN_SIGMAS * E_sd @ REC_709 <= E @ REC_709:
            return Light(sun.to_light, sun.sigma, E, E_sd, Ls, Ls_sd, _scaled(around, Ls))
    if isinstance(by, MirrorBall):
        strength = np.maximum((whole - upward(by.dim)) / np.maximum(upward(by.lamps), 1e-9), 1)
        around = by.dim + by.lamps * strength
    return Light(None, 0.0, zero, zero, whole, PAPER_SD * whole, _scaled(around, whole))


def simplest(light: Light) -> tuple[Light, float]:
    """Return the light with a constant sky where that hardly shows, and how far it is off, as a share of a matt
    sphere's mean shading."""
    plain, shading = replace(light, around=None), light.shading
    off = float(np.sqrt(((plain.shading - shading) ** 2).mean()) / shading.mean())
    return (plain if off <= VISIBLE_SHARE else light), off


def _scaled(around: np.ndarray | None, level: np.ndarray) -> np.ndarray | None:
    return None if around is None else (around * (level / np.maximum(upward(around), 1e-9))).astype(np.float32)
