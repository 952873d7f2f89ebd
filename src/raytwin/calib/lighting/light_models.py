"""Sun and sky from all that stands beside the board, and no more of a model than held-out pixels ask for.

White paper in full light has a_p (E l.z/π + Ls) = P, which is known: a sky of Ls leaves E to the sun. A shadow's
darkness, a matt ball's shading and a mirror ball's map each tell Ls, and their mean by inverse variance is taken; a map
is scaled to it. Held-out pixels are photos that were not used, one at a time, or of a single photo every other patch.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from raytwin.calib.boards.board import PAPER
from raytwin.calib.lighting.ball_outline import Ball
from raytwin.calib.lighting.matt_ball import MattPixels, SkyShape, design, fibonacci, fit_shading
from raytwin.calib.lighting.mirror_ball import Mirrored, bilinear, fit_map
from raytwin.calib.lighting.stand_shadow import Shadow
from raytwin.lights.environment_map import environment_map
from raytwin.lights.envmap_tables import REC_709
from raytwin.scene import Environment

ROWS = 8, 16, 32
"""Rows of the maps that are tried."""

WORSE = 1.05
"""The least model whose error is at most this times that of the best one is taken."""

UNEVEN = 0.1
"""As a share: how far a matt ball's Ls is off, for what the sky, the ground and its neighbours are taken to be."""

MATT_DEGREES = 0.8
"""How far they turn the sun that a matt ball shows, in either angle."""

PAPER_SD, REFLECTANCE_SD, REFLECTANCE_UNKNOWN = 0.01, 0.03, 0.15
"""As shares: how well the paper's light, and a mirror's reflectance, measured or not, are known."""

CONTRADICTS = 4.0
"""Mean squared difference of what shows the sun, over its variance, from which it contradicts itself."""

LEAST_PIXELS = 50
"""Pixels of a ball that a fit needs."""


@dataclass(frozen=True, eq=False)
class MattBall:
    ball: Ball
    pixels: MattPixels


@dataclass(frozen=True, eq=False)
class MirrorBall:
    """`known`: the reflectance was measured; `sun`: by photo that shows it, its direction and standard deviation."""

    ball: Ball
    pixels: Mirrored
    reflectance: np.ndarray
    known: bool
    sun: dict[int, tuple[np.ndarray, float]]


