"""A mirror ball is a photo of everything around it (Debevec, "Rendering Synthetic Objects into Real Scenes", 1998).

A pixel's ray d meets the ball where its normal is n, and goes on along ω = d - 2 (d·n) n: the pixel shows the light
from there, times the ball's reflectance. The board itself is in the mirror, and where it must be is known to a fraction
of a pixel; the sun is in the same direction in all photos. These and the outline tell the ball's place and radius: of
all balls within reach of the guess that of the greatest likelihood is taken (differential evolution), then all of them
are fitted at once, the sun's direction with the ball.

A map is bilinear between texels' centres (`scene.Environment`), so fitting its texels is a linear least squares
problem: each pixel is weighted by its solid angle, and smoothness fills the texels that no pixel shows. The
sun is a clipped patch with a sharp edge (around a clipped lamp the light fades out); its pixels are excluded.
"""

import itertools
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import ndimage, sparse
from scipy.optimize import differential_evolution, least_squares
from scipy.sparse.linalg import spsolve

from raytwin.calib.lighting.ball_outline import (
    Ball,
    check_seen,
    outline,
    outline_score,
    pixels_about,
    pixels_of,
    prior_of,
    reflect,
    reflect_rays,
    softened,
)  # fmt: skip
from raytwin.calib.lighting.board_plane import MARGIN, Sheet, SheetLight, blurred, on_board
from raytwin.calib.lighting.linear_photo import LinearPhoto
from raytwin.errors import InputError
from raytwin.lights.envmap_tables import REC_709

FINEST = 0.008
"""Metres of the sheet that a mirrored pixel may cover: cells that are smaller than a pixel match anywhere."""

REACH = 2.5
"""A ball is searched for within this many standard deviations of its given place and radius."""

GROUND_SD = 0.1
"""Standard deviation, in radii, of the ground's height under a ball that was found automatically."""

OUTLINE_WEIGHT = 60.0
"""Log-likelihood of an outline that is all edge over one that is none."""

EDGE_SHARE = 0.7
"""The least score of an outline that is taken for a ball's."""

GLANCE, GLANCE_SD = 4, 0.2
"""The search uses every fourth pixel each way; standard deviation of one from the mirrored sheet, as share of white."""

SEEN = 2.0
"""Log-likelihood by which the mirrored sheet must explain a ball better than anything even."""

REFLECTANCES = 0.3, 1.1
"""Least and greatest reflectance of a mirror."""

SPOT_SEARCH_PX, SPOT_FALSE = 0.5, 0.02
"""Standard deviation between two photos' sun directions in the search, in pixels; probability of a false spot."""

OUTLINE_PX = 0.7
"""Standard deviation of an outline from its faint edge, pixels; a photo's whole outline counts as four such places."""

SPOT_PX = 0.12
"""Pixels by which the middle of the sun's spot is off, across and down."""

TOLERANCE, CORRELATED_PIXELS = 0.05, 80
"""Standard deviation of mirrored paper, as a share of white paper's light; neighbouring pixels that err alike."""

ERROR_FACTOR = 1.3
"""How much larger the errors are than least squares says, in measure/light_accuracy.py."""

LEAST_PIXELS = 50
"""Pixels that must show the sheet for a ball to be registered by it."""

SPOT_LEAST, SPOT_MOST, SPOT_SHARE = 4, 50, 0.004
"""The sun's spot has so many clipped pixels at least and at most, or fills this share of the ball's box: 12 degrees."""

SPOT_AROUND, SPOT_EDGE = 4, 0.75
"""This many pixels outside the sun's spot the light must have fallen below this share of the spot's."""

SMOOTH = 1e-3
"""Weight of differences between neighbouring texels, relative to a texel's own; it fills texels that no pixel shows."""


