"""A mirror ball is a photo of everything around it (Debevec, "Rendering Synthetic Objects into Real Scenes", 1998).

A pixel's ray d meets the ball where its normal is n, and goes on along ω = d - 2 (d·n) n: the pixel shows the light
from there, times the ball's reflectance. The board itself is in the mirror, and where it must be is known to a fraction
of a pixel: that is what the ball's place and radius are refined by, and its reflectance found by.

A map is what `scene.Environment` says, bilinear between texels' centres, so that its texels are a linear least squares
problem: each pixel weighs as many steradians as it shows, and neighbours are drawn together where no pixel looks.
Clipped pixels that fill a small angle are the sun: they are taken out.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy import ndimage, sparse
from scipy.optimize import least_squares
from scipy.sparse.linalg import spsolve

from raytwin.calib.boards.board import PAPER, Board, draw_board
from raytwin.calib.lighting.ball_outline import Ball, outline
from raytwin.calib.lighting.linear_photo import LinearPhoto, sample
from raytwin.lights.envmap_tables import REC_709

GRAZING = 0.2
"""The least cosine between ray and normal: nearer to the outline a pixel shows too much at once."""

TRIED, REFINED = 150, 2
"""Places that `register` tries, and how many of them it refines."""

BLURS = 6.0, 2.5
"""Pixels by which the photos are blurred while the ball's place is sought."""

SUN_DEGREES = 12.0
"""A clipped patch that fills no wider angle than this is a light of its own."""

SUN_PX = 8.0
"""Or is no wider than this: so far a lens spreads a point that is a thousand times too bright."""

SMOOTH = 1e-3
"""Weight of the difference of neighbouring texels, as a share of a texel's own: it decides where no pixel looks."""


@dataclass(frozen=True, eq=False)
class Mirrored:
    """What the pixels of one mirror ball in one photo show: `to_light` (n, 3), `radiance` (n, 3), `steradians` (n,),
    `clipped` (n,): at least so bright; `uv` (n, 2): which pixels; `sun` (n,): those of the sun's patch."""

    uv: np.ndarray
    to_light: np.ndarray
    radiance: np.ndarray
    steradians: np.ndarray
    clipped: np.ndarray
    sun: np.ndarray
    towards_eye: np.ndarray


def reflect(photo: LinearPhoto, center: np.ndarray, radius: float, uv: np.ndarray) -> tuple[np.ndarray, ...]:
    """(n, 3) points, (n, 3) reflected directions, (n,) cosine of ray and normal, NaN where the ball is missed."""
    return _reflected(np.array(photo.camera.eye), photo.rays(uv), center, radius)


def _reflected(eye: np.ndarray, d: np.ndarray, center: np.ndarray, radius: float) -> tuple[np.ndarray, ...]:
    f = eye - center
    b = d @ f
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - (f @ f - radius * radius))
    n = (f + (-b - root)[:, None] * d) / radius
    cosine = root / radius
    return center + radius * n, d + 2 * cosine[:, None] * n, cosine


def pixels_of(photo: LinearPhoto, ball: Ball) -> np.ndarray:
    """(n, 2): the pixels that show the ball, its rim left out."""
    rim = outline(photo, ball.center, ball.radius)
    low, high = np.floor(rim.min(axis=0)).astype(int), np.ceil(rim.max(axis=0)).astype(int)
    u, v = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    return uv[np.nan_to_num(reflect(photo, ball.center, ball.radius, uv)[2]) > GRAZING]


class Sheet:
    """The printed board as relative albedo, white 1, to be looked up at (x, y); NaN beyond the paper that is sure."""

    def __init__(self, board: Board, per_metre: float = 2000.0) -> None:
        albedo, self.extent = draw_board(board, per_metre)
        self.albedo, self.per_metre = albedo / np.float32(PAPER), per_metre
        self.blurred: dict[float, np.ndarray] = {0.0: self.albedo}

    def at(self, xy: np.ndarray, blur: float = 0.0) -> np.ndarray:
        """(n,): relative albedo at (n, 2), blurred by `blur` metres."""
        if blur not in self.blurred:
            self.blurred[blur] = cv2.GaussianBlur(self.albedo, (0, 0), blur * self.per_metre)
        return self._look(self.blurred[blur], xy)

    def plain_at(self, xy: np.ndarray, reach: float) -> np.ndarray:
        """(n,) bool: no edge between ink and paper within `reach` metres."""
        square = np.ones((1 + 2 * math.ceil(reach * self.per_metre),) * 2, np.uint8)
        span = cv2.dilate(self.albedo, square) - cv2.erode(self.albedo, square)
        return np.nan_to_num(self._look(span, xy), nan=1.0) < 0.05

    def _look(self, image: np.ndarray, xy: np.ndarray) -> np.ndarray:
        x0, _, _, y1 = self.extent
        return sample(image, np.stack([(xy[:, 0] - x0), (y1 - xy[:, 1])], axis=1) * self.per_metre - 0.5)


