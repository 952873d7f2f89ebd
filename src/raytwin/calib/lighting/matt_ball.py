"""A matt ball's shading is linear in what lights it: the sun, the sky above, and the ground, which the photo shows.

Where its normal is n a ball of albedo a has radiance

    a/π E max(0, n·l) + a ∫ L(ω) max(0, n·ω) dω / π + a/π G(n)

with G the irradiance from the ground about it, summed over what the photos show of that ground. Paper beside it has
a_p/π E l.z + a_p Ls, Ls being the constant sky that lights level paper as L does. What is fitted, α = a E/π and
β = a Ls, therefore tells a: a_p (α l.z + β) over the paper's radiance, and G is linear in α and β, too.

The sky is a radiance in each of some directions. Shading alone cannot tell so many, but a sky is smooth: it is taken
for a Gaussian process (Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006) of a stated unevenness
about a constant or about a mirror ball's map. That is linear, too, and its posterior is how well sun and sky are known;
how likely it makes the photo tells how uneven the sky is. Two angles of the sun are left for a nonlinear fit: the sun
alone has an edge in its shading.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from raytwin.calib.boards.board import PAPER
from raytwin.calib.ground_rings import fibonacci, filled, polynomials, rings_about, weights
from raytwin.calib.lighting.ball_outline import Ball, pixels_of, reflect
from raytwin.calib.lighting.board_plane import hidden_by, seen_light
from raytwin.calib.lighting.linear_photo import LinearPhoto
from raytwin.lights.envmap_tables import REC_709

MOST_PIXELS = 700
"""Pixels of a ball in a photo that are fitted: more say the same again."""

RINGS, TURNS = 40, 72
"""Places on the ground about the ball."""

LOWEST_NORMAL = -0.7
"""Least z of the normals for which the ground's light is fitted; no photo shows normals that point lower."""

RIM_COSINE = 0.4
"""The least cosine between ray and normal: nearer to the outline the photo's own blur mixes in what is behind."""

EVEN, UNEVEN, MAPPED = 0.1, 1.0, 0.1
"""Standard deviation of a sky's radiance as a share of its mean: of a constant one, an uneven one, and a mapped one."""

SKY_KAPPA = 5.0
"""κ of a sky's correlation exp(κ (cos γ - 1)) between directions γ apart: lamps and clouds of some 35 degrees."""

NOISE, GROUND_NOISE, GROUND_SD = 0.02, 0.05, 0.1
"""Standard deviations, as shares: of a pixel, relative to the mean; of the ground's part of a pixel, which is known
less well; and of a factor common to all of the ground's part."""

GLOSS = 0.01
"""Least standard deviation of a pixel due to gloss and rough skin, in any channel, as a share of the paper's light."""

CORRELATED_PIXELS = 20
"""Fitted pixels that err together."""

MATT, NO_MIRROR, USUAL = 0.15, 0.35, 0.12
"""Root mean squared residual over the mean: a ball whose shading fits worse is not matt, or is not
even where no mirror image is seen in it; and the one from which standard deviations grow with it."""


@dataclass(frozen=True, eq=False)
class MattPixels:
    """Pixels `uv` (n, 2) of a ball in the photos of index `photo` (n,): `normal` (n, 3), `value` (n, 3), `ground`
    (n, 3) = G/π."""

    photo: np.ndarray
    uv: np.ndarray
    normal: np.ndarray
    value: np.ndarray
    ground: np.ndarray


@dataclass(frozen=True, eq=False)
class Shading:
    """`to_light` (3), `sigma` radians across; `E`, `Ls` (3) in the paper's units, with `E_sd`, `Ls_sd` for this
    direction; `sky` (directions, 3): radiance over Ls.

    `residual`: root mean square over the mean radiance. Of two fits that of more `evidence` explains the photo better.
    """

    to_light: np.ndarray
    sigma: float
    E: np.ndarray
    E_sd: np.ndarray
    Ls: np.ndarray
    Ls_sd: np.ndarray
    sky: np.ndarray
    residual: float
    evidence: float


SKY = fibonacci(64)[:32]
UP = 2 / len(SKY) * SKY[:, 2]
"""What each direction's radiance adds to the irradiance on level paper over π."""


def sky_correlation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, m): how a sky's radiance in directions a (n, 3) goes with that in b (m, 3)."""
    return np.exp(SKY_KAPPA * (a @ b.T - 1))


