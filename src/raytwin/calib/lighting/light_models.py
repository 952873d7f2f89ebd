"""Sun and sky from all that stands beside the board, and no more of a model than a matt sphere would show.

White paper in full light has a_p (E l.z/π + Ls) = P, which is known: a sky of Ls leaves E to the sun. A shadow's
darkness and a mirror ball's map each tell Ls, and their mean by inverse variance is taken. A map is scaled to it; where
there is no sun, clipped lamps in it are given what the rest leaves of the paper's light, spread over their texels.

Held-out pixels are photos that were not used, one at a time, or of a single photo every other patch. What they show is
a light, too: a model errs by how far a matt sphere's shading under it is off that under the light of the held-out
pixels. Sharp edges that a mirror shows do not count, since no matt surface does.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from raytwin.calib.boards.board import PAPER
from raytwin.calib.lighting.mirror_ball import Ball
from raytwin.calib.lighting.mirror_map import Mirrored, fit_map
from raytwin.calib.lighting.stand_shadow import Shadow
from raytwin.lights.envmap_tables import REC_709, texel_directions
from raytwin.scene import Environment, Sky

ROWS = 8, 16, 32
"""Rows of the maps that are tried."""

VISIBLE = 0.01
"""The least model is taken whose matt sphere is at most this much worse than the best one's: one code of 8 bits, which
is 2.2/255 of white and more of darker greys."""

SUN_ERROR_RATIO, SUN_SIGMAS = 0.8, 3.0
"""A sun is accepted if it lowers the constant sky's error to this share or less, and if its irradiance exceeds this
many of its standard deviations."""

PAPER_SD, REFLECTANCE_SD = 0.01, 0.03
"""As shares: how well the paper's light, and a mirror's reflectance, are known."""

CONTRADICTS = 4.0
"""Reduced chi-squared of the measured sun directions above which they contradict each other and sigma is raised."""

LEAST_PIXELS = 50
"""Pixels that a fit needs."""

PATCH = 8
"""Pixels across a patch of those that are held out of a single photo."""

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
    """A mirror ball, what its pixels show, and the sun, if it shows one."""

    ball: Ball
    pixels: Mirrored
    reflectance: np.ndarray
    sun: Sun | None


@dataclass(frozen=True, eq=False)
class Evidence:
    paper: np.ndarray
    shadow: Shadow | None = None
    mirrors: list[MirrorBall] = field(default_factory=list)

    def part(self, keep: Callable[[Any], np.ndarray]) -> "Evidence":
        """Return the evidence of the pixels that `keep` takes of a table with `photo` and `uv`."""

        def taken(pixels: Any) -> Any:
            mine, count = keep(pixels), len(pixels.photo)
            columns = {k: v[mine] for k, v in vars(pixels).items() if np.ndim(v) and len(v) == count}
            return replace(pixels, **columns)

        shadow = taken(self.shadow) if self.shadow else None
        mirrors = [replace(m, pixels=taken(m.pixels)) for m in self.mirrors]
        return Evidence(
            self.paper, shadow if shadow and len(shadow.photo) >= LEAST_PIXELS else None,
            [m for m in mirrors if len(m.pixels.photo) >= LEAST_PIXELS],
        )  # fmt: skip

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
    """A model; `rows` of its map, 0 for a constant sky; as shares of a matt sphere's mean shading: its `error` against
    held-out pixels, and how far it is off the last model `on_sphere`."""

    name: str
    rows: int
    sun: bool
    error: float
    on_sphere: float
    seconds: float


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
    """Weighed by inverse variance; what contradicts each other is known as badly as it differs (Birge 1932)."""
    weight = np.array([sd for *_, sd in directions]) ** -2.0
    d = weight @ np.array([d for _, d, _ in directions])
    d, sigma = d / np.linalg.norm(d), float(1 / np.sqrt(weight.sum()))
    if len(directions) == 1:
        return d, sigma
    spread = sum(((a - d) ** 2).sum() / (2 * sd**2) for _, a, sd in directions) / (len(directions) - 1)
    return d, sigma * float(np.sqrt(spread)) if spread > CONTRADICTS else sigma


def solve(found: Evidence, rows: int, sun: Sun | None) -> Light:
    """The light of this model: `rows` of the map, 0 for a constant sky; the `sun`'s direction and its deviation."""
    whole, zero = found.paper / PAPER, np.zeros(3)
    dim, lamps = fit_map([m.pixels for m in found.mirrors], rows or ROWS[0]) if found.mirrors else (None, None)
    if sun is None:
        around = None
        if rows and dim is not None and lamps is not None:
            strength = np.maximum((whole - upward(dim)) / np.maximum(upward(lamps), 1e-9), 1)
            around = _scaled(dim + lamps * strength.astype(np.float32), whole)
        return Light(None, 0.0, zero, zero, whole, PAPER_SD * whole, around)
    to_light, sigma = sun
    estimates: list[tuple[np.ndarray, np.ndarray]] = []
    if found.shadow:
        ratio, sd = found.shadow.levels(found.paper)
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