@dataclass(frozen=True, eq=False)
class Mirrored:
    """What a mirror ball's pixels `uv` (n, 2) in the photos of index `photo` (n,) show: `to_light` (n, 3), `radiance`
    (n, 3), `steradians` (n,), `clipped` (n,): at least so bright, `sun` (n,): those of the sun's spot."""

    photo: np.ndarray
    uv: np.ndarray
    to_light: np.ndarray
    radiance: np.ndarray
    steradians: np.ndarray
    clipped: np.ndarray
    sun: np.ndarray


def sun_spot(photo: LinearPhoto, ball: Ball) -> tuple[np.ndarray, float] | None:
    """The middle (2) and the radius, in pixels, of the largest clipped patch on the ball that has a sharp edge.

    The middle is that of its brightest part, so that a lamp beside the sun does not shift it.
    """
    uv = pixels_about(photo, ball)
    if len(uv) == 0:
        return None
    low, high = uv.min(axis=0), uv.max(axis=0)
    window = slice(low[1], high[1] + 1), slice(low[0], high[0] + 1)
    value, labels = photo.light[window].min(axis=-1), ndimage.label(photo.clipped[window], np.ones((3, 3)))[0]
    found, most = None, SPOT_LEAST - 1
    for k, box in enumerate(ndimage.find_objects(labels), 1):
        ends = zip(box, labels.shape, strict=True)
        near = tuple(slice(max(0, b.start - SPOT_AROUND), min(b.stop + SPOT_AROUND, end)) for b, end in ends)
        patch = labels[near] == k
        ring = np.logical_xor(*(ndimage.binary_dilation(patch, iterations=SPOT_AROUND - i) for i in (0, 1)))
        around, top = np.quantile(value[near][ring], 0.9) if ring.any() else np.inf, np.median(value[near][patch])
        too_large = patch.sum() > max(SPOT_MOST, SPOT_SHARE * labels.size)
        if patch.sum() <= most or too_large or around > SPOT_EDGE * top:
            continue
        weight = np.clip((value[near] - around - 0.3 * (top - around)) / (0.63 * (top - around)), 0, 1)
        weight = weight * ndimage.binary_dilation(patch, iterations=SPOT_AROUND - 1)
        middle = np.array([(weight * axis).sum() / weight.sum() for axis in np.mgrid[near][::-1]])
        if np.isnan(reflect(photo, ball, (middle + low)[None])[2][0]):
            continue  # in the box about the ball, but beside it
        found, most = (middle + low, float(np.sqrt(patch.sum() / np.pi))), patch.sum()
    return found


@dataclass(frozen=True, eq=False)
class _SearchPixels:
    """What the search sees of one photo: the `rays` (n, 3) through some pixels, those `beside` them, brightness `value`
    (n,), the photo's `codes`, and the rays through the sun's spot, right of it and below."""

    photo: LinearPhoto
    eye: np.ndarray
    rays: np.ndarray
    beside: np.ndarray
    value: np.ndarray
    codes: np.ndarray
    spot: np.ndarray | None


def _glance(photo: LinearPhoto, ball: Ball) -> _SearchPixels:
    uv, spot = pixels_about(photo, ball, 1.25, GLANCE), sun_spot(photo, ball)
    steps = np.array([(0, 0), (1, 0), (0, 1)])
    return _SearchPixels(
        photo, np.array(photo.camera.eye), photo.rays(uv), photo.rays(uv + 0.5), brightness(photo, 1.0, uv),
        softened(photo), photo.rays(spot[0] + steps) if spot else None,
    )  # fmt: skip


def brightness(photo: LinearPhoto, blur: float, uv: np.ndarray) -> np.ndarray:
    """Return (n,): luminance at pixels, clipped first, so that the sun equals its glare, then blurred by `blur`."""
    return blurred(np.minimum(photo.light @ REC_709.astype(np.float32), 1.3), blur)[uv[:, 1], uv[:, 0]]


