"""Sun and sky from all that stands beside the board, and no more of a model than held-out pixels ask for.

White paper in full light has a_p (E l.z/π + Ls) = P, which is known: a sky of Ls leaves E to the sun. A shadow's
darkness, a matt ball's shading and a mirror ball's map each tell Ls, and their mean by inverse variance is taken; a map
is scaled to it. Held-out pixels are photos that were not used, one at a time, or of a single photo every other patch.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from raytwin.calib.boards.board import PAPER
from raytwin.calib.lighting.ball_outline import Ball
from raytwin.calib.lighting.matt_ball import BallPixels, Shading, design, fit_shading
from raytwin.calib.lighting.mirror_ball import Mirrored, bilinear, fit_map
from raytwin.calib.lighting.stand_shadow import Shadow
from raytwin.lights.environment_map import environment_map
from raytwin.lights.envmap_tables import REC_709
from raytwin.scene import Environment

ROWS = 8, 16, 32
"""Rows of the maps that are tried."""

WORSE = 1.05
"""The least model whose error is at most this times that of the best one is taken."""

UNEVEN = 0.08
"""As a share: how far a matt ball's Ls is off where the sky is taken for constant and is not."""

PAPER_SD, REFLECTANCE_SD = 0.01, 0.03
"""As shares: how well the paper's light, and a mirror's reflectance, are known."""


@dataclass(frozen=True, eq=False)
class MattBall:
    ball: Ball
    pixels: BallPixels
    width: float


@dataclass(frozen=True, eq=False)
class MirrorBall:
    """`sun`: its direction and standard deviation in each photo, None where it is not seen; `known`: whether the
    reflectance was measured."""

    ball: Ball
    reflectance: np.ndarray
    known: bool
    seen: list[Mirrored]
    use: list[np.ndarray]
    sun: list[tuple[np.ndarray, float] | None]


@dataclass(frozen=True, eq=False)
class ShadowPlaces:
    """The paper about an upright: how much of the shadow lies at each place (n,), its light by photo (p, n, 3)."""

    shadow: Shadow
    cover: np.ndarray
    light: np.ndarray

    @property
    def ratio(self) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            dark, lit = (np.nanmedian(self.light[:, m], axis=(0, 1)) for m in (self.cover > 0.95, self.cover < 0.02))
        return dark / lit


