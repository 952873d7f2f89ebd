"""Sun and sky from all that stands beside the board, and no more of a model than a matt sphere would show.

White paper in full light has a_p (E l.z/π + Ls) = P, which is known: a sky of Ls leaves E to the sun. A shadow's
darkness and a mirror ball's map each tell Ls, and their mean by inverse variance is taken. A map is scaled to it; where
there is no sun, clipped lamps in it are given what the rest leaves of the paper's light, spread over their texels.

The least model is taken that a matt sphere could not tell from the finest: a constant sky, or a map of few rows. Sharp
edges that a mirror shows do not count, since no matt surface shows them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from raytwin.photos.boards.board import PAPER
from raytwin.photos.lighting.mirror_ball import Ball, SunSpot
from raytwin.photos.lighting.mirror_map import Mirrored, fit_map
from raytwin.photos.lighting.stand_shadow import Shadow
from raytwin.scene import Environment, Sky
from raytwin.tracer.lights.envmap_tables import REC_709, texel_directions

MAP_ROWS = 8, 16, 32
"""Rows of the maps that are tried."""

VISIBLE = 0.01
"""Share of a matt sphere's light by which the model taken may be off the finest one: one code of 8 bits, which is
2.2/255 of white and more of darker greys."""

SUN_SIGMAS = 3.0
"""A sun is accepted if its irradiance exceeds this many of its standard deviations."""

PAPER_SD, REFLECTANCE_SD = 0.01, 0.03
"""As shares: how well the paper's light, and a mirror's reflectance, are known."""

_K = np.arange(100)
_Z = 1 - (2 * _K + 1) / 200
NORMALS = np.stack([*(np.sqrt(1 - _Z * _Z) * f(2.399963 * _K) for f in (np.cos, np.sin)), _Z], axis=1)
"""Normals that look up, spread evenly over a sphere along a spiral, at which its shading is compared."""

BLUR_DEGREES = 20.0
"""By how much both shadings are blurred first: a terminator's place counts by what it changes over so much of it."""

Sun = tuple[np.ndarray, float]
"""A direction, and its standard deviation in radians."""


@dataclass(frozen=True, eq=False)
class MirrorBall:
    """A mirror ball, what its pixels show, the sun's spot in each photo, and the sun, if one shows it."""

    ball: Ball
    pixels: Mirrored
    reflectance: np.ndarray
    spots: Sequence[SunSpot | None]
    sun: Sun | None


