"""Sun and sky from all that stands beside the board, and no more of a model than held-out pixels ask for.

White paper in full light has a_p (E l.z/π + Ls) = P, which is known: a sky of Ls leaves E to the sun. A shadow's
darkness, a matt ball's shading and a mirror ball's map each tell Ls, and their mean by inverse variance is taken; a map
is scaled to it. A mirror ball's map is the sky under which matt balls are read; where there is none, a matt ball's own
shading gives a coarse one. Held-out pixels are photos that were not used, one at a time, or of a single photo every
other patch.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from raytwin.calib.boards.board import PAPER
from raytwin.calib.ground_rings import fibonacci
from raytwin.calib.lighting import matt_ball
from raytwin.calib.lighting.ball_outline import Ball
from raytwin.calib.lighting.matt_ball import SKY, MattPixels, Shading, design, fit_shading
from raytwin.calib.lighting.mirror_ball import Mirrored, bilinear, fit_map
from raytwin.calib.lighting.stand_shadow import Shadow
from raytwin.lights.envmap_tables import REC_709, texel_directions
from raytwin.scene import Environment

ROWS = 8, 16, 32
"""Rows of the maps that are tried."""

ERROR_SLACK = 1.05
"""The least model whose error is at most this times that of the best one is taken."""

SUN_ERROR_RATIO, SUN_SIGMAS = 0.8, 3.0
"""A sun is accepted if it lowers the constant sky's error to this share or less, and if its irradiance exceeds this
many of its standard deviations."""

MATT_LS, MATT_DEGREES = 0.03, 0.5
"""Standard deviations of what a matt ball shows, because of light from its neighbours: Ls as a share; the direction of
the sun, in degrees per angle."""

PAPER_SD, REFLECTANCE_SD, REFLECTANCE_UNKNOWN = 0.01, 0.03, 0.15
"""As shares: how well the paper's light, and a mirror's reflectance, measured or not, are known."""

CHANNEL_SD = 0.1
"""Standard deviation of the sky's share of a channel's light from the mean of all channels. A channel that is poorly
measured, such as a dark one of a matt ball, is drawn to the others."""

LOG_EVIDENCE = 15.0
"""Logarithm of how much likelier an even sky must make a matt ball's shading than an uneven one to be taken."""

CONTRADICTS = 4.0
"""Reduced chi-squared of the measured sun directions above which they contradict each other and sigma is raised."""

LEAST_PIXELS = 50
"""Pixels of a ball that a fit needs."""

PATCH = 8
"""Pixels across a patch of a matt ball, over whose mean noise drops out when models are compared."""

Sun = tuple[np.ndarray, float]
"""A direction, and its standard deviation in radians."""


@dataclass(frozen=True, eq=False)
class MattBall:
    ball: Ball
    pixels: MattPixels


@dataclass(frozen=True, eq=False)
class MirrorBall:
    """`known`: the reflectance was measured; `sun`: where it is, if the ball shows one."""

    ball: Ball
    pixels: Mirrored
    reflectance: np.ndarray
    known: bool
    sun: Sun | None


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

        shadow = taken(self.shadow) if self.shadow else None
        matt = [replace(m, pixels=taken(m.pixels)) for m in self.matt]
        mirrors = [replace(m, pixels=taken(m.pixels)) for m in self.mirrors]
        return Evidence(
            self.paper, shadow if shadow and len(shadow.photo) >= LEAST_PIXELS else None,
            [m for m in matt if len(m.pixels.photo) >= LEAST_PIXELS],
            [m for m in mirrors if len(m.pixels.photo) >= LEAST_PIXELS],
        )  # fmt: skip

    def mirrored_map(self, rows: int) -> np.ndarray | None:
        return fit_map([m.pixels for m in self.mirrors], rows) if self.mirrors else None


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
    def environment(self) -> Environment | None:
        if self.around is None:
            return None
        return Environment(self.around.shape[1::-1], np.ascontiguousarray(self.around, "<f4").tobytes())

    def received(self, normals: np.ndarray) -> np.ndarray:
        """(n, 3): irradiance over π that the sky above gives surfaces with such `normals` (n, 3)."""
        if self.around is None:
            return self.Ls * (1 + normals[:, 2:]) / 2
        directions, light = _upper(self.around)
        return np.maximum(normals @ directions.T, 0) @ light / np.pi


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


