"""A mirror ball is a photo of everything around it (Debevec, "Rendering Synthetic Objects into Real Scenes", 1998).

A pixel's ray d meets the ball where its normal is n, and goes on along ω = d - 2 (d·n) n: the pixel shows the light
from there, times the ball's reflectance. The board itself is in the mirror, and where it must be is known to a fraction
of a pixel: that is what the ball's place and radius are refined by, and its reflectance found by.

A map is what `scene.Environment` says, bilinear between texels' centres, so that its texels are a linear least squares
problem: each pixel weighs as many steradians as it shows, and neighbours are drawn together where no pixel looks.
Clipped pixels that fill a small angle are the sun: they are taken out.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import ndimage, sparse
from scipy.optimize import differential_evolution, least_squares
from scipy.sparse.linalg import spsolve

from raytwin.calib.lighting.ball_outline import RADIUS_SD, Ball, mean_score, outline, softened
from raytwin.calib.lighting.board_plane import Sheet, SheetLight, blurred, on_board
from raytwin.calib.lighting.linear_photo import LinearPhoto
from raytwin.lights.envmap_tables import REC_709

GRAZING = 0.2
"""The least cosine between ray and normal: nearer to the outline a pixel shows too much at once."""

FINEST = 0.008
"""Metres of the sheet that a mirrored pixel may cover: cells that are smaller than a pixel match anywhere."""

SEARCH_M, SEARCH_RADIUS = 2.2e-3, 2.5 * RADIUS_SD
"""How far from its outline's best place a ball is sought: metres, and share of the radius."""

OUTLINE_PX = 0.7
"""Pixels by which an outline is off its faint edge; each photo's tells this four times over."""

UNDERSTATED = 2.0
"""How much larger the errors of a registered ball are than least squares says, in measure/light_accuracy.py."""

TOLERANCE, TOGETHER = 0.05, 40
"""By how much of white paper's light a mirrored place may be off; neighbouring pixels that err together."""

LEAST_PIXELS = 50
"""Pixels that must show the sheet for a ball to be registered by it."""

SUN_DEGREES = 12.0
"""A clipped patch that fills no wider angle than this is a light of its own."""

SUN_PX = 8.0
"""Or is no wider than this: so far a lens spreads a point that is a thousand times too bright."""

SPOT_PX = 0.06
"""Pixels by which the middle of the sun's spot is off, however small it is."""

SMOOTH = 1e-3
"""Weight of the difference of neighbouring texels, as a share of a texel's own: it decides where no pixel looks."""


@dataclass(frozen=True, eq=False)
class Mirrored:
    """What a mirror ball's pixels `uv` (n, 2) in the photos of index `photo` (n,) show: `to_light` (n, 3), `radiance`
    (n, 3), `steradians` (n,), `clipped` (n,): at least so bright, `sun` (n,): those of the sun's patch."""

    photo: np.ndarray
    uv: np.ndarray
    to_light: np.ndarray
    radiance: np.ndarray
    steradians: np.ndarray
    clipped: np.ndarray
    sun: np.ndarray


def reflect(photo: LinearPhoto, ball: Ball, uv: np.ndarray) -> tuple[np.ndarray, ...]:
    """(n, 3) points, (n, 3) reflected directions, (n,) cosine of ray and normal, NaN where the ball is missed."""
    return reflect_rays(np.array(photo.camera.eye), photo.rays(uv), ball.numbers)


def reflect_rays(eye: np.ndarray, d: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, ...]:
    """The same of rays `d` from `eye`; `x`: the ball's center and radius (4)."""
    f = eye - x[:3]
    b = d @ f
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - (f @ f - x[3] ** 2))
    n = (f + (-b - root)[:, None] * d) / x[3]
    cosine = root / x[3]
    return x[:3] + x[3] * n, d + 2 * cosine[:, None] * n, cosine


def pixels_of(photo: LinearPhoto, ball: Ball) -> np.ndarray:
    """(n, 2): the pixels that show the ball, its rim left out."""
    rim = outline(photo, ball.center, ball.radius)
    low, high = np.floor(rim.min(axis=0)).astype(int), np.ceil(rim.max(axis=0)).astype(int)
    uv = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True))), axis=-1).reshape(-1, 2)
    return uv[np.nan_to_num(reflect(photo, ball, uv)[2]) > GRAZING]


@dataclass(frozen=True, eq=False)
class _SheetPixels:
    """Pixels of a ball that show the sheet in one photo: the `rays` through each, and their brightness."""

    eye: np.ndarray
    rays: list[np.ndarray]
    value: np.ndarray