def _sheet_explains(seen: _SearchPixels, light: SheetLight, image: np.ndarray, x: np.ndarray) -> float:
    """By how much the sum of squares is less where the ball `x` mirrors the sheet, its best reflectance taken."""
    b = seen.rays @ (seen.eye - x[:3])
    inside = np.flatnonzero(b * b > ((seen.eye - x[:3]) ** 2).sum() - 0.96 * x[3] ** 2)
    at = on_board(*reflect_rays(seen.eye, seen.rays[inside], x)[:2])
    x0, x1, y0, y1 = light.extent
    on = (at[:, 0] > x0 + MARGIN) & (at[:, 0] < x1 - MARGIN) & (at[:, 1] > y0 + MARGIN) & (at[:, 1] < y1 - MARGIN)
    inside, at = inside[on], at[on]
    covered = np.linalg.norm(on_board(*reflect_rays(seen.eye, seen.beside[inside], x)[:2]) - at, axis=1)
    fine = covered < FINEST / np.sqrt(2)
    if GLANCE**2 * fine.sum() < 6 * LEAST_PIXELS:
        return 0.0
    shown, value = light.look(image, at[fine]), seen.value[inside[fine]]
    shown, value = shown - shown.mean(), value - value.mean()
    size, along = max(shown @ shown, 1e-9), shown @ value
    rho = np.clip(along / size, *REFLECTANCES)
    return float(2 * rho * along - rho * rho * size)


def _suns_apart(seen: list[_SearchPixels], x: np.ndarray) -> float:
    """Pixels by which the sun's directions in the photos differ, in the mean of all pairs; 0 where there is no pair."""
    suns = [reflect_rays(s.eye, s.spot, x)[1] for s in seen if s.spot is not None]
    pixel = [np.sqrt(np.linalg.norm(np.cross(d[1] - d[0], d[2] - d[0]))) for d in suns]
    pairs = itertools.combinations(range(len(suns)), 2)
    apart = [np.linalg.norm(suns[i][0] - suns[j][0]) / np.hypot(pixel[i], pixel[j]) for i, j in pairs]
    return float(np.nan_to_num(np.mean(apart), nan=99.0)) if apart else 0.0


def find_ball(
    photos: list[LinearPhoto], sheet: Sheet, center: np.ndarray, radius: float, given: bool = True
) -> tuple[Ball, float]:
    """The ball near (center, radius), matt or mirror, that is the likeliest in all photos at once, to a pixel or so;
    and its log-likelihood.

    `given`: by the user; else it was found by itself, and is known less well. Raises InputError where none is seen.
    """
    ball = prior_of(center, radius, given)
    where = f"ball {','.join(f'{x:.4g}' for x in ball.prior)}"
    for photo in photos:
        check_seen(photo, ball)
    light = SheetLight(photos, sheet, ball)
    image, seen = light.blurred(2e-3), [_glance(photo, ball) for photo in photos]

    def unlikely(x: np.ndarray) -> float:
        z = (x - ball.prior) / ball.prior_sd
        z = z if given else np.append(z, (x[2] - x[3]) / (GROUND_SD * x[3]))
        sheet_part = sum(_sheet_explains(s, light, image, x) for s in seen) / (2 * GLANCE_SD**2)
        edge = OUTLINE_WEIGHT * np.mean([outline_score(s.photo, s.codes, x) for s in seen])
        sun = 4 * np.log(SPOT_FALSE + np.exp(-0.5 * (_suns_apart(seen, x) / SPOT_SEARCH_PX) ** 2))
        return float(0.5 * (z @ z) - max(sheet_part, 0) - edge - sun)

    low, high = ball.prior - REACH * ball.prior_sd, ball.prior + REACH * ball.prior_sd
    found = differential_evolution(
        unlikely, list(zip(low, high, strict=True)), rng=0, popsize=8, maxiter=30, tol=1e-5, polish=False, init="sobol"
    )
    ball = ball.moved(found.x)
    for s in seen:
        check_seen(s.photo, ball)
        if (score := outline_score(s.photo, s.codes, ball.numbers)) < EDGE_SHARE:
            expected = "a ball whose outline is seen there"
            raise InputError(f"{s.photo.name}: {where}", expected, f"edges along {100 * score:.0f} % of it")
    return ball, -float(found.fun)


