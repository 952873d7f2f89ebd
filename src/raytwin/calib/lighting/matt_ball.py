"""A matt ball's shading is linear in what lights it: the sun, the sky above, and the ground, which the photo shows.

Where its normal is n a ball of albedo a has radiance

    a/π E max(0, n·l) + a Ls (1 + n.z)/2 + a/π G(n)

with G the irradiance from the ground about it, summed over what the photos show of that ground. Paper beside it has
a_p/π E l.z + a_p Ls. What is fitted, α = a E/π and β = a Ls, therefore tells a: a_p (α l.z + β) over the paper's
radiance. With that, G is linear in α and β, too; two angles are left for a nonlinear fit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from raytwin.calib.boards.board import PAPER
from raytwin.calib.lighting.ball_outline import Ball
from raytwin.calib.lighting.linear_photo import LinearPhoto
from raytwin.calib.lighting.mirror_ball import pixels_of, reflect

Shape = Callable[[np.ndarray], np.ndarray]

MOST_PIXELS = 1200
"""Pixels of a ball in a photo that are fitted: more say the same again."""

RINGS, TURNS = 40, 72
"""Places on the ground about the ball."""

RIM_COSINE = 0.3
"""The least cosine between ray and normal: nearer to the outline the photo's own blur mixes in what is behind."""

PATCHES = 6
"""Patches along each side of a ball's image: the residuals within one err together."""

MATT = 0.12
"""Root mean squared residual over the mean: a ball that is told worse by its shading is not matt."""


@dataclass(frozen=True, eq=False)
class Shading:
    """`to_light` (3), `sigma` radians across; `E`, `Ls` (3) in the paper's units, `E_sd`, `Ls_sd`; `albedo` (3).

    `residual`: root mean square over the mean radiance. Without a sun E is 0 and `to_light` means nothing.
    """

    to_light: np.ndarray
    sigma: float
    E: np.ndarray
    E_sd: np.ndarray
    Ls: np.ndarray
    Ls_sd: np.ndarray
    albedo: np.ndarray
    residual: float


@dataclass(frozen=True, eq=False)
class BallPixels:
    """Some pixels of a ball: `normal` (n, 3), `value` (n, 3), `ground` (n, 3) = G/π, which `patch` each is in, and
    of which `photo`, at `uv`."""

    normal: np.ndarray
    value: np.ndarray
    ground: np.ndarray
    patch: np.ndarray
    photo: np.ndarray
    uv: np.ndarray