SKY_COVARIANCE_INVERSE = np.linalg.inv(sky_correlation(SKY, SKY) + 1e-3 * np.eye(len(SKY)))


def matt_pixels(photos: list[LinearPhoto], ball: Ball) -> MattPixels:
    """The ball's pixels, and what each gets from rings of places on the ground: means over the photos that show them.

    The last ring stands for all farther.
    """
    at, _, area = rings_about(ball.center, ball.radius, 0.3, 40, RINGS, TURNS)
    light, seen = seen_light(photos, at, lambda photo: hidden_by(photo, ball, at))
    known = filled(np.where(seen[:, None], light, np.nan), TURNS)
    light = np.zeros_like(at) if known is None else known
    normals = fibonacci(600)
    normals = normals[normals[:, 2] > LOWEST_NORMAL]
    received = weights(ball.center, ball.radius, normals, at, area) @ light / np.pi
    ground = np.linalg.lstsq(polynomials(normals), received, rcond=None)[0]
    parts = []
    for k, photo in enumerate(photos):
        uv = pixels_of(photo, ball)
        p, _, cosine = reflect(photo, ball, uv)
        keep = np.flatnonzero((cosine > RIM_COSINE) & ~photo.clipped[uv[:, 1], uv[:, 0]])
        keep = keep[:: max(1, len(keep) // MOST_PIXELS)]
        uv, n = uv[keep], (p[keep] - ball.center) / ball.radius
        parts.append((0 * keep + k, uv, n, photo.light[uv[:, 1], uv[:, 0]].astype(float), polynomials(n) @ ground))
    return MattPixels(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def design(
    pixels: MattPixels, to_light: np.ndarray, paper: np.ndarray, received: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) each: what α and β are multiplied by, a channel a column.

    `paper`: its radiance in full light; `received` (n, 3): the sky's irradiance there over that on level paper.
    """
    g = PAPER / paper * pixels.ground
    return np.maximum(pixels.normal @ to_light, 0)[:, None] + max(to_light[2], 0) * g, received + g


def _received(normals: np.ndarray) -> np.ndarray:
    """(n, directions): what the sky's radiance in each direction adds to the irradiance over π."""
    return 2 / len(SKY) * np.maximum(normals @ SKY.T, 0)


@dataclass(frozen=True, eq=False)
class _Problem:
    """A ball's pixels, weighed, and what is known of the sky: `base` (directions, 3) over Ls, `uneven`, and roughly β
    and α l.z + β (3)."""

    pixels: MattPixels
    paper: np.ndarray
    base: np.ndarray
    uneven: float
    level: np.ndarray
    total: np.ndarray
    weight: np.ndarray
    """(n, 3): one over a pixel's standard deviation."""

    def solve(self, to_light: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """α, the sky's radiance times a, and by how much more the ground gives (1 + directions + 1, 3); its covariances
        (3, ., .); the weighed residuals and what is known of sky and ground; and the evidence."""
        g = PAPER / self.paper * self.pixels.ground
        lit, sky = np.maximum(self.pixels.normal @ to_light, 0), _received(self.pixels.normal)
        found, covs, left, evidence = [], [], [], 0.0
        for c in range(3):
            A = np.c_[lit + max(to_light[2], 0) * g[:, c], sky + g[:, c, None] * UP, self.total[c] * g[:, c]]
            A *= self.weight[:, c, None]
            prior = SKY_COVARIANCE_INVERSE / (self.uneven * self.level[c]) ** 2
            along = prior @ self.base[:, c]  # β itself is free
            prior = prior - np.outer(along, along) / (along @ self.base[:, c])
            root = np.linalg.eigh(prior)
            smooth = np.sqrt(np.maximum(root[0], 0))[:, None] * root[1].T
            known = np.zeros((len(SKY) + 1, A.shape[1]))
            known[:-1, 1:-1], known[-1, -1] = smooth, 1 / GROUND_SD
            full = np.r_[A, known]
            normal = full.T @ full + 1e-9 * np.eye(A.shape[1])
            x = np.linalg.solve(normal, A.T @ (self.weight[:, c] * self.pixels.value[:, c]))
            off = full @ x
            off[: len(A)] -= self.weight[:, c] * self.pixels.value[:, c]
            volume = np.linalg.slogdet(normal)[1] + 2 * (len(SKY) - 1) * np.log(self.uneven * self.level[c])
            evidence -= off @ off + volume
            found.append(x)
            covs.append(np.linalg.inv(normal))
            left.append(off)
        return np.stack(found, axis=1), np.stack(covs), np.concatenate(left), evidence / 2

    def best(self, start: np.ndarray) -> tuple[np.ndarray, float]:
        """The direction near `start` that fits best, and its standard deviation."""
        axes = np.linalg.svd(start[None])[2][1:]

        def turned(y: np.ndarray) -> np.ndarray:
            to_light = start + y @ axes
            return to_light / np.linalg.norm(to_light)

        fit = least_squares(lambda y: self.solve(turned(y))[2], np.zeros(2), x_scale=0.05, diff_step=1e-3, max_nfev=20)
        cov = np.linalg.inv(fit.jac.T @ fit.jac + 1e-6 * np.eye(2))
        return turned(fit.x), float(np.sqrt(np.trace(cov) / 2))


def fit_shading(
    pixels: MattPixels, ball: Ball, paper: np.ndarray, known: np.ndarray | None = None, base: np.ndarray | None = None,
    uneven: float = EVEN,
) -> Shading:  # fmt: skip
    """Sun and sky from the ball's pixels; `known`: the sun's direction, if it is; `base`: the sky about which theirs
    varies, (directions, 3) over Ls, by default a constant one."""
    scale = pixels.value.mean(axis=0)
    own = np.hypot(NOISE * scale, GROUND_NOISE * PAPER * scale / paper * pixels.ground)
    gloss = GLOSS * (paper @ REC_709)
    sd = np.hypot(own, gloss) * np.sqrt(CORRELATED_PIXELS)
    base = np.ones((len(SKY), 3)) / UP.sum() if base is None else base
    fit = _Problem(pixels, paper, base, EVEN, 0.3 * scale, scale, 1 / sd)
    to_light = known
    if to_light is None:
        few = slice(None, None, max(1, len(pixels.photo) // 150))
        rough = replace(fit, pixels=_rows(pixels, few), weight=fit.weight[few])
        grid = fibonacci(300)[:150]
        to_light = grid[int(np.argmin([(rough.solve(d)[2] ** 2).sum() for d in grid]))]
    sigma = 0.0
    for amount in (EVEN, uneven):
        found = fit.solve(to_light)[0]
        level = np.maximum(UP @ found[1:-1], 0.02 * scale)
        fit = replace(fit, uneven=amount, level=level, total=level + np.maximum(found[0], 0) * max(to_light[2], 0))
        if known is None:
            to_light, sigma = fit.best(to_light)
        found, covs, left, evidence = fit.solve(to_light)
        off = left.reshape(3, -1)[:, : len(sd)].T * sd / scale
        dim = np.abs(off @ (scale * REC_709))
        # A highlight is brighter than any matt surface: what lies far above the fit is passed over.
        spread = 1.4826 * np.median(np.abs(off))
        bright = (off < -4 * spread - 0.03).any(axis=1)
        # What the fit leaves in luminance is gloss of no colour: every channel has it, and a dark one little else.
        sd = np.hypot(own, max(gloss, np.sqrt((dim[~bright] ** 2).mean()))) * np.sqrt(CORRELATED_PIXELS)
        fit = replace(fit, weight=np.where(bright, 0.05, 1.0)[:, None] / sd)
    residual = float(np.sqrt((dim**2).mean()) / (scale @ REC_709))
    misfit = max(1.0, residual / USUAL)
    alpha, beta = np.maximum(found[0], 0), np.maximum(UP @ found[1:-1], 1e-6)
    total, scaled = alpha * max(to_light[2], 0) + beta, paper / PAPER
    # E and Ls are functions of α/β: what turns (α, β) across that changes them.
    across = np.stack([np.r_[b, -a * UP, 0] for a, b in zip(alpha, beta, strict=True)])
    sd = np.sqrt(np.einsum("ci,cij,cj->c", across, covs, across)) * scaled / total**2 * misfit
    turned = np.linalg.norm([*ball.sigma[:2], ball.sigma[3]]) / ball.radius  # the outline turns all normals
    return Shading(
        to_light, float(np.hypot(misfit * sigma, turned)), np.pi * alpha / total * scaled, np.pi * sd,
        beta / total * scaled, max(to_light[2], 0) * sd, found[1:-1] / beta,
        residual, evidence,
    )  # fmt: skip


def _rows(pixels: MattPixels, keep: slice) -> MattPixels:
    return replace(pixels, **{name: column[keep] for name, column in vars(pixels).items()})
