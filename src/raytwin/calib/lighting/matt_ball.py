"""A matt ball's shading is linear in what lights it: the sun, the sky above, and the ground, which the photo shows.

Where its normal is n a ball of albedo a has radiance

    a/π E max(0, n·l) + a Ls (1 + n.z)/2 + a S(n)·g + a/π G(n)

with G the irradiance from the ground about it, summed over what the photos show of that ground, and S g what a sky
adds that is brighter towards one side: of radiance Ls + g·ω, g level, which gives level paper nothing. Paper beside it
has a_p/π E l.z + a_p Ls. What is fitted, α = a E/π and β = a Ls, therefore tells a: a_p (α l.z + β) over the paper's
radiance. With that, G is linear in α and β, too; two angles are left for a nonlinear fit.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from raytwin.calib.boards.board import PAPER
from raytwin.calib.lighting.ball_outline import Ball
from raytwin.calib.lighting.board_plane import hidden_by, seen_light
from raytwin.calib.lighting.linear_photo import LinearPhoto
from raytwin.calib.lighting.mirror_ball import pixels_of, reflect

SkyShape = Callable[[np.ndarray], np.ndarray]
"""Normals (n, 3) -> the sky's irradiance there over that on level paper, (n, 3)."""

MOST_PIXELS = 1200
"""Pixels of a ball in a photo that are fitted: more say the same again."""

RINGS, TURNS = 40, 72
"""Places on the ground about the ball."""

RIM_COSINE = 0.3
"""The least cosine between ray and normal: nearer to the outline the photo's own blur mixes in what is behind."""

SECTORS = 12
"""Parts of a ball's image: what a fit makes of all but one tells how well it is known."""

SLOPE = 0.5
"""How much brighter than its middle a sky may be towards one side: one standard deviation, as a share."""

TOGETHER = 60
"""Neighbouring pixels that err together: what the sky's slope is weighed against."""

NOISE, GROUND_NOISE = 0.02, 0.1
"""Shares by which a pixel is off: of the mean, and of the ground's part, which is known less well."""

MATT = 0.12
"""Root mean squared residual over the mean: a ball whose shading fits worse is not matt."""


@dataclass(frozen=True, eq=False)
class MattPixels:
    """Pixels `uv` (n, 2) of a ball in the photos of index `photo` (n,): `normal` (n, 3), `value` (n, 3), `ground`
    (n, 3) = G/π, `slope` (n, 2) = S."""

    photo: np.ndarray
    uv: np.ndarray
    normal: np.ndarray
    value: np.ndarray
    ground: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True, eq=False)
class Shading:
    """`to_light` (3), `sigma` radians across; `E`, `Ls` (3) in the paper's units, with `E_sd`, `Ls_sd`.

    `residual`: root mean square over the mean radiance. Without a sun E is 0 and `to_light` means nothing.
    """

    to_light: np.ndarray
    sigma: float
    E: np.ndarray
    E_sd: np.ndarray
    Ls: np.ndarray
    Ls_sd: np.ndarray
    residual: float