def on_board(points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n, 2): where rays meet the board's plane; NaN where they do not go down."""
    down = directions[:, 2] < -0.02
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(down, -points[:, 2] / directions[:, 2], np.nan)
    return points[:, :2] + t[:, None] * directions[:, :2]


@dataclass(frozen=True, eq=False)
class _Below:
    """Pixels `uv` of a ball that show the ground, and their brightness, for one photo."""

    photo: LinearPhoto
    uv: np.ndarray
    rays: list[np.ndarray]
    value: np.ndarray
    blurred: dict[float, np.ndarray]

    def shown(self, x: np.ndarray, blur: float) -> np.ndarray:
        """(n,): how bright the photo itself shows the ground that a ball (x, y, z, radius) would mirror there."""
        eye, total = np.array(self.photo.camera.eye), np.zeros(len(self.uv))
        for d in self.rays if blur == 0 else self.rays[4:5]:
            at = on_board(*_reflected(eye, d, x[:3], x[3])[:2])
            at = np.c_[at, np.zeros(len(at))]
            to = at - eye
            t = np.clip((to @ (x[:3] - eye)) / (to * to).sum(axis=1), 0, 1)
            hidden = np.linalg.norm(eye + t[:, None] * to - x[:3], axis=1) < 1.02 * x[3]
            behind = to @ np.array(self.photo.camera.R_cam_board)[2] < 0.02
            light = sample(self.blurred[blur], self.photo.project(np.where(np.isfinite(at), at, 0)))
            light[hidden | behind | ~np.isfinite(at[:, 0])] = np.nan
            total += light
        return total / (len(self.rays) if blur == 0 else 1)


def register(photos: list[LinearPhoto], ball: Ball, start: tuple[np.ndarray, float]) -> Ball:
    """The ball in which the ground's mirror image is the ground that the photos show; as it was where it shows little.

    `start`: as the user gave it, which with its uncertainty decides what the image does not. Tags look alike, so that
    many places are tried on blurred photos first, and the best of them are refined.
    """
    origin, sd = np.array([*start[0], start[1]]), start[1] * np.array((0.15, 0.15, 0.15, 0.015))
    offsets = np.array(list(itertools.product((-1 / 3, 0, 1 / 3), repeat=2)))
    images = [np.minimum(photo.light @ REC_709.astype(np.float32), 1.3) for photo in photos]
    blurred = [{b: cv2.GaussianBlur(i, (0, 0), b) if b else i for b in (*BLURS, 0.0)} for i in images]

    def below(x: np.ndarray) -> list[_Below]:
        found = []
        for photo, image, levels in zip(photos, images, blurred, strict=True):
            uv = pixels_of(photo, Ball(x[:3], x[3], sd, 0.0))
            p, out, _ = reflect(photo, x[:3], x[3], uv)
            near = np.linalg.norm(on_board(p, out) - x[:2], axis=1) < 12 * x[3]
            uv = uv[near][:: max(1, near.sum() // 1500)]
            found.append(_Below(photo, uv, [photo.rays(uv + o) for o in offsets], image[uv[:, 1], uv[:, 0]], levels))
        return [b for b in found if len(b.uv) > 50]

    def error(x: np.ndarray, seen: list[_Below], blur: float) -> np.ndarray:
        rows = []
        for one in seen:
            shown = one.shown(x, blur)
            good = np.isfinite(shown)
            off = np.full(len(one.uv), 0.3)  # a place out of sight explains nothing
            if good.sum() > 50:
                a, b = np.polyfit(shown[good], one.value[good], 1)
                off[good] = a * shown[good] + b - one.value[good] if a > 0 else 0.3
            rows.append(off / 0.05 / np.sqrt(10))
        return np.concatenate([*rows, (x - origin) / sd])

    rng, found = np.random.default_rng(0), np.array([*ball.center, ball.radius])
    if not below(found) or not below(origin):
        return ball

    def refined(first: np.ndarray, spread: np.ndarray, tried: int, blurs: tuple[float, ...]) -> list[Any]:
        """The fits from the best of some places about `first`, the best fit first."""
        seen = below(first)
        places = first + np.concatenate([np.zeros((1, 4)), rng.standard_normal((tried, 4)) * spread])
        costs = [(np.sqrt(1 + error(x, seen, blurs[0]) ** 2) - 1).sum() for x in places]
        fits = []
        for x in places[np.argsort(costs)[:REFINED]]:
            for blur in blurs:
                fit = least_squares(
                    error, x, args=(below(x), blur), loss="soft_l1", x_scale=sd, diff_step=1e-4, max_nfev=8
                )
                x = fit.x
            fits.append(fit)
        return sorted(fits, key=lambda f: f.cost / len(f.fun))

    wide = start[1] * np.array((0.1, 0.1, 0.08, 0.02))
    fits = [refined(x, wide, TRIED, BLURS)[0] for x in (found, origin)]
    best = min(fits, key=lambda f: f.cost / len(f.fun))
    for k in (0.4, 0.2, 0.1, 0.05):  # a false match is near the true one: the tags repeat
        best = refined(best.x, k * wide, TRIED, BLURS[1:])[0]
    best = least_squares(
        error, best.x, args=(below(best.x), 0.0), loss="soft_l1", x_scale=sd, diff_step=1e-4, max_nfev=8
    )
    sigma = np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)))
    return Ball(best.x[:3], float(best.x[3]), sigma, ball.edges, ball.given)