def _sheet_pixels(
    photo: LinearPhoto, light: SheetLight, ball: Ball, *, blur: float, count: int, subsamples: int
) -> _SheetPixels:
    """Some `count` of them; the photo is blurred by `blur` pixels first."""
    uv, eye = pixels_of(photo, ball), np.array(photo.camera.eye)
    at = [on_board(*reflect(photo, ball, uv + np.array(step))[:2]) for step in ((0, 0), (0.5, 0), (0, 0.5))]
    covered = 2 * np.nan_to_num(np.hypot(*(at[1] - at[0]).T) + np.hypot(*(at[2] - at[0]).T), nan=1.0)
    uv = uv[light.known(at[0]) & (covered < 1.3 * FINEST)]
    uv = uv[:: max(1, len(uv) // count)]
    steps = (np.arange(subsamples) + 0.5) / subsamples - 0.5
    rays = [photo.rays(uv + np.array(step)) for step in itertools.product(steps, repeat=2)]
    value = blurred(np.minimum(photo.light @ REC_709.astype(np.float32), 1.3), blur)[uv[:, 1], uv[:, 0]]
    return _SheetPixels(eye, rays, value)


def _off_sheet(seen: list[_SheetPixels], light: SheetLight, image: np.ndarray, x: np.ndarray) -> np.ndarray:
    """How far the mirrored sheet is off what the photos show of it, but for a factor and an offset per photo."""
    rows = []
    for one in seen:
        places = [on_board(*reflect_rays(one.eye, d, x)[:2]) for d in one.rays]
        shown = np.mean([light.look(image, at) for at in places], axis=0)
        good = np.isfinite(np.sum(places, axis=(0, 2)))
        off = np.full(len(shown), 6 * TOLERANCE)  # a ray that misses the sheet explains nothing
        if good.sum() >= LEAST_PIXELS:
            A = np.stack([shown[good], np.ones(good.sum())], axis=1)
            fit = np.linalg.lstsq(A, one.value[good], rcond=None)[0]
            off[good] = A @ fit - one.value[good] if fit[0] > 0 else 6 * TOLERANCE
        rows.append(off / TOLERANCE / np.sqrt(TOGETHER))
    return np.concatenate(rows)


def register(photos: list[LinearPhoto], ball: Ball, sheet: Sheet) -> Ball:
    """The ball in which the sheet's mirror image is the sheet that the photos show; as it was where it shows little.

    Tags look alike and a mirror's outline is faint: the best of many places is taken by both, then refined.
    """
    light = SheetLight(photos, sheet, ball)
    seen = [_sheet_pixels(p, light, ball, blur=1.0, count=500, subsamples=1) for p in photos]
    seen = [s for s in seen if len(s.value) >= LEAST_PIXELS]
    if not seen:
        return ball
    codes = [softened(photo) for photo in photos]
    image = light.blurred(2e-3)

    def cost(x: np.ndarray) -> float:
        sheet_off = 2 * (np.sqrt(1 + _off_sheet(seen, light, image, x) ** 2) - 1).mean()
        return 2 * sheet_off - mean_score(photos, codes, x) + 0.0125 * (((x - ball.prior) / ball.prior_sd) ** 2).sum()

    span = np.array([SEARCH_M] * 3 + [SEARCH_RADIUS * ball.radius])
    bounds = list(zip(ball.numbers - span, ball.numbers + span, strict=True))
    found = differential_evolution(
        cost, bounds, rng=1, popsize=8, maxiter=25, tol=1e-6, polish=False, init="sobol", x0=ball.numbers
    )
    ball = ball.moved(found.x)
    # Another radius with another place mirrors few tags much the same: the outline, known to a pixel, decides between.
    rims = [(p, outline(p, ball.center, ball.radius)) for p in photos]

    def error(x: np.ndarray, off: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        moved = [np.ravel(outline(p, x[:3], x[3]) - rim) / OUTLINE_PX / np.sqrt(len(rim) / 4) for p, rim in rims]
        return np.concatenate([off(x), *moved, (x - ball.prior) / ball.prior_sd])

    end = ball
    for blur, sigma in ((1.5, 3e-3), (0.0, 5e-4)):
        seen = [_sheet_pixels(p, light, end, blur=blur, count=1500, subsamples=3) for p in photos]
        off = partial(_off_sheet, [s for s in seen if len(s.value) >= LEAST_PIXELS], light, light.blurred(sigma))
        fit = least_squares(
            error, end.numbers, args=(off,), loss="soft_l1", x_scale=ball.prior_sd, diff_step=1e-3, max_nfev=30
        )
        end = end.moved(fit.x, UNDERSTATED * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac))))
    return end