def matt_pixels(photos: list[LinearPhoto], ball: Ball) -> MattPixels:
    at, light, area = _ground(photos, ball)
    normals = fibonacci(400)
    to = at - (ball.center + ball.radius * normals)[:, None]
    facing = np.maximum((to * normals[:, None]).sum(axis=-1), 0) * np.maximum(-to[..., 2], 0)
    received = (facing / (to**2).sum(axis=-1) ** 2 * area) @ light / np.pi
    ground = np.linalg.lstsq(_smooth(normals), received, rcond=None)[0]
    sky = normals[normals[:, 2] > 0]
    parts = []
    for k, photo in enumerate(photos):
        uv = pixels_of(photo, ball)
        p, _, cosine = reflect(photo, ball, uv)
        keep = np.flatnonzero((cosine > RIM_COSINE) & ~photo.clipped[uv[:, 1], uv[:, 0]])
        keep = keep[:: max(1, len(keep) // MOST_PIXELS)]
        uv, n = uv[keep], (p[keep] - ball.center) / ball.radius
        slope = np.maximum(n @ sky.T, 0) @ sky[:, :2] * 2 / len(sky)
        parts.append((0 * keep + k, uv, n, photo.light[uv[:, 1], uv[:, 0]].astype(float), _smooth(n) @ ground, slope))
    return MattPixels(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def fibonacci(count: int) -> np.ndarray:
    """(count, 3): unit vectors spread evenly over the sphere, from the top down."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    return np.stack([np.sqrt(1 - z * z) * f(2.399963 * k) for f in (np.cos, np.sin)] + [z], axis=1)


def _smooth(n: np.ndarray) -> np.ndarray:
    """All products of a normal's components up to degree 4: irradiance hardly has more."""
    x, y, z = n.T
    return np.stack([x**i * y**j * z**k for i in range(5) for j in range(5 - i) for k in range(5 - i - j)], axis=1)


def _ground(photos: list[LinearPhoto], ball: Ball) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rings of places on the ground about the ball (m, 3), their radiance (m, 3) and area (m,).

    Means over the photos that show them; a place that none shows has its ring's mean, a ring that none shows that of
    its neighbours times the share of the sky that the ball leaves (a ball on a floor leaves 1 - (1 + (ρ/r)²)^(-3/2)).
    The last ring stands for all that is farther.
    """
    edges = ball.radius * np.concatenate([[0], np.geomspace(0.3, 40, RINGS)])
    far = (edges[:-1] + edges[1:]) / 2
    turns = (np.arange(TURNS) + 0.5) / TURNS * 2 * np.pi
    xy = ball.center[:2] + far[:, None, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    floor = min(0.0, float(ball.center[2] - ball.radius))
    at = np.concatenate([xy, np.full((RINGS, TURNS, 1), floor)], axis=-1).reshape(-1, 3)
    light, seen = seen_light(photos, at, lambda photo: hidden_by(photo, ball, at))
    light, seen = light.reshape(RINGS, TURNS, 3), seen.reshape(RINGS, TURNS)
    known = seen.any(axis=1)
    if known.any():
        open_sky = 1.02 - (1 + (far / ball.radius) ** 2) ** -1.5
        rings = light.sum(axis=1)[known] / seen.sum(axis=1)[known, None] / open_sky[known, None]
        mean = np.stack([np.interp(far, far[known], rings[:, c]) for c in range(3)], axis=1) * open_sky[:, None]
        light = np.where(seen[..., None], light, mean[:, None])
    area = np.pi * (edges[1:] ** 2 - edges[:-1] ** 2)[:, None] / TURNS * np.ones(TURNS)
    return at, light.reshape(-1, 3), area.ravel()


def design(
    pixels: MattPixels, to_light: np.ndarray, paper: np.ndarray, shape: SkyShape | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) each: what α and β are multiplied by, a channel a column; `paper`: its radiance in full light.

    `shape`: of the sky, by default a constant one's.
    """
    n = pixels.normal
    g = PAPER / paper * pixels.ground
    sun = np.maximum(n @ to_light, 0)[:, None] + max(to_light[2], 0) * g
    return sun, (shape(n) if shape else (1 + n[:, 2:]) / 2) + g


@dataclass(frozen=True, eq=False)
class _Fit:
    to_light: np.ndarray
    found: np.ndarray
    """α and β (2, 3)."""
    left: np.ndarray
    """(n, 3): model minus pixels, over the channel's mean."""


def fit_shading(
    pixels: MattPixels, ball: Ball, paper: np.ndarray, known: np.ndarray | None = None, shape: SkyShape | None = None,
    sectors: int = SECTORS,
) -> Shading:  # fmt: skip
    """Sun and sky from the ball's pixels; `known`: the sun's direction, if it is.

    Jackknife: each of the ball's `sectors` in turn is left out. Without any there is no standard deviation.
    """
    scale = pixels.value.mean(axis=0)
    ground = PAPER * pixels.value.mean(axis=0) / paper * pixels.ground / scale
    trust = NOISE / np.hypot(NOISE, GROUND_NOISE * ground).mean(axis=1)
    free, start = known is None, known
    if start is None:
        grid = fibonacci(600)[:300]
        start = grid[int(np.argmin([(_solve(pixels, g, paper, shape, trust).left ** 2).mean() for g in grid]))]
    fit = _best(pixels, start, free, paper, shape, trust)
    spread = 1.4826 * np.median(np.abs(fit.left))
    # A highlight is brighter than any matt surface: what lies far above the fit is passed over.
    trust = trust * np.where((fit.left < -4 * spread - 0.03).any(axis=1), 0.05, 1.0)
    fit = _best(pixels, fit.to_light, free, paper, shape, trust)
    middle = np.stack([np.bincount(pixels.photo, w) for w in pixels.uv.T], axis=1)
    off = pixels.uv - (middle / np.maximum(np.bincount(pixels.photo), 1)[:, None])[pixels.photo]
    sector = (np.arctan2(off[:, 1], off[:, 0]) / (2 * np.pi) * sectors).astype(int) % max(sectors, 1)
    albedo = _albedo(fit, paper)
    E, Ls = np.pi * fit.found[0] / albedo, fit.found[1] / albedo
    parts = []
    for k in range(sectors):
        mine = sector != k
        rest = replace(pixels, **{name: value[mine] for name, value in vars(pixels).items()})
        part = _best(rest, fit.to_light, free, paper, shape, trust[mine])
        a = _albedo(part, paper)
        parts.append([part.to_light - fit.to_light, np.pi * part.found[0] / a - E, part.found[1] / a - Ls])
    sds = np.sqrt(max(sectors - 1, 0) / max(sectors, 1) * (np.array(parts).reshape(sectors, 3, 3) ** 2).sum(axis=0))
    turned = np.linalg.norm([*ball.sigma[:2], ball.sigma[3]]) / ball.radius  # the outline turns all normals
    sigma = float(np.hypot(np.linalg.norm(sds[0]) / np.sqrt(2), turned))
    residual = float(np.sqrt((trust[:, None] * fit.left**2).mean()))
    return Shading(fit.to_light, sigma, E, sds[1], Ls, sds[2], residual)


def _albedo(fit: _Fit, paper: np.ndarray) -> np.ndarray:
    return np.maximum(PAPER * (fit.found[0] * max(fit.to_light[2], 0) + fit.found[1]) / paper, 1e-6)


def _solve(
    pixels: MattPixels, to_light: np.ndarray, paper: np.ndarray, shape: SkyShape | None, trust: np.ndarray
) -> _Fit:
    """α and β by least squares; neither light takes any away."""
    slope = pixels.slope if shape is None else 0 * pixels.slope
    lights = np.stack(design(pixels, to_light, paper, shape))
    A = np.concatenate([lights, np.broadcast_to(slope.T[..., None], (2, *lights.shape[1:]))])  # (4, n, channel)
    weighed = A * trust[:, None] ** 2
    scale = pixels.value.mean(axis=0)
    normal = np.einsum("inc,jnc->cij", weighed, A)
    ridge = len(trust) * (NOISE / SLOPE) ** 2 / TOGETHER
    normal += np.diag([1e-9, 1e-9, ridge, ridge])
    found = np.linalg.solve(normal, np.einsum("inc,nc->ci", weighed, pixels.value)[..., None])[..., 0].T
    if (found[:2] < 0).any():
        one = int(found[:2].sum(axis=1).argmax())
        alone = (weighed[one] * pixels.value).sum(axis=0) / (weighed[one] * A[one]).sum(axis=0)
        found = np.zeros_like(found)
        found[one] = np.maximum(alone, 0)
    return _Fit(to_light, found[:2], (np.einsum("inc,ic->nc", A, found) - pixels.value) / scale)


def _best(
    pixels: MattPixels, to_light: np.ndarray, free: bool, paper: np.ndarray, shape: SkyShape | None, trust: np.ndarray
) -> _Fit:
    """The fit at `to_light`, or if that is `free` at the best direction near it."""
    if not free:
        return _solve(pixels, to_light, paper, shape, trust)
    axes = np.linalg.svd(to_light[None])[2][1:]

    def fit(x: np.ndarray) -> _Fit:
        turned = to_light + x @ axes
        return _solve(pixels, turned / np.linalg.norm(turned), paper, shape, trust)

    def error(x: np.ndarray) -> np.ndarray:
        return np.asarray(fit(x).left * trust[:, None] / 0.03).ravel()

    return fit(least_squares(error, np.zeros(2), loss="soft_l1").x)