@dataclass(frozen=True, eq=False)
class Evidence:
    paper: np.ndarray
    shadow: ShadowPlaces | None = None
    matt: list[MattBall] = field(default_factory=list)
    mirrors: list[MirrorBall] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Light:
    """The sun's direction `to_light` (None without one), its `sigma` (radians), E (3), and the sky: Ls (3), and the map
    (rows, 2 rows, 3) or None; standard deviations of E and Ls, of a map that of its irradiance on level paper."""

    to_light: np.ndarray | None
    sigma: float
    E: np.ndarray
    E_sd: np.ndarray
    Ls: np.ndarray
    Ls_sd: np.ndarray
    around: np.ndarray | None
    sources: tuple[str, ...] = ()
    shadings: tuple[Shading, ...] = ()

    def shown_map(self, rows: int) -> np.ndarray:
        """(rows, 2 rows, 3): the sky as a map, each texel repeated; the upper half alone where the sky is constant."""
        if self.around is None:
            half = np.broadcast_to(self.Ls.astype(np.float32), (rows // 2, 2 * rows, 3))
            return np.concatenate([half, 0 * half])
        each = rows // len(self.around)
        return np.repeat(np.repeat(self.around, each, axis=0), each, axis=1)

    @property
    def environment(self) -> Environment | None:
        if self.around is None:
            return None
        return Environment(self.around.shape[1::-1], np.ascontiguousarray(self.around, "<f4").tobytes())


@dataclass(frozen=True)
class Trial:
    """A model: how far off held-out pixels are, as a share of their mean; `rows` of its map, 0 for a constant sky."""

    name: str
    rows: int
    sun: bool
    error: float
    seconds: float
    by_kind: dict[str, float]


def directions_to_sun(found: Evidence) -> list[tuple[str, np.ndarray, float]]:
    """(what told it, direction, standard deviation in radians) of all that shows where the sun is."""
    told: list[tuple[str, np.ndarray, float]] = []
    if found.shadow:
        s = found.shadow.shadow
        level = np.hypot(*s.to_light[:2])
        told.append(("stand", s.to_light, float(np.sqrt(((s.sigma[0] * level) ** 2 + s.sigma[1] ** 2) / 2))))
    for mirror in found.mirrors:
        seen = [s for s, use in zip(mirror.sun, mirror.use, strict=True) if s is not None and use.any()]
        if seen:
            d, sd = _mean_direction([s[0] for s in seen], [s[1] for s in seen])
            told.append(("mirror ball", d, max(sd, min(s[1] for s in seen) / 1.4)))
    for m in found.matt:
        shading = fit_shading(m.pixels, m.ball, m.width, found.paper)
        if 4 * shading.E_sd @ REC_709 < shading.E @ REC_709 and shading.sigma < 0.2:
            told.append(("matt ball", shading.to_light, shading.sigma))
    return told


def _mean_direction(directions: list[np.ndarray], sds: list[float]) -> tuple[np.ndarray, float]:
    weight = 1 / np.array(sds) ** 2
    d = weight @ np.array(directions)
    return d / np.linalg.norm(d), float(1 / np.sqrt(weight.sum()))


def solve(found: Evidence, rows: int, sun: tuple[np.ndarray, float] | None) -> Light:
    """The light of this model: `rows` of the map, 0 for a constant sky; the `sun`'s direction and its deviation."""
    P = found.paper
    zero = np.zeros(3)
    around, level = None, None
    seen = [s for m in found.mirrors for s in m.seen]
    use = [u & ~s.sun for m in found.mirrors for s, u in zip(m.seen, m.use, strict=True)]
    if any(u.any() for u in use):
        around = fit_map(seen, rows or ROWS[0], use)
        level = upward(around)
    if sun is None and not rows:
        return Light(None, 0.0, zero, zero, P / PAPER, PAPER_SD * P / PAPER, None)
    if sun is None:
        assert level is not None
        return Light(None, 0.0, zero, zero, P / PAPER, PAPER_SD * P / PAPER, around * (P / PAPER / level))
    to_light, sigma = sun
    shape = _shape(around, level) if rows and around is not None and level is not None else None
    told: list[tuple[str, np.ndarray, np.ndarray]] = []
    if found.shadow:
        s = found.shadow
        told.append(("stand", s.ratio * P / PAPER / s.shadow.left, s.shadow.ratio_sd * P / PAPER))
    shadings = []
    for m in found.matt:
        fitted = fit_shading(m.pixels, m.ball, m.width, P, to_light, shape)
        shadings.append(fitted)
        # Turned by its deviation, the sun takes light from the sky, or gives it some.
        turned = [fit_shading(m.pixels, m.ball, m.width, P, t, shape).Ls for t in _tilts(to_light, sigma)]
        sd = np.sqrt(
            fitted.Ls_sd**2
            + np.mean([(t - fitted.Ls) ** 2 for t in turned], axis=0)
            + ((0.02 if shape else UNEVEN) * fitted.Ls) ** 2
        )
        told.append(("matt ball", fitted.Ls, sd))
    if level is not None:
        known = all(m.known for m in found.mirrors)
        told.append(("mirror ball", level, (REFLECTANCE_SD if known else 0.15) * level))
    weight = np.array([1 / sd**2 for *_, sd in told])
    Ls = (weight * np.array([x for _, x, _ in told])).sum(axis=0) / weight.sum(axis=0)
    Ls = np.minimum(Ls, P / PAPER)
    Ls_sd = np.hypot(1 / np.sqrt(weight.sum(axis=0)), PAPER_SD * Ls)
    E = np.pi * (P / PAPER - Ls) / to_light[2]
    E_sd = np.hypot(
        np.pi / to_light[2] * np.hypot(Ls_sd, PAPER_SD * P / PAPER), E * np.hypot(*to_light[:2]) / to_light[2] * sigma
    )
    scaled = around * (Ls / level).astype(np.float32) if rows and around is not None else None
    return Light(to_light, sigma, E, E_sd, Ls, Ls_sd, scaled, tuple(name for name, *_ in told), tuple(shadings))


def _tilts(direction: np.ndarray, sigma: float) -> list[np.ndarray]:
    """The direction turned by `sigma` radians, either way across."""
    turned = direction + sigma * np.linalg.svd(direction[None])[2][1:]
    return list(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def upward(around: np.ndarray) -> np.ndarray:
    """(3): the irradiance on level paper over π: the constant sky that gives it as much light."""
    h = len(around)
    theta = (np.arange(64 * h) + 0.5) / (64 * h) * np.pi / 2
    rows = np.clip(theta / np.pi * h - 0.5, 0, h - 1)
    j = np.minimum(rows.astype(int), h - 2)
    mean = around.mean(axis=1)
    light = mean[j] * (1 - (rows - j))[:, None] + mean[j + 1] * (rows - j)[:, None]
    weight = np.sin(theta) * np.cos(theta)
    return weight @ light / weight.sum()


def _shape(around: np.ndarray, level: np.ndarray) -> Any:
    """n (k, 3) -> (k, 3): irradiance of the map's upper half on a surface that faces n, over that on level paper."""
    fine = np.repeat(np.repeat(around, 2, axis=0), 2, axis=1) if len(around) < 16 else around.copy()
    fine[len(fine) // 2 :] = 0
    light = environment_map(Environment(fine.shape[1::-1], np.ascontiguousarray(fine, "<f4").tobytes()))

    def at(n: np.ndarray) -> np.ndarray:
        return np.stack(light.diffuse_irradiance(tuple(n.T)), axis=1) / np.asarray(
            light.diffuse_irradiance((0.0, 0.0, 1.0))
        )

    return at


def errors(light: Light, found: Evidence) -> dict[str, float]:
    """Per kind of evidence the rms error of the light's prediction, as a share of the mean of what is seen."""
    told = {}
    for k, m in enumerate(found.matt):
        if len(m.pixels.value):
            told[f"matt ball {k}" if k else "matt ball"] = _matt_error(light, m, found.paper)
    off, values = [], []
    for mirror in found.mirrors:
        for seen, use in zip(mirror.seen, mirror.use, strict=True):
            mine = use & (seen.to_light[:, 2] > 0.05)
            d, value, clipped, patch = seen.to_light[mine], seen.radiance[mine], seen.clipped[mine], seen.sun[mine]
            around = (
                bilinear(d, len(light.around)) @ light.around.reshape(-1, 3) if light.around is not None else light.Ls
            )
            difference = np.broadcast_to(around, value.shape) - value
            difference[clipped] = np.minimum(difference[clipped], 0)
            if light.to_light is not None:
                difference[patch] = 0  # a sun there is bright enough
            off.append(difference)
            values.append(value)
    if off:
        told["mirror ball"] = _relative(np.concatenate(off), np.concatenate(values))
    if found.shadow:
        ratio = np.ones(3)
        if light.to_light is not None:
            ratio = light.Ls * found.shadow.shadow.left * PAPER / found.paper
        light_there = found.shadow.light
        lit = np.nanmedian(light_there[:, found.shadow.cover < 0.02], axis=(0, 1))
        predicted = lit * (1 - (1 - ratio) * found.shadow.cover[:, None])
        inside = found.shadow.cover > 0.5
        difference = (predicted - light_there)[:, inside]
        told["shadow"] = _relative(difference, light_there[:, inside])
    return told


def _matt_error(light: Light, m: MattBall, paper: np.ndarray) -> float:
    """The best albedo is taken: what counts is the shape of the shading."""
    to_light = light.to_light if light.to_light is not None else np.array([0.0, 0.0, 1.0])
    shape = _shape(light.around, light.Ls) if light.around is not None else None
    sun, sky = design(m.pixels, to_light, paper, shape)
    shown = light.E / np.pi * sun + light.Ls * sky
    albedo = (shown * m.pixels.value).sum(axis=0) / (shown**2).sum(axis=0)
    return _relative((albedo * shown - m.pixels.value) / m.pixels.value.mean(axis=0), np.ones(1))


def _relative(off: np.ndarray, values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(off**2)) / np.nanmean(values))


def _part(found: Evidence, keep: Any) -> Evidence:
    """The evidence whose (photo index, patch number) `keep(photo, patch)` takes; patches are numbered anyhow."""
    matt = []
    for m in found.matt:
        mine = keep(m.pixels.photo, m.pixels.patch)
        pixels = BallPixels(*(getattr(m.pixels, k)[mine] for k in BallPixels.__dataclass_fields__))
        matt.append(replace(m, pixels=pixels))
    mirrors = [
        replace(m, use=[keep(np.full(len(s.uv), i), (s.uv // 8).sum(axis=1)) & u
                        for i, (s, u) in enumerate(zip(m.seen, m.use, strict=True))])
        for m in found.mirrors
    ]  # fmt: skip
    shadow = None
    if found.shadow:
        light = found.shadow.light.copy()
        photos, places = np.indices(light.shape[:2])
        light[~keep(photos, places // 40)] = np.nan
        shadow = replace(found.shadow, light=light)
    return replace(found, shadow=shadow, matt=[m for m in matt if len(m.pixels.value) > 50], mirrors=mirrors)


def _folds(found: Evidence, photos: int) -> Iterator[tuple[Evidence, Evidence]]:
    """(what is fitted, what is held out)."""
    for k in range(min(photos, 4) if photos > 1 else 2):
        if photos > 1:
            yield _part(found, lambda p, _, k=k: p != k), _part(found, lambda p, _, k=k: p == k)
        else:
            yield _part(found, lambda _, q, k=k: q % 2 != k), _part(found, lambda _, q, k=k: q % 2 == k)


def choose(found: Evidence, photos: int) -> tuple[Light, list[Trial], int, list[tuple[str, np.ndarray, float]]]:
    """The light, all models tried, the number of the one taken, and what told the sun's direction."""
    told = directions_to_sun(found)
    sun = _mean_direction([d for _, d, _ in told], [sd for *_, sd in told]) if told else None
    maps = ROWS if found.mirrors else ()
    models = [("constant sky", 0, False)]
    models += [("sun + constant sky", 0, True)] if sun else []
    models += [(f"{'sun + ' if sun else ''}map of {r} rows", r, bool(sun)) for r in maps]
    trials = []
    for name, rows, with_sun in models:
        start, found_errors = time.perf_counter(), []
        for train, test in _folds(found, photos):
            found_errors.append(errors(solve(train, rows, sun if with_sun else None), test))
        kinds = {k: float(np.sqrt(np.mean([e[k] ** 2 for e in found_errors if k in e]))) for k in found_errors[0]}
        total = float(np.sqrt(np.mean([e**2 for e in kinds.values()])))
        trials.append(Trial(name, rows, with_sun, total, time.perf_counter() - start, kinds))
    best = min(t.error for t in trials)
    taken = next(i for i, t in enumerate(trials) if t.error <= WORSE * best)
    chosen = trials[taken]
    return solve(found, chosen.rows, sun if chosen.sun else None), trials, taken, told