def ball_pixels(photos: list[LinearPhoto], ball: Ball) -> BallPixels:
    at, light, area = _ground(photos, ball)
    normals = _fibonacci(400)
    to = at - (ball.center + ball.radius * normals)[:, None]
    squared = (to**2).sum(axis=-1)
    facing = np.maximum((to * normals[:, None]).sum(axis=-1), 0) * np.maximum(-to[..., 2], 0) / squared**2
    ground = np.linalg.lstsq(_smooth(normals), facing * area @ light / np.pi, rcond=None)[0]
    parts = []
    for k, photo in enumerate(photos):
        uv = pixels_of(photo, ball)
        p, _, cosine = reflect(photo, ball.center, ball.radius, uv)
        n = (p - ball.center) / ball.radius
        good = (cosine > RIM_COSINE) & ~photo.clipped[uv[:, 1], uv[:, 0]]
        low, high = uv.min(axis=0), uv.max(axis=0) + 1
        cell = ((uv - low) * PATCHES // (high - low)) @ [1, PATCHES] + k * PATCHES**2
        keep = np.flatnonzero(good)[:: max(1, good.sum() // MOST_PIXELS)]
        uv, p, n = uv[keep], p[keep], n[keep]
        parts.append(
            (n, photo.light[uv[:, 1], uv[:, 0]].astype(float), _smooth(n) @ ground, cell[keep], 0 * keep + k, uv)
        )
    return BallPixels(*(np.concatenate(x) for x in zip(*parts, strict=True)))


def _fibonacci(count: int) -> np.ndarray:
    """(count, 3): unit vectors spread evenly over the sphere."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    return np.stack([np.sqrt(1 - z * z) * f(2.399963 * k) for f in (np.cos, np.sin)] + [z], axis=1)


def _smooth(n: np.ndarray) -> np.ndarray:
    """All products of a normal's components up to degree 4: irradiance hardly has more."""
    x, y, z = n.T
    return np.stack([x**i * y**j * z**k for i in range(5) for j in range(5 - i) for k in range(5 - i - j)], axis=1)


def _ground(photos: list[LinearPhoto], ball: Ball) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rings of places on the ground about the ball (m, 3), their radiance (m, 3) and area (m,).

    Means over the photos that show them; a place that none shows has its ring's mean, or the next ring's times the
    share of the sky that the ball leaves (a ball on a floor leaves 1 - (1 + (ρ/r)²)^(-3/2)). The last ring stands for
    all that is farther.
    """
    floor = min(0.0, float(ball.center[2] - ball.radius))
    edges = ball.radius * np.concatenate([[0], np.geomspace(0.3, 40, RINGS)])
    turns = (np.arange(TURNS) + 0.5) / TURNS * 2 * np.pi
    far = (edges[:-1] + edges[1:]) / 2
    ring = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    xy = ball.center[:2] + far[:, None, None] * ring
    at = np.concatenate([xy, np.full((*xy.shape[:2], 1), floor)], axis=-1).reshape(-1, 3)
    seen = []
    for photo in photos:
        light = photo.at(photo.project(at))
        eye = np.array(photo.camera.eye)
        d = at - eye
        f = eye - ball.center
        t = np.clip(-(d @ f) / (d * d).sum(axis=1), 0, 1)
        light[np.linalg.norm(f + t[:, None] * d, axis=1) < 1.05 * ball.radius] = np.nan
        seen.append(light)
    stack = np.stack(seen)
    count = np.isfinite(stack).sum(axis=0)
    mean = np.where(count > 0, np.nansum(stack, axis=0) / np.maximum(count, 1), np.nan).reshape(len(far), len(turns), 3)
    open_sky = 1.02 - (1 + (far / ball.radius) ** 2) ** -1.5
    known = np.asarray(np.isfinite(mean).all(axis=2))
    inwards, outwards = range(len(far) - 1, -1, -1), range(len(far))
    last = 0
    for order in (outwards, inwards):  # what no photo shows under the ball is as dark as the little sky left there
        for i in order:
            if known[i].any():
                mean[i], last = np.where(known[i][:, None], mean[i], mean[i][known[i]].mean(axis=0)), i
            elif known[last].any():
                mean[i], known[i] = mean[last].mean(axis=0) * open_sky[i] / open_sky[last], order is inwards
    area = np.pi * (edges[1:] ** 2 - edges[:-1] ** 2)[:, None] / len(turns) * np.ones(len(turns))
    return at, np.nan_to_num(mean).reshape(-1, 3), area.ravel()


def design(
    pixels: BallPixels, to_light: np.ndarray, paper: np.ndarray, shape: Shape | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) each: what α and β are multiplied by, a channel a column; `paper`: its radiance in full light.

    `shape`: the sky's irradiance by normal, over that on level paper, (n, 3); by default a constant sky's.
    """
    n = pixels.normal
    g = PAPER / paper * pixels.ground
    sun = np.maximum(n @ to_light, 0)[:, None] + max(to_light[2], 0) * g
    return sun, (shape(n) if shape else (1 + n[:, 2:]) / 2) + g


def fit_shading(
    pixels: BallPixels,
    ball: Ball,
    width: float,
    paper: np.ndarray,
    known: np.ndarray | None = None,
    shape: Shape | None = None,
) -> Shading:
    """Sun and sky from the ball's pixels; `width` of its image in pixels; `known`: the sun's direction, if it is."""
    value, patch = pixels.value, np.unique(pixels.patch, return_inverse=True)[1]
    scale = value.mean(axis=0)
    # What the ground adds is known to a tenth, all else to a fiftieth of the mean.
    guess = PAPER * value.mean(axis=0) / paper
    doubt = np.hypot(0.02, 0.1 * guess * pixels.ground / scale).mean(axis=1)
    trust = 0.02 / doubt

    def solved(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """α and β (2, 3) by least squares, and what they leave (n, 3)."""
        sun, sky = design(pixels, direction, paper, shape)
        found, left = np.empty((2, 3)), np.empty_like(value)
        for c in range(3):
            A = np.stack([sun[:, c], sky[:, c]], axis=1)
            x = np.linalg.lstsq(A * trust[:, None], value[:, c] * trust, rcond=None)[0]
            if x.min() < 0:  # neither light takes any away
                one = int(x.argmax())
                x = np.zeros(2)
                x[one] = max(A[:, one] @ (trust**2 * value[:, c]) / (A[:, one] @ (trust**2 * A[:, one])), 0)
            found[:, c], left[:, c] = x, (A @ x - value[:, c]) / scale[c]
        return found, left

    if known is None:
        grid = _fibonacci(600)[:300]
        known = grid[int(np.argmin([(solved(g)[1] ** 2).mean() for g in grid]))]
        free = True
    else:
        free = False
    axes = np.linalg.svd(known[None])[2][1:]

    def tilted(x: np.ndarray) -> np.ndarray:
        d = known + x @ axes
        return d / np.linalg.norm(d)

    def error(x: np.ndarray, trust: np.ndarray) -> np.ndarray:
        return np.asarray(solved(tilted(x))[1] * trust[:, None] / 0.03).ravel()

    x, jac = np.zeros(2), None
    for _ in range(2):
        if free:
            result = least_squares(error, x, loss="soft_l1", args=(trust,))
            x, jac = result.x, result.jac
        _, left = solved(tilted(x))
        spread = 1.4826 * np.median(np.abs(left))
        # A highlight is brighter than any matt surface: what lies far above the fit is passed over.
        trust = 0.02 / doubt * np.where((left < -4 * spread - 0.03).any(axis=1), 0.05, 1.0)
    to_light = tilted(x)
    found, left = solved(to_light)
    albedo = PAPER * (found[0] * max(to_light[2], 0) + found[1]) / paper
    safe = np.maximum(albedo, 1e-6)
    center = float(np.hypot(ball.sigma[0], ball.sigma[1])) / ball.radius
    sigma, sds = _deviations(pixels, to_light, found, left, trust, jac, patch, paper, scale, shape)
    seen = np.linalg.norm([sigma, center, 0.3 / width])  # a third of a pixel of the outline turns all normals
    E, Ls = np.pi * found[0] / safe, found[1] / safe
    residual = float(np.sqrt((trust[:, None] * left**2).mean()))
    return Shading(to_light, float(seen), E, np.pi * sds[0] / safe, Ls, sds[1] / safe, albedo, residual)


def _deviations(
    pixels: BallPixels, to_light: np.ndarray, found: np.ndarray, left: np.ndarray, trust: np.ndarray,
    jac: np.ndarray | None, patch: np.ndarray, paper: np.ndarray, scale: np.ndarray, shape: Shape | None,
) -> tuple[float, np.ndarray]:  # fmt: skip
    """Standard deviations of the direction (radians, of either angle) and of α and β (2, 3): a sandwich over patches,
    whose residuals may err together as they like."""
    cut = np.arange(patch.max() + 1)
    sigma = 0.0
    if jac is not None:
        J = jac.reshape(len(left), 3, 2) * 0.03
        scores = np.stack([(J * (left * trust[:, None])[..., None])[patch == k].sum(axis=(0, 1)) for k in cut])
        bread = np.linalg.pinv(np.einsum("nci,ncj->ij", J, J))
        sigma = float(np.sqrt(np.trace(bread @ scores.T @ scores @ bread) / 2))
    sun, sky = design(pixels, to_light, paper, shape)
    sds = np.empty((2, 3))
    for c in range(3):
        A = np.stack([sun[:, c], sky[:, c]], axis=1) * trust[:, None]
        scores = np.stack([(A * (left[:, c] * scale[c] * trust)[:, None])[patch == k].sum(axis=0) for k in cut])
        bread = np.linalg.pinv(A.T @ A)
        sds[:, c] = np.sqrt(np.diag(bread @ scores.T @ scores @ bread))
    return sigma, sds