@dataclass(frozen=True, eq=False)
class Evidence:
    paper: np.ndarray
    shadow: Shadow | None = None
    matt: list[MattBall] = field(default_factory=list)
    mirrors: list[MirrorBall] = field(default_factory=list)

    def part(self, keep: Callable[[Any], np.ndarray]) -> "Evidence":
        """Return the evidence of the pixels that `keep` takes of a table with `photo` and `uv`."""

        def taken(pixels: Any) -> Any:
            mine, count = keep(pixels), len(pixels.photo)
            columns = {k: v[mine] for k, v in vars(pixels).items() if np.ndim(v) and len(v) == count}
            return replace(pixels, **columns)

        matt = [replace(m, pixels=taken(m.pixels)) for m in self.matt]
        mirrors = [replace(m, pixels=taken(m.pixels)) for m in self.mirrors]
        return Evidence(
            self.paper, taken(self.shadow) if self.shadow else None,
            [m for m in matt if len(m.pixels.photo) >= LEAST_PIXELS],
            [m for m in mirrors if len(m.pixels.photo) >= LEAST_PIXELS],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Light:
    """The sun's direction `to_light` (None without one), its `sigma` (radians), E (3), and the sky: Ls (3), and the map
    (rows, 2 rows, 3) or None; standard deviations of E and Ls, of a map that of its irradiance on level paper.

    A map's lower half is the ground as a mirror ball shows it: it lights from below what is drawn there.
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
        return self.around.repeat(rows // len(self.around), axis=0).repeat(rows // len(self.around), axis=1)

    @property
    def environment(self) -> Environment | None:
        return None if self.around is None else _as_environment(self.around)


@dataclass(frozen=True)
class Trial:
    """A model: how far off held-out pixels are, as a share of their mean; `rows` of its map, 0 for a constant sky.

    `on_sphere`: how far the shading of a matt sphere is off that under the last model, as a share of its mean.
    """

    name: str
    rows: int
    sun: bool
    error: float
    on_sphere: float
    seconds: float
    by_kind: dict[str, float]


def directions_to_sun(found: Evidence) -> list[tuple[str, np.ndarray, float]]:
    """(what showed it, direction, standard deviation in radians) of all that shows where the sun is."""
    directions: list[tuple[str, np.ndarray, float]] = []
    if found.shadow:
        directions.append(("stand", found.shadow.to_light, found.shadow.sigma))
    for mirror in found.mirrors:
        if mirror.sun:
            d, sd = _mean_direction(list(mirror.sun.values()))
            # The ball's place is the same in all photos: the mean is little better than the best.
            directions.append(("mirror ball", d, max(sd, min(s for _, s in mirror.sun.values()) / 1.4)))
    for m in found.matt:
        shading = fit_shading(m.pixels, m.ball, found.paper)
        if 4 * shading.E_sd @ REC_709 < shading.E @ REC_709 and shading.sigma < 0.2:
            directions.append(("matt ball", shading.to_light, float(np.hypot(shading.sigma, np.radians(MATT_DEGREES)))))
    return directions


def _mean_direction(directions: list[tuple[np.ndarray, float]]) -> tuple[np.ndarray, float]:
    weight = np.array([sd for _, sd in directions]) ** -2.0
    d = weight @ np.array([d for d, _ in directions])
    return d / np.linalg.norm(d), float(1 / np.sqrt(weight.sum()))


def solve(found: Evidence, rows: int, sun: tuple[np.ndarray, float] | None) -> Light:
    """The light of this model: `rows` of the map, 0 for a constant sky; the `sun`'s direction and its deviation."""
    whole, zero = found.paper / PAPER, np.zeros(3)
    around = fit_map([m.pixels for m in found.mirrors], rows or ROWS[0]) if found.mirrors else None
    level = upward(around) if around is not None else whole
    if sun is None:
        scaled = around * (whole / level).astype(np.float32) if rows and around is not None else None
        return Light(None, 0.0, zero, zero, whole, PAPER_SD * whole, scaled)
    to_light, sigma = sun
    shape = sky_shape(around) if rows and around is not None else None
    estimates: list[tuple[np.ndarray, np.ndarray]] = []
    if found.shadow:
        ratio, sd = found.shadow.levels()
        estimates.append((ratio * whole / found.shadow.left, sd * whole))
    for m in found.matt:
        fitted = fit_shading(m.pixels, m.ball, found.paper, to_light, shape)
        # Turned by its deviation, the sun takes light from the sky, or gives it some.
        turned = [fit_shading(m.pixels, m.ball, found.paper, t, shape, 0).Ls for t in _tilts(to_light, sigma)]
        spread = np.mean([(t - fitted.Ls) ** 2 for t in turned], axis=0)
        estimates.append((fitted.Ls, np.sqrt(fitted.Ls_sd**2 + spread + (UNEVEN * fitted.Ls) ** 2)))
    if around is not None:
        known = all(m.known for m in found.mirrors)
        estimates.append((level, (REFLECTANCE_SD if known else REFLECTANCE_UNKNOWN) * level))
    weight = np.array([sd**-2.0 for _, sd in estimates])
    Ls = np.minimum((weight * np.array([value for value, _ in estimates])).sum(axis=0) / weight.sum(axis=0), whole)
    Ls_sd = np.hypot(weight.sum(axis=0) ** -0.5, PAPER_SD * Ls)
    E = np.pi * (whole - Ls) / to_light[2]
    slant = np.hypot(*to_light[:2]) / to_light[2]
    E_sd = np.hypot(np.pi / to_light[2] * np.hypot(Ls_sd, PAPER_SD * whole), E * slant * sigma)
    scaled = around * (Ls / level).astype(np.float32) if rows and around is not None else None
    return Light(to_light, sigma, E, E_sd, Ls, Ls_sd, scaled)


def _tilts(direction: np.ndarray, sigma: float) -> list[np.ndarray]:
    """The direction turned by `sigma` radians, either way across."""
    turned = direction + sigma * np.linalg.svd(direction[None])[2][1:]
    return list(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def _as_environment(texels: np.ndarray) -> Environment:
    return Environment(texels.shape[1::-1], np.ascontiguousarray(texels, "<f4").tobytes())


def _upper(around: np.ndarray) -> Any:
    """The map's upper half as a light; a coarse map is made finer first, so that its horizon is sharp."""
    fine = around.repeat(max(1, 16 // len(around)), axis=0).repeat(max(1, 16 // len(around)), axis=1)
    fine[len(fine) // 2 :] = 0
    return environment_map(_as_environment(fine))


def upward(around: np.ndarray) -> np.ndarray:
    """(3): the irradiance on level paper over π: the constant sky that gives it as much light."""
    return np.array(_upper(around).diffuse_irradiance((0.0, 0.0, 1.0)))


def sky_shape(around: np.ndarray) -> SkyShape:
    """Irradiance of the map's upper half on a surface, by its normal, over that on level paper."""
    light = _upper(around)
    return lambda n: np.stack(light.diffuse_irradiance(tuple(n.T)), axis=1) / upward(around)


def errors(light: Light, found: Evidence) -> dict[str, float]:
    """Per kind of evidence the rms error of the light's prediction, as a share of the mean of what is seen."""
    errors = {}
    for k, m in enumerate(found.matt):
        to_light = light.to_light if light.to_light is not None else np.array([0.0, 0.0, 1.0])
        shape = sky_shape(light.around) if light.around is not None else None
        sun, sky = design(m.pixels, to_light, found.paper, shape)
        shown = light.E / np.pi * sun + light.Ls * sky
        # The best albedo is taken: what counts is the shape of the shading.
        albedo = (shown * m.pixels.value).sum(axis=0) / (shown**2).sum(axis=0)
        errors[f"matt ball {k}" if k else "matt ball"] = _relative(albedo * shown - m.pixels.value, m.pixels.value)
    off, values = [], []
    for mirror in found.mirrors:
        seen = mirror.pixels
        flat = light.around.reshape(-1, 3) if light.around is not None else None
        shown = bilinear(seen.to_light, len(light.around)) @ flat if light.around is not None else light.Ls
        difference = np.broadcast_to(shown, seen.radiance.shape) - seen.radiance
        difference = np.where(seen.clipped[:, None], np.minimum(difference, 0), difference)
        if light.to_light is not None:
            difference[seen.sun] = 0  # a sun there is bright enough
        up = seen.to_light[:, 2] > 0.05
        off.append(difference[up])
        values.append(seen.radiance[up])
    if off:
        errors["mirror ball"] = _relative(np.concatenate(off), np.concatenate(values))
    if s := found.shadow:
        ratio = light.Ls * s.left * PAPER / found.paper if light.to_light is not None else np.ones(3)
        lit = np.median(s.value[s.cover < 0.02], axis=0)
        inside = s.cover > 0.5
        predicted = lit * (1 - (1 - ratio) * s.cover[inside, None])
        errors["shadow"] = _relative(predicted - s.value[inside], s.value[inside])
    return errors


def shading(light: Light, normals: np.ndarray) -> np.ndarray:
    """(n, 3): irradiance over π of surfaces with such `normals` (n, 3), by the sun and the sky above."""
    sky = (1 + normals[:, 2:]) / 2 if light.around is None else sky_shape(light.around)(normals)
    sun = np.maximum(normals @ light.to_light, 0) if light.to_light is not None else np.zeros(len(normals))
    return light.E / np.pi * sun[:, None] + light.Ls * sky


def _relative(off: np.ndarray, values: np.ndarray) -> float:
    return float(np.sqrt((off**2).mean()) / values.mean()) if off.size else 0.0


def _folds(found: Evidence, photos: int) -> Iterator[tuple[Evidence, Evidence]]:
    """(what is fitted, what is held out)."""
    for k in range(min(photos, 4) if photos > 1 else 2):

        def held_out(pixels: Any, k: int = k) -> np.ndarray:
            return pixels.photo == k if photos > 1 else (pixels.uv // 8).sum(axis=1) % 2 == k

        def fitted(pixels: Any, held_out: Callable[[Any], np.ndarray] = held_out) -> np.ndarray:
            return ~held_out(pixels)

        yield found.part(fitted), found.part(held_out)


def choose(found: Evidence, photos: int) -> tuple[Light, list[Trial], int, list[tuple[str, np.ndarray, float]]]:
    """The light, all models tried, the number of the one taken, and what showed the sun's direction."""
    directions = directions_to_sun(found)
    sun = _mean_direction([(d, sd) for _, d, sd in directions]) if directions else None
    if sun and len(directions) > 1:  # what contradicts each other is known as badly as it differs (Birge 1932)
        spread = sum(((d - sun[0]) ** 2).sum() / (2 * sd**2) for _, d, sd in directions) / (len(directions) - 1)
        sun = (sun[0], sun[1] * float(np.sqrt(spread)) if spread > CONTRADICTS else sun[1])
    models = [("constant sky", 0, False)]
    models += [("sun + constant sky", 0, True)] if sun else []
    models += [(f"{'sun + ' if sun else ''}map of {r} rows", r, bool(sun)) for r in (ROWS if found.mirrors else ())]
    folds, trials = list(_folds(found, photos)), []
    lights = [solve(found, rows, sun if with_sun else None) for _, rows, with_sun in models]
    normals = fibonacci(200)[:100]
    last = shading(lights[-1], normals)
    for (name, rows, with_sun), light in zip(models, lights, strict=True):
        start = time.perf_counter()
        off = [errors(solve(train, rows, sun if with_sun else None), test) for train, test in folds]
        kinds = {k: float(np.sqrt(np.mean([e[k] ** 2 for e in off if k in e]))) for k in off[0]}
        total = float(np.sqrt(np.mean(np.square(list(kinds.values())))))
        on_sphere = _relative(shading(light, normals) - last, last)
        trials.append(Trial(name, rows, with_sun, total, on_sphere, time.perf_counter() - start, kinds))
    best = min(t.error for t in trials)
    taken = next(i for i, t in enumerate(trials) if t.error <= WORSE * best)
    return lights[taken], trials, taken, directions