def reflectance_of(photos: list[LinearPhoto], ball: Ball, sheet: Sheet) -> np.ndarray | None:
    """(3): what the mirror shows of white paper over what the photo shows of it; None where none is seen."""
    ratios = []
    for photo in photos:
        uv = pixels_of(photo, ball)
        p, out, cosine = reflect(photo, ball.center, ball.radius, uv)
        at = on_board(p, out)
        direct = photo.at(photo.project(np.c_[at, np.zeros(len(at))]))
        white = (cosine > 0.3) & (direct @ REC_709 > 0.1)
        for offset in itertools.product((-1.2, 0, 1.2), repeat=2):
            p, out, _ = reflect(photo, ball.center, ball.radius, uv + np.array(offset))
            white &= sheet.at(on_board(p, out), 1e-3) > 0.97
        ratio = photo.at(uv.astype(np.float32)) / direct
        ratios.append(ratio[white & np.isfinite(ratio).all(axis=1)])
    both = np.concatenate(ratios)
    return np.median(both, axis=0) if len(both) >= 40 else None


def mirrored(photo: LinearPhoto, ball: Ball, reflectance: np.ndarray) -> Mirrored:
    """All that the ball shows in this photo; `sun` marks its largest small clipped patch, if there is one."""
    uv = pixels_of(photo, ball)
    _, out, _ = reflect(photo, ball.center, ball.radius, uv)
    right, down = (reflect(photo, ball.center, ball.radius, uv + np.array(s))[1] for s in ((0.1, 0), (0, 0.1)))
    steradians = np.linalg.norm(np.cross(right - out, down - out), axis=1) * 100
    u, v = uv.T
    clipped = photo.clipped[v, u]
    middle = ball.center - np.array(photo.camera.eye)
    cosine = -out @ middle / np.linalg.norm(middle)
    patch = _sun_patch(uv, out, clipped, steradians, photo.clipped.shape)
    return Mirrored(uv, out, photo.light[v, u] / reflectance, steradians, clipped, patch, cosine)


def _sun_patch(
    uv: np.ndarray, out: np.ndarray, clipped: np.ndarray, steradians: np.ndarray, shape: tuple[int, ...]
) -> np.ndarray:
    """(n,) bool: the clipped patch of most pixels among those that come from above and fill a small angle."""
    image = np.zeros(shape, bool)
    image[uv[clipped, 1], uv[clipped, 0]] = True
    labels, count = ndimage.label(image, np.ones((3, 3)))
    mine = labels[uv[:, 1], uv[:, 0]]
    best = np.zeros(len(uv), bool)
    for k in range(1, count + 1):
        patch = mine == k
        axis = out[patch].mean(axis=0)
        wide = 2 * np.degrees(np.arccos(np.clip((out[patch] @ axis / np.linalg.norm(axis)).min(), -1, 1)))
        spot = SUN_PX * np.degrees(np.sqrt(np.median(steradians[patch])))
        if axis[2] > 0 and wide <= max(SUN_DEGREES, spot) and patch.sum() > best.sum():
            best = patch
    return best