def _relative(off: np.ndarray, values: np.ndarray) -> float:
    return float(np.sqrt((off**2).mean()) / values.mean())


def _folds(found: Evidence, photos: int) -> Iterator[tuple[Evidence, Evidence]]:
    """(what is fitted, what is held out)."""
    for k in range(min(photos, 4) if photos > 1 else 2):

        def held_out(pixels: Any, k: int = k) -> np.ndarray:
            return pixels.photo == k if photos > 1 else (pixels.uv // PATCH).sum(axis=1) % 2 == k

        def fitted(pixels: Any, held_out: Callable[[Any], np.ndarray] = held_out) -> np.ndarray:
            return ~held_out(pixels)

        parts = found.part(fitted), found.part(held_out)
        if all(part.shadow or part.mirrors for part in parts):
            yield parts


def choose(found: Evidence, photos: int) -> tuple[Light, list[Trial], int]:
    """The light, all models tried, and the number of the one taken."""
    sun = _mean_direction(found.suns) if found.suns else None
    if sun and sun[0][2] <= 0.02:
        sun = None  # a lamp that does not light the paper
    folds, lights, trials = list(_folds(found, photos)), [], []
    finest = ROWS[-1]
    seen = [solve(test, finest if test.mirrors else 0, sun).shading for _, test in folds]

    def attempt(rows: int, sun: Sun | None) -> None:
        start = time.perf_counter()
        lights.append(solve(found, rows, sun))
        off = [_relative(solve(train, rows, sun).shading - s, s) for (train, _), s in zip(folds, seen, strict=True)]
        error = float(np.sqrt(np.mean(np.square(off)))) if off else 0.0
        name = ("sun + " if sun else "") + (f"map of {rows} rows" if rows else "constant sky")
        trials.append(Trial(name, rows, sun is not None, error, 0.0, time.perf_counter() - start))

    attempt(0, None)
    if sun:
        attempt(0, sun)
        asked_for = trials[1].error < SUN_ERROR_RATIO * trials[0].error
        if not (asked_for and SUN_SIGMAS * lights[1].E_sd @ REC_709 < lights[1].E @ REC_709):
            sun, seen = None, [solve(test, finest if test.mirrors else 0, None).shading for _, test in folds]
    for rows in ROWS if found.mirrors else ():
        attempt(rows, sun)
    last = lights[-1].shading
    trials = [replace(t, on_sphere=_relative(s.shading - last, last)) for t, s in zip(trials, lights, strict=True)]
    allowed = [i for i, t in enumerate(trials) if t.sun == (sun is not None)]
    best = min(trials[i].error for i in allowed)
    taken = next(i for i in allowed if trials[i].error <= best + VISIBLE)
    return lights[taken], trials, taken