@dataclass(frozen=True, eq=False)
class _SheetPixels:
    """Pixels of a ball that show the sheet in one photo: the `rays` through each, and their brightness."""

    eye: np.ndarray
    rays: list[np.ndarray]
    value: np.ndarray


def _sheet_pixels(photo: LinearPhoto, light: SheetLight, ball: Ball, blur: float) -> _SheetPixels:
    """Some 1500 of them; the photo is blurred by `blur` pixels first."""
    uv, eye = pixels_of(photo, ball), np.array(photo.camera.eye)
    at = [on_board(*reflect(photo, ball, uv + np.array(step))[:2]) for step in ((0, 0), (0.5, 0), (0, 0.5))]
    covered = 2 * np.nan_to_num(np.hypot(*(at[1] - at[0]).T) + np.hypot(*(at[2] - at[0]).T), nan=1.0)
    uv = uv[light.known(at[0]) & (covered < 1.3 * FINEST)]
    uv = uv[:: max(1, len(uv) // 1500)]
    rays = [photo.rays(uv + np.array(step)) for step in itertools.product((-1 / 3, 0, 1 / 3), repeat=2)]
    return _SheetPixels(eye, rays, brightness(photo, blur, uv))


def _off_sheet(seen: _SheetPixels, light: SheetLight, image: np.ndarray, x: np.ndarray) -> np.ndarray:
    """How far the mirrored sheet is off what the photos show of it, but for a factor and an offset."""
    places = [on_board(*reflect_rays(seen.eye, d, x)[:2]) for d in seen.rays]
    shown = np.mean([light.look(image, at) for at in places], axis=0)
    good = np.isfinite(np.sum(places, axis=(0, 2)))
    off = np.full(len(shown), 6 * TOLERANCE)  # a ray that misses the sheet explains nothing
    if good.sum() >= LEAST_PIXELS:
        A = np.stack([shown[good], np.ones(good.sum())], axis=1)
        fit = np.linalg.lstsq(A, seen.value[good], rcond=None)[0]
        off[good] = A @ fit - seen.value[good] if fit[0] > 0 else 6 * TOLERANCE
    return off / TOLERANCE / np.sqrt(CORRELATED_PIXELS)


def register(photos: list[LinearPhoto], ball: Ball, light: SheetLight) -> tuple[Ball, tuple[np.ndarray, float] | None]:
    """The ball and the sun's direction, with its standard deviation, that mirrored sheet, spots, outline and what was
    said of the ball agree on best; no sun where no photo shows one."""
    x, sun = ball.numbers, np.array([0.0, 0.0, 1.0])
    rims = [(p, outline(p, ball.center, ball.radius)) for p in photos]
    spots = [(p, s[0]) for p in photos if (s := sun_spot(p, ball))]
    if spots:
        sun = np.mean([reflect(p, ball, at[None])[1][0] for p, at in spots], axis=0)
        sun /= np.linalg.norm(sun)
    axes = np.linalg.svd(sun[None])[2][1:]

    def off_spot(photo: LinearPhoto, at: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Pixels between the spot and where the ball mirrors the sun."""
        rays = photo.rays(at + np.array([(0, 0), (0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5)]))
        d = reflect_rays(np.array(photo.camera.eye), rays, z[:4])[1]
        turn = np.stack([d[1] - d[2], d[3] - d[4]], axis=1)
        return np.linalg.pinv(turn) @ (d[0] - _unit(sun + z[4:] @ axes)) if np.isfinite(d).all() else np.full(2, 9.0)

    def error(z: np.ndarray, seen: list[_SheetPixels], image: np.ndarray) -> np.ndarray:
        rows = [(z[:4] - ball.prior) / ball.prior_sd, *(off_spot(p, at, z) / SPOT_PX for p, at in spots)]
        rows += [np.ravel(outline(p, z[:3], z[3]) - rim) / OUTLINE_PX / np.sqrt(len(rim) / 4) for p, rim in rims]
        return np.concatenate(rows + [_off_sheet(s, light, image, z[:4]) for s in seen] + ([] if spots else [z[4:]]))

    z = np.r_[x, 0, 0]
    for blur, sigma in ((1.5, 3e-3), (0.0, 5e-4)):
        seen = [_sheet_pixels(p, light, ball.moved(z[:4]), blur) for p in photos]
        off = partial(error, seen=[s for s in seen if len(s.value) >= LEAST_PIXELS], image=light.blurred(sigma))
        scale = np.r_[ball.prior_sd, 0.05, 0.05]
        fit = least_squares(off, z, loss="soft_l1", x_scale=scale, diff_step=1e-3, max_nfev=30)
        z = fit.x
    cov = ERROR_FACTOR**2 * np.linalg.inv(fit.jac.T @ fit.jac)
    found = ball.moved(z[:4], np.sqrt(np.diag(cov)[:4]))
    return found, (_unit(sun + z[4:] @ axes), float(np.sqrt(np.trace(cov[4:, 4:]) / 2))) if spots else None


def _unit(d: np.ndarray) -> np.ndarray:
    return d / np.linalg.norm(d)


def reflectance_of(photos: list[LinearPhoto], ball: Ball, sheet: Sheet) -> np.ndarray | None:
    """(3): what the mirror shows of the sheet, summed, over what the photos show of it; None where little is seen.

    Sums, since a mirrored cell may be smaller than a pixel.
    """
    light = SheetLight(photos, sheet, ball)
    mirror, direct = np.zeros(3), np.zeros(3)
    count = 0
    for photo in photos:
        uv = pixels_of(photo, ball)
        at = on_board(*reflect(photo, ball, uv)[:2])
        uv, at = uv[on := light.known(at)], at[on]
        there = photo.at(photo.project(np.c_[at, np.zeros(len(at))]))
        good = np.isfinite(there).all(axis=1) & ~photo.clipped[uv[:, 1], uv[:, 0]]
        mirror += photo.light[uv[good, 1], uv[good, 0]].sum(axis=0)
        direct += there[good].sum(axis=0)
        count += int(good.sum())
    return mirror / direct if count >= LEAST_PIXELS else None


def seen_in(photos: list[LinearPhoto], ball: Ball, light: SheetLight) -> tuple[bool, bool]:
    """Whether the sheet is seen in the ball, as in a mirror alone, and the sun, as in any that is glossy."""
    image, seen = light.blurred(2e-3), [_glance(photo, ball) for photo in photos]
    sheet_part = sum(_sheet_explains(s, light, image, ball.numbers) for s in seen) / (2 * GLANCE_SD**2)
    return sheet_part > SEEN, any(s.spot is not None for s in seen)


def mirrored(photos: list[LinearPhoto], ball: Ball, reflectance: np.ndarray) -> Mirrored:
    """All that the ball shows; `sun` marks each photo's spot, and the pixels about it that its glare lights."""
    parts = []
    for k, photo in enumerate(photos):
        uv, spot = pixels_of(photo, ball), sun_spot(photo, ball)
        out, right, down = (reflect(photo, ball, uv + np.array(s))[1] for s in ((0, 0), (0.1, 0), (0, 0.1)))
        steradians = np.linalg.norm(np.cross(right - out, down - out), axis=1) * 100
        clipped = photo.clipped[uv[:, 1], uv[:, 0]]
        sun = np.linalg.norm(uv - spot[0], axis=1) < spot[1] + SPOT_AROUND - 1 if spot else np.zeros(len(uv), bool)
        radiance = photo.light[uv[:, 1], uv[:, 0]] / reflectance
        parts.append((np.full(len(uv), k), uv, out, radiance, steradians, clipped, sun))
    return Mirrored(*(np.concatenate(column) for column in zip(*parts, strict=True)))


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