def sun_direction(photo: LinearPhoto, ball: Ball, seen: Mirrored) -> tuple[np.ndarray, float] | None:
    """The direction of the middle of the sun's patch, and its standard deviation in radians; None without one.

    The middle of the spot in the photo, weighed by how far its pixels are above their surroundings: a spot that is
    clipped is as wide as it is bright, and round.
    """
    if not seen.sun.any():
        return None
    near = seen.uv[seen.sun]
    low, high = near.min(axis=0) - 3, near.max(axis=0) + 3
    u, v = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    value = photo.light[v.clip(0, photo.camera.height - 1), u.clip(0, photo.camera.width - 1)] @ REC_709
    weight = np.clip(value - np.median(value), 0, 0.8 * value.max())
    middle = np.array([(weight * a).sum() / weight.sum() for a in (u, v)])
    at = middle + np.array([(0, 0), (1, 0), (0, 1)])
    _, out, _ = reflect(photo, ball.center, ball.radius, at)
    per_pixel = np.sqrt(np.linalg.norm(np.cross(out[1] - out[0], out[2] - out[0])))
    # The spot's middle is known to a tenth of its width; then what the ball's own place adds.
    spot = per_pixel * 0.1 * np.sqrt(seen.sun.sum())
    moved = []
    for k in range(4):
        x = np.array([*ball.center, ball.radius])
        x[k] += ball.sigma[k]
        moved.append(np.linalg.norm(reflect(photo, x[:3], x[3], at[:1])[1][0] - out[0]))
    return out[0] / np.linalg.norm(out[0]), float(np.hypot(spot, np.linalg.norm(moved) / np.sqrt(2)))


def bilinear(directions: np.ndarray, rows: int) -> sparse.csr_matrix:
    """(n, 2 rows²): the weights of a map's texels in its radiance along directions (n, 3), as `Environment` has it."""
    w, (x, y, z) = 2 * rows, directions.T
    across = (0.5 + np.arctan2(x, y) / (2 * np.pi)) * w - 0.5
    down = np.clip(np.arctan2(np.hypot(x, y), z) / np.pi * rows - 0.5, 0, rows - 1)
    i, j = np.floor(across).astype(int), np.minimum(np.floor(down).astype(int), rows - 2)
    a, b = across - i, down - j
    n = np.arange(len(directions))
    parts = [
        sparse.csr_matrix((wa * wb, (n, (j + dj) * w + (i + di) % w)), (len(n), rows * w))
        for di, wa in ((0, 1 - a), (1, a)) for dj, wb in ((0, 1 - b), (1, b))
    ]  # fmt: skip
    return sum(parts[1:], parts[0])


def fit_map(seen: list[Mirrored], rows: int, use: list[np.ndarray] | None = None) -> np.ndarray:
    """(rows, 2 rows, 3): the map whose radiance is nearest to what all pixels of `use` show, weighed by steradian.

    A second pass gives little weight to what the first leaves far off: the photographer, and whatever else is in one
    photo's way alone.
    """
    use = use or [~s.sun for s in seen]
    d, value, weight = (
        np.concatenate([getattr(s, k)[u] for s, u in zip(seen, use, strict=True)])
        for k in ("to_light", "radiance", "steradians")
    )
    A = bilinear(d, rows)
    w, n = 2 * rows, 2 * rows * rows
    index = np.arange(n).reshape(rows, w)
    pairs = np.concatenate([
        np.stack([index.ravel(), np.roll(index, -1, axis=1).ravel()], axis=1),
        np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1),
    ])  # fmt: skip
    k = np.arange(len(pairs))
    D = sparse.csr_matrix((np.r_[np.ones(len(k)), -np.ones(len(k))], (np.r_[k, k], pairs.T.ravel())), (len(k), n))
    smooth = SMOOTH * 2 * np.pi**2 / (w * rows) * (D.T @ D)
    trust = np.ones(len(d))
    for _ in range(3 if len(seen) > 1 else 1):
        W = sparse.diags(weight * trust)
        M = (A.T @ W @ A + smooth + 1e-12 * sparse.eye(n)).tocsc()
        texels = spsolve(M, A.T @ (W @ value))
        off = np.linalg.norm(A @ texels - value, axis=1)
        trust = 1 / (1 + (off / max(3 * np.median(off), 1e-6)) ** 2)
    return np.maximum(texels.reshape(rows, w, 3), 0).astype(np.float32)