def reflectance_of(photos: list[LinearPhoto], ball: Ball, sheet: Sheet) -> np.ndarray | None:
    """(3): what the mirror shows of white paper over what the photo shows of it; None where none is seen."""
    ratios = []
    for photo in photos:
        uv = pixels_of(photo, ball)
        p, out, _ = reflect(photo, ball, uv)
        at = on_board(p, out)
        direct = photo.at(photo.project(np.c_[at, np.zeros(len(at))]))
        white = direct @ REC_709 > 0.1
        for offset in itertools.product((-1.2, 0, 1.2), repeat=2):
            white &= sheet.at(on_board(*reflect(photo, ball, uv + np.array(offset))[:2]), 1e-3) > 0.97
        ratio = photo.at(uv.astype(np.float32)) / direct
        ratios.append(ratio[white & np.isfinite(ratio).all(axis=1)])
    both = np.concatenate(ratios)
    return np.median(both, axis=0) if len(both) >= 40 else None


def mirrored(photos: list[LinearPhoto], ball: Ball, reflectance: np.ndarray) -> Mirrored:
    """All that the ball shows; `sun` marks each photo's largest small clipped patch, if there is one."""
    parts = []
    for k, photo in enumerate(photos):
        uv = pixels_of(photo, ball)
        out, right, down = (reflect(photo, ball, uv + np.array(s))[1] for s in ((0, 0), (0.1, 0), (0, 0.1)))
        steradians = np.linalg.norm(np.cross(right - out, down - out), axis=1) * 100
        clipped = photo.clipped[uv[:, 1], uv[:, 0]]
        sun = _sun_patch(uv, out, clipped, steradians, photo.clipped.shape)
        radiance = photo.light[uv[:, 1], uv[:, 0]] / reflectance
        parts.append((np.full(len(uv), k), uv, out, radiance, steradians, clipped, sun))
    return Mirrored(*(np.concatenate(column) for column in zip(*parts, strict=True)))


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


def sun_direction(photo: LinearPhoto, ball: Ball, near: np.ndarray, steradians: float) -> tuple[np.ndarray, float]:
    """The direction of the middle of the sun's patch, pixels `near` (n, 2), and its standard deviation in radians.

    The middle of the spot in the photo, weighed by how far its pixels are above their surroundings: a spot that is
    clipped is as wide as it is bright, and round. `steradians`: per pixel there.
    """
    low, high = near.min(axis=0) - 3, near.max(axis=0) + 3
    u, v = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    value = photo.light[v.clip(0, photo.camera.height - 1), u.clip(0, photo.camera.width - 1)] @ REC_709
    weight = np.clip(value - np.median(value), 0, 0.8 * value.max())
    at = np.array([[(weight * a).sum() / weight.sum() for a in (u, v)]])
    out = reflect(photo, ball, at)[1][0]
    # The spot's middle is known to a part of its width; then what the ball's own place adds, in all four numbers.
    spot = np.sqrt(steradians) * (SPOT_PX + 0.015 * np.sqrt(len(near)))
    moved = [
        np.linalg.norm(reflect(photo, ball.moved(ball.numbers + step), at)[1][0] - out) for step in np.diag(ball.sigma)
    ]
    return out / np.linalg.norm(out), float(np.hypot(spot, np.linalg.norm(moved) / np.sqrt(2)))


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


def fit_map(seen: list[Mirrored], rows: int) -> np.ndarray:
    """(rows, 2 rows, 3): the map whose radiance is nearest to what all pixels show, weighed by steradian.

    Of several photos further passes give little weight to what the first leaves far off: the photographer, and whatever
    else is in one photo's way alone.
    """
    d, value, weight = (
        np.concatenate([getattr(s, name)[~s.sun] for s in seen]) for name in ("to_light", "radiance", "steradians")
    )
    A, w = bilinear(d, rows), 2 * rows
    # The sum of squared differences of neighbours: its matrix is a ring's Laplacian across, and a line's down.
    across = sparse.diags([2.0, -1, -1, -1, -1], [0, 1, -1, w - 1, 1 - w], shape=(w, w))
    down = sparse.diags([np.r_[1, 2 * np.ones(rows - 2), 1], -1, -1], [0, 1, -1], shape=(rows, rows))
    smooth = SMOOTH * 2 * np.pi**2 / (w * rows) * sparse.kronsum(across, down)
    trust = np.ones(len(d))
    for _ in range(3 if len(np.unique(np.concatenate([s.photo for s in seen]))) > 1 else 1):
        weighed = A.T @ sparse.diags(weight * trust)
        texels = spsolve((weighed @ A + smooth + 1e-12 * sparse.eye(w * rows)).tocsc(), weighed @ value)
        off = np.linalg.norm(A @ texels - value, axis=1)
        trust = 1 / (1 + (off / max(3 * np.median(off), 1e-6)) ** 2)
    return np.maximum(texels.reshape(rows, w, 3), 0).astype(np.float32)