def _texels(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """(2 rows², 3) directions of a map's texels, and the steradians (2 rows²,) of each."""
    edges = np.cos(np.linspace(0, np.pi, rows + 1))
    return texel_directions(rows, 2 * rows).reshape(-1, 3), np.repeat((edges[:-1] - edges[1:]) * np.pi / rows, 2 * rows)


def _repeated(around: np.ndarray, rows: int) -> np.ndarray:
    times = max(1, rows // len(around))
    return around.repeat(times, axis=0).repeat(times, axis=1)


def _upper(around: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions (n, 3) of the map's upper half, in 16 rows or more, and the light (n, 3) that comes from each."""
    fine = _repeated(around, 16)
    directions, area = _texels(len(fine))
    half = len(directions) // 2
    return directions[:half], fine.reshape(-1, 3)[:half] * area[:half, None]


def upward(around: np.ndarray) -> np.ndarray:
    """(3): the irradiance on level paper over π: the constant sky that gives it as much light."""
    directions, light = _upper(around)
    return directions[:, 2] @ light / np.pi


def _as_sky(around: np.ndarray) -> np.ndarray:
    """(directions, 3): the map's radiance over Ls, its mean about each of the directions of a matt ball's sky."""
    directions, light = _upper(around)
    near = np.eye(len(SKY))[(directions @ SKY.T).argmax(axis=1)]
    sky = near.T @ light / (near.T @ _texels(len(_repeated(around, 16)))[1][: len(light), None])
    return sky / (matt_ball.UP @ sky)


def _as_map(shadings: list[Shading], matt: list[MattBall], Ls: np.ndarray) -> np.ndarray:
    """(8, 16, 3): the sky that matt balls show, of level irradiance Ls, and below it the ground's mean radiance."""
    rows = ROWS[0]
    directions, half = _texels(rows)[0], rows * rows
    sky = np.mean([s.sky for s in shadings], axis=0)
    mean = sky.mean(axis=0)
    upper = np.maximum(
        mean + matt_ball.sky_correlation(directions[:half], SKY) @ (matt_ball.SKY_COVARIANCE_INVERSE @ (sky - mean)),
        0.02 * mean,
    )
    below, seen = (np.concatenate([getattr(m.pixels, name) for m in matt]) for name in ("normal", "ground"))
    below = (1 - below[:, 2:]) / 2
    ground = (below * seen).sum(axis=0) / (below**2).sum()
    around = np.concatenate([upper, np.broadcast_to(ground, upper.shape)]).reshape(rows, 2 * rows, 3)
    around[: rows // 2] *= Ls / upward(around)
    return around.astype(np.float32)


def shading_of(m: MattBall, paper: np.ndarray, sky: np.ndarray | None, known: np.ndarray | None = None) -> Shading:
    """What a matt ball shows under the sky that a mirror ball shows (directions, 3), or else under one of its own: an
    even one where that is much likelier."""
    if sky is not None:
        return fit_shading(m.pixels, m.ball, paper, known, sky, matt_ball.MAPPED)
    even, uneven = (
        fit_shading(m.pixels, m.ball, paper, known, None, amount) for amount in (matt_ball.EVEN, matt_ball.UNEVEN)
    )
    return even if even.evidence > uneven.evidence + LOG_EVIDENCE else uneven


def directions_to_sun(found: Evidence) -> list[tuple[str, np.ndarray, float]]:
    """(what showed it, direction, standard deviation in radians) of all that shows where the sun is."""
    directions: list[tuple[str, np.ndarray, float]] = []
    if found.shadow:
        directions.append(("stand", found.shadow.to_light, found.shadow.sigma))
    directions += [("mirror ball", *mirror.sun) for mirror in found.mirrors if mirror.sun]
    around = found.mirrored_map(ROWS[0])
    for m in found.matt:
        shading = shading_of(m, found.paper, None if around is None else _as_sky(around))
        surely = 4 * shading.E_sd @ REC_709 < shading.E @ REC_709 and shading.sigma < 0.2
        if surely and shading.to_light[2] > 0 and shading.residual < 2 * matt_ball.USUAL:
            directions.append(("matt ball", shading.to_light, float(np.hypot(shading.sigma, np.radians(MATT_DEGREES)))))
    return directions


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
    around = found.mirrored_map(rows or ROWS[0])
    level = upward(around) if around is not None else whole
    if sun is None:
        scaled = around * (whole / level).astype(np.float32) if rows and around is not None else None
        return Light(None, 0.0, zero, zero, whole, PAPER_SD * whole, scaled)
    to_light, sigma = sun
    sky = _as_sky(around) if around is not None else None
    estimates: list[tuple[np.ndarray, np.ndarray]] = []
    shadings = []
    if found.shadow:
        ratio, sd = found.shadow.levels()
        estimates.append((ratio * whole / found.shadow.left, sd * whole))
    for m in found.matt:
        # Turn the sun by its standard deviation; the change in the fitted sky adds to the sky's uncertainty.
        towards = [to_light, *_tilts(to_light, sigma)]
        fitted, *turned = (shading_of(m, found.paper, sky, d) for d in towards)
        spread = np.mean([(t.Ls - fitted.Ls) ** 2 for t in turned], axis=0)
        estimates.append((fitted.Ls, np.sqrt(fitted.Ls_sd**2 + spread + (MATT_LS * fitted.Ls) ** 2)))
        shadings.append(fitted)
    if around is not None:
        known = all(m.known for m in found.mirrors)
        estimates.append((level, (REFLECTANCE_SD if known else REFLECTANCE_UNKNOWN) * level))
    weight = np.array([sd**-2.0 for _, sd in estimates])
    mean = (weight * np.array([value for value, _ in estimates])).sum(axis=0) / weight.sum(axis=0)
    share, var = mean / whole, 1 / (weight.sum(axis=0) * whole**2)
    own, all_of = CHANNEL_SD**2 / (CHANNEL_SD**2 + var), 1 / (CHANNEL_SD**2 + var)
    share = own * share + (1 - own) * (all_of @ share) / all_of.sum()
    Ls = np.clip(share, 0, 1) * whole  # no light takes any away
    Ls_sd = np.hypot(np.sqrt(own * var + (1 - own) ** 2 / all_of.sum()) * whole, PAPER_SD * Ls)
    E = np.pi * (whole - Ls) / to_light[2]
    slant = np.hypot(*to_light[:2]) / to_light[2]
    E_sd = np.hypot(np.pi / to_light[2] * np.hypot(Ls_sd, PAPER_SD * whole), E * slant * sigma)
    if rows:
        around = around * (Ls / level).astype(np.float32) if around is not None else _as_map(shadings, found.matt, Ls)
    return Light(to_light, sigma, E, E_sd, Ls, Ls_sd, around if rows else None)


def _tilts(direction: np.ndarray, sigma: float) -> list[np.ndarray]:
    """The direction turned by `sigma` radians, either way across."""
    turned = direction + sigma * np.linalg.svd(direction[None])[2][1:]
    return list(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def errors(light: Light, found: Evidence) -> dict[str, float]:
    """Per kind of evidence the rms error of the light's prediction, as a share of the mean of what is seen."""
    errors = {}
    for k, m in enumerate(found.matt):
        to_light = light.to_light if light.to_light is not None else np.array([0.0, 0.0, 1.0])
        sun, sky = design(m.pixels, to_light, found.paper, light.received(m.pixels.normal) / np.maximum(light.Ls, 1e-9))
        shown = light.E / np.pi * sun + light.Ls * sky
        # The best albedo is taken: what counts is the shape of the shading.
        albedo = (shown * m.pixels.value).sum(axis=0) / (shown**2).sum(axis=0)
        place = np.c_[m.pixels.photo, m.pixels.uv // PATCH]
        patch = np.unique(place, axis=0, return_inverse=True)[1].ravel()
        off = [np.bincount(patch, o) / np.bincount(patch) for o in (albedo * shown - m.pixels.value).T]
        errors[f"matt ball {k}" if k else "matt ball"] = _relative(np.stack(off), m.pixels.value)
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
        bare = s.cover < 0.02
        lit = np.median(s.value[bare], axis=0) if bare.any() else found.paper
        inside = s.cover > 0.5
        predicted = lit * (1 - (1 - ratio) * s.cover[inside, None])
        errors["shadow"] = _relative(predicted - s.value[inside], s.value[inside])
    return errors


def _relative(off: np.ndarray, values: np.ndarray) -> float:
    return float(np.sqrt((off**2).mean()) / values.mean()) if off.size else 0.0


def _folds(found: Evidence, photos: int) -> Iterator[tuple[Evidence, Evidence]]:
    """(what is fitted, what is held out)."""
    for k in range(min(photos, 4) if photos > 1 else 2):

        def held_out(pixels: Any, k: int = k) -> np.ndarray:
            return pixels.photo == k if photos > 1 else (pixels.uv // PATCH).sum(axis=1) % 2 == k

        def fitted(pixels: Any, held_out: Callable[[Any], np.ndarray] = held_out) -> np.ndarray:
            return ~held_out(pixels)

        yield found.part(fitted), found.part(held_out)


def choose(found: Evidence, photos: int) -> tuple[Light, list[Trial], int, list[tuple[str, np.ndarray, float]]]:
    """The light, all models tried, the number of the one taken, and what showed the sun's direction."""
    directions = directions_to_sun(found)
    sun = _mean_direction(directions) if directions else None
    folds, lights, trials = list(_folds(found, photos)), [], []
    normals = fibonacci(200)[:100]

    def attempt(rows: int, sun: Sun | None) -> None:
        start = time.perf_counter()
        lights.append(solve(found, rows, sun))
        off = [errors(solve(train, rows, sun), test) for train, test in folds]
        kinds = {k: float(np.sqrt(np.mean([e[k] ** 2 for e in off if k in e]))) for k in sorted(set().union(*off))}
        total = float(np.sqrt(np.mean(np.square(list(kinds.values()) or [0.0]))))
        name = ("sun + " if sun else "") + (f"map of {rows} rows" if rows else "constant sky")
        trials.append(Trial(name, rows, sun is not None, total, 0.0, time.perf_counter() - start, kinds))

    def shading(light: Light) -> np.ndarray:
        lit = np.maximum(normals @ light.to_light, 0) if light.to_light is not None else np.zeros(len(normals))
        return light.E / np.pi * lit[:, None] + light.received(normals)

    attempt(0, None)
    if sun:
        attempt(0, sun)
        asked_for = trials[1].error < SUN_ERROR_RATIO * trials[0].error
        if not (asked_for and SUN_SIGMAS * lights[1].E_sd @ REC_709 < lights[1].E @ REC_709):
            sun = None
    for rows in ROWS if found.mirrors else ROWS[:1] if found.matt and sun else ():
        attempt(rows, sun)
    last = shading(lights[-1])
    trials = [replace(t, on_sphere=_relative(shading(s) - last, last)) for t, s in zip(trials, lights, strict=True)]
    allowed = [i for i, t in enumerate(trials) if not t.sun or sun]
    best = min(trials[i].error for i in allowed)
    taken = next(i for i in allowed if trials[i].error <= ERROR_SLACK * best)
    return lights[taken], trials, taken, directions