@dataclass(frozen=True, eq=False)
class Evidence:
    paper: np.ndarray
    shadow: Shadow | None = None
    mirrors: list[MirrorBall] = field(default_factory=list)

    @property
    def suns(self) -> list[tuple[str, np.ndarray, float]]:
        """(what showed it, direction, standard deviation in radians) of all that shows where the sun is."""
        shadow = [("stand", self.shadow.to_light, self.shadow.sigma)] if self.shadow else []
        return shadow + [("mirror ball", *mirror.sun) for mirror in self.mirrors if mirror.sun]


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

    def shown_map(self, rows: int) -> np.ndarray:
        """(rows, 2 rows, 3): the sky as a map, each texel repeated; the upper half alone where the sky is constant."""
        if self.around is None:
            half = np.broadcast_to(self.Ls.astype(np.float32), (rows // 2, 2 * rows, 3))
            return np.concatenate([half, 0 * half])
        return _repeated(self.around, rows)

    @property
    def sky(self) -> Sky:
        if self.around is None:
            return Sky(tuple(self.Ls.tolist()))
        return Sky(texels=Environment(self.around.shape[1::-1], np.ascontiguousarray(self.around, "<f4").tobytes()))

    def received(self, normals: np.ndarray) -> np.ndarray:
        """(n, 3): irradiance over π that the sky above gives surfaces with such `normals` (n, 3)."""
        if self.around is None:
            return self.Ls * (1 + normals[:, 2:]) / 2
        directions, light = _upper(self.around)
        return np.maximum(normals @ directions.T, 0) @ light / np.pi

    @property
    def shading(self) -> np.ndarray:
        """(n, 3): radiance over albedo of a matt sphere at NORMALS, blurred."""
        lit = np.maximum(NORMALS @ self.to_light, 0) if self.to_light is not None else np.zeros(len(NORMALS))
        near = np.exp((NORMALS @ NORMALS.T - 1) / np.radians(BLUR_DEGREES) ** 2)
        return near @ (self.E / np.pi * lit[:, None] + self.received(NORMALS)) / near.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class Trial:
    """A model; `rows` of its map, 0 for a constant sky; `on_sphere`: how far it is off the finest model, as a share of
    a matt sphere's mean shading."""

    name: str
    rows: int
    sun: bool
    on_sphere: float


def _repeated(around: np.ndarray, rows: int) -> np.ndarray:
    times = max(1, rows // len(around))
    return around.repeat(times, axis=0).repeat(times, axis=1)


def _upper(around: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions (n, 3) of the map's upper half, in 16 rows or more, and the light (n, 3) that comes from each."""
    fine = _repeated(around, 16)
    rows = len(fine)
    edges = np.cos(np.linspace(0, np.pi, rows + 1))
    area = np.repeat((edges[:-1] - edges[1:]) * np.pi / rows, 2 * rows)[: rows * rows, None]
    return texel_directions(rows, 2 * rows).reshape(-1, 3)[: rows * rows], fine.reshape(-1, 3)[: rows * rows] * area


def upward(around: np.ndarray) -> np.ndarray:
    """(3): the irradiance on level paper over π: the constant sky that gives it as much light."""
    directions, light = _upper(around)
    return directions[:, 2] @ light / np.pi


def _mean_direction(directions: list[tuple[str, np.ndarray, float]]) -> Sun:
    """Weighed by inverse variance."""
    weight = np.array([sd for *_, sd in directions]) ** -2.0
    d = weight @ np.array([d for _, d, _ in directions])
    return d / np.linalg.norm(d), float(1 / np.sqrt(weight.sum()))


def solve(found: Evidence, rows: int, sun: Sun | None) -> Light:
    """The light of this model: `rows` of the map, 0 for a constant sky; the `sun`'s direction and its deviation."""
    whole, zero = found.paper / PAPER, np.zeros(3)
    dim, lamps = fit_map([m.pixels for m in found.mirrors], rows or MAP_ROWS[0]) if found.mirrors else (None, None)
    if sun is None:
        around = None
        if rows and dim is not None and lamps is not None:
            strength = np.maximum((whole - upward(dim)) / np.maximum(upward(lamps), 1e-9), 1)
            around = _scaled(dim + lamps * strength.astype(np.float32), whole)
        return Light(None, 0.0, zero, zero, whole, PAPER_SD * whole, around)
    to_light, sigma = sun
    estimates: list[tuple[np.ndarray, np.ndarray]] = []
    if found.shadow:
        ratio, sd = found.shadow.levels
        estimates.append((ratio * whole / found.shadow.left, sd * whole))
    if dim is not None:
        level = upward(dim + lamps)
        estimates.append((level, REFLECTANCE_SD * level))
    weight = np.array([sd**-2.0 for _, sd in estimates])
    mean = (weight * np.array([value for value, _ in estimates])).sum(axis=0) / weight.sum(axis=0)
    Ls = np.clip(mean, 1e-6, whole)  # no light takes any away
    Ls_sd = np.hypot(weight.sum(axis=0) ** -0.5, PAPER_SD * Ls)
    E = np.pi * (whole - Ls) / to_light[2]
    slant = np.hypot(*to_light[:2]) / to_light[2]
    E_sd = np.hypot(np.pi / to_light[2] * np.hypot(Ls_sd, PAPER_SD * whole), E * slant * sigma)
    around = _scaled(dim + lamps, Ls) if rows and dim is not None else None
    return Light(to_light, sigma, E, E_sd, Ls, Ls_sd, around)


def _scaled(around: np.ndarray, level: np.ndarray) -> np.ndarray:
    return around * (level / np.maximum(upward(around), 1e-9)).astype(np.float32)


def simplest_light(found: Evidence) -> tuple[Light, list[Trial], int]:
    """The light, all models tried, and the number of the one taken."""
    sun = _mean_direction(found.suns) if found.suns else None
    if sun and sun[0][2] <= 0.02:
        sun = None  # a lamp that does not light the paper
    if sun:
        plain = solve(found, 0, sun)
        sun = sun if SUN_SIGMAS * plain.E_sd @ REC_709 < plain.E @ REC_709 else None
    sizes = (0, *MAP_ROWS) if found.mirrors else (0,)
    lights = [solve(found, rows, sun) for rows in sizes]
    last = lights[-1].shading
    off = [float(np.sqrt(((light.shading - last) ** 2).mean()) / last.mean()) for light in lights]
    skies = [f"map of {rows} rows" if rows else "constant sky" for rows in sizes]
    trials = [
        Trial(("sun + " if sun else "") + sky, rows, sun is not None, share)
        for sky, rows, share in zip(skies, sizes, off, strict=True)
    ]
    taken = next(i for i, share in enumerate(off) if share <= VISIBLE)
    return lights[taken], trials, taken
