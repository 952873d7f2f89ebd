"""An upright of known height on the board: its shadow's tip tells where the sun is, and how dark the shadow is, how
much of the light is the sun's.

White paper in full light has radiance a (E l.z / π + V Ls), in the shadow a V' Ls, with V and V' the shares of the sky
that are left to it (Madsen and Nielsen, "Towards probe-less augmented reality", 2008). A thin upright of width w and
height h takes from the paper at distance d

    w / (2 π d) · h² / (d² + h²)

of the sky: the integral of z d / (π (d² + z²)²) over its height.

An error of half a millimetre in its foot or height turns the sun by a degree. But the photos show both: the fit
is to the picture of the upright and its shadow, two bars that begin at the foot, one to the tip and one to where
the eye sees the top in front of the sheet. Their positions enter nonlinearly, all brightnesses linearly.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import expit

from raytwin.errors import InputError
from raytwin.photos.boards.board import INK, PAPER
from raytwin.photos.lighting.board_plane import Sheet, on_board, seen_light
from raytwin.photos.lighting.linear_photo import LinearPhoto
from raytwin.tracer.lights.envmap_tables import REC_709

PLACE_SD, HEIGHT_SD = 5e-4, 5e-4
"""Metres by which `--stand` is off: half a millimetre on a ruler."""

STEP = 8e-4
"""Metres between the places at which the shadow is looked for."""

LOWEST_SUN_DEGREES = 8.0
"""Degrees above the board from which a sun's shadow is looked for."""

NOISE, EDGE_NOISE = 0.02, 0.15
"""How far a pixel is off, as a share of white paper: on plain paper or ink, and on an edge between them."""

ASIDE = 12
"""Degrees to either side of a streak that must be brighter."""

MAX_RESIDUAL = 0.35
"""Root mean squared residual within a shadow over its contrast: what a bar describes worse is not the upright's."""

END_DEGREES = 0.15
"""Standard deviation of the sun's direction due to the shape of the upright's end, in degrees per angle."""

CORRELATED_PIXELS = 12.0
"""Pixels that err together: edges of the sheet, of a bar that is not quite one."""

MOST_PIXELS = 1500
"""Pixels of a photo that are fitted."""

WIDEST_UPRIGHT = 0.25
"""Width over height of the widest upright: the shadow of a dice is no bar, and ends at a corner."""

LONGER = 1.2
"""A shadow so much longer than the streak is fitted again, with the pixels about all of it."""

SEEN = 0.06
"""How much darker than full light the shadow must be, and how much the upright must differ from the paper behind."""


@dataclass(frozen=True, eq=False)
class Shadow:
    """What the photos show about the upright: `value` (n, 3) is the light of pixels of white paper, and `cover` (n,)
    how much of the shadow lies there.

    `to_light` (3), `sigma` radians across; `left`: the sky's share that is left to the shadow.
    """

    value: np.ndarray
    cover: np.ndarray
    to_light: np.ndarray
    sigma: float
    left: float
    foot: np.ndarray
    tip: np.ndarray
    height: float
    width: float

    @property
    def levels(self) -> tuple[np.ndarray, np.ndarray]:
        """The paper in the shadow over the paper beside it (3), and the standard deviation of that."""
        A = np.stack([1 - self.cover, self.cover], axis=1)
        x = np.linalg.lstsq(A, self.value, rcond=None)[0]
        left = (A @ x - self.value) / x[0]
        dark = max(self.cover.sum() / CORRELATED_PIXELS, 1.0)
        return x[1] / x[0], 0.01 + left.std(axis=0) / np.sqrt(dark)


def find_shadow(
    photos: list[LinearPhoto],
    sheet: Sheet,
    stand: tuple[float, float, float],
    streak: tuple[float, float] | None = None,
) -> Shadow | None:
    """The shadow of the upright (x, y of its foot, height) on the sheet; None where none is seen.

    `streak`: about where it ends, less the foot, where that is known already.
    """
    foot, height = np.array(stand[:2]), stand[2]
    streak = streak or _darkest_streak(photos, sheet, foot, height)
    tip = np.array(streak or (0.0, 0.0))
    parts = [_pixels_about(photo, k, sheet, foot, tip, height) for k, photo in enumerate(photos)]
    photo, xy, value, white, size, noise = (np.concatenate(column) for column in zip(*parts, strict=True))
    eyes = np.array([p.camera.eye for p in photos])[photo]
    bright, mine = value @ REC_709, photo == np.arange(len(photos))[:, None]
    prior = np.array([*foot, height, *tip, 0.05 * height, 0.3])
    sd = np.array([PLACE_SD, PLACE_SD, HEIGHT_SD, 0.5 * height, 0.5 * height, 0.05 * height, 0.2])

    def bars(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How much of the shadow and of the upright lies on each pixel; x: foot, height, tip less foot, width, blur."""
        rel, top = xy - x[:2], _top(eyes, x[:2], x[2])
        upright = _bar(rel, top, x[5], x[6] * size)
        shadow = _bar(rel, x[3:5], x[5], x[6] * size) if streak else 0 * upright
        return shadow, upright

    def solved(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Brightness of paper and ink, lit and in the shadow, and of the upright in each photo; what that leaves."""
        shadow, upright = bars(x)
        lit, dark = (1 - upright) * (1 - shadow), (1 - upright) * shadow
        A = np.stack([white * lit, (1 - white) * lit, white * dark, (1 - white) * dark, *(upright * mine)], axis=1)
        normal = (A.T / noise**2) @ A + 1e-6 * np.eye(A.shape[1])
        found = np.linalg.solve(normal, (A.T / noise**2) @ bright)
        return found, A @ found - bright

    def error(x: np.ndarray) -> np.ndarray:
        return np.concatenate([solved(x)[1] / noise / np.sqrt(CORRELATED_PIXELS), (x - prior) / sd])

    low, high = prior - 6 * sd, prior + 6 * sd
    low[5:], high[5:] = (1e-4, 0.1), (0.5 * height, 2.0)
    # A streak's end is known roughly: several lengths are begun with.
    starts = [prior * np.where(np.isin(np.arange(7), (3, 4)), k, 1) for k in ((0.9, 1.1) if streak else (1.0,))]
    fits = [least_squares(error, x, loss="soft_l1", bounds=(low, high), x_scale=0.1 * sd, max_nfev=60) for x in starts]
    fit = min(fits, key=lambda f: f.cost)
    x, (cover, upright) = fit.x, bars(fit.x)
    if streak and np.hypot(*x[3:5]) > LONGER * np.hypot(*streak):  # the pixels end before the shadow does
        return find_shadow(photos, sheet, stand, (x[3], x[4]))
    levels, left = solved(x)
    if np.abs(levels[4:] / levels[0] - 1).max() < SEEN:
        raise InputError(
            f"--stand {foot[0]:g},{foot[1]:g},{height:g}", "an upright that stands there, to be seen in the photos",
            "white paper where its top must be: it does not stand upright, or not there",
        )  # fmt: skip
    inside, contrast = (cover > 0.5) & (noise == NOISE), levels[0] - levels[2]
    if streak is None or contrast < SEEN * levels[0] or not inside.any():
        return None
    if np.sqrt((left[inside] ** 2).mean()) > MAX_RESIDUAL * contrast:
        return None  # what is dark there is no bar: another thing's shadow
    cov = np.linalg.inv(fit.jac.T @ fit.jac)
    rays = np.stack([_to_light(x + d) for d in np.linalg.cholesky(cov).T])
    sigma = float(np.hypot(np.linalg.norm(rays - _to_light(x)) / np.sqrt(2), np.radians(END_DEGREES)))
    length = np.hypot(*x[3:5])
    d = length * np.linspace(0.15, 0.95, 9)
    hidden = (x[5] / (2 * np.pi * d) * x[2] ** 2 / (d**2 + x[2] ** 2)).mean()
    paper = (white > 0.9) & (upright < 0.01) & (noise == NOISE)
    return Shadow(
        value[paper], cover[paper],
        _to_light(x), sigma, 1 - hidden, x[:2], x[:2] + x[3:5], x[2], x[5],
    )  # fmt: skip


def _to_light(x: np.ndarray) -> np.ndarray:
    d = np.array([-x[3], -x[4], x[2]])
    return d / np.linalg.norm(d)


def _top(eye: np.ndarray, foot: np.ndarray, height: float) -> np.ndarray:
    """Where eyes (..., 3) see the upright's top before the sheet, less the foot (..., 2)."""
    return (foot - eye[..., :2]) * (height / (eye[..., 2:] - height))


def _bar(rel: np.ndarray, end: np.ndarray, width: float, blur: np.ndarray) -> np.ndarray:
    """How much of a bar from 0 to `end` lies at places `rel` (n, 2), its edge blurred."""
    off = _distance(rel, end)
    return expit((width / 2 - off) / blur) - expit((-width / 2 - off) / blur)


def _pixels_about(
    photo: LinearPhoto, k: int, sheet: Sheet, foot: np.ndarray, tip: np.ndarray, height: float
) -> tuple[np.ndarray, ...]:
    """Pixels on the sheet near the upright or its shadow: photo, place on the board, light, share of white,
    size of a pixel in metres, and noise."""
    eye = np.array(photo.camera.eye)
    top = _top(eye, foot, height)
    ends = np.array([foot, foot + 1.25 * tip, foot + 1.05 * top])
    near = np.concatenate([ends + 0.3 * height * np.array(s) for s in ((1, 1), (1, -1), (-1, 1), (-1, -1))])
    box = photo.project(np.c_[near, np.zeros(len(near))])
    size = np.array(photo.camera.image_size)
    low, high = np.clip(np.floor(box.min(axis=0)), 0, size - 1), np.clip(np.ceil(box.max(axis=0)), 0, size - 1)
    u, v = np.meshgrid(*(np.arange(a, b + 1, dtype=int) for a, b in zip(low, high, strict=True)))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    xy = on_board(np.broadcast_to(eye, (len(uv), 3)), photo.rays(uv))
    distance = np.linalg.norm(eye - (*foot, 0))
    pixel = float(distance / photo.camera.fx / np.sqrt(eye[2] / distance))
    close = np.min([_distance(xy - foot, e - foot) for e in ends[1:]], axis=0) < 0.3 * height
    albedo = sheet.at(xy, 0.4 * pixel)
    good = close & np.isfinite(albedo) & ~photo.clipped[uv[:, 1], uv[:, 0]]
    keep = np.flatnonzero(good)
    keep = keep[:: max(1, len(keep) // MOST_PIXELS)]
    uv, xy, albedo = uv[keep], xy[keep], albedo[keep]
    white = (albedo - INK / PAPER) / (1 - INK / PAPER)
    noise = np.where(sheet.plain_at(xy, 1.2 * pixel), NOISE, EDGE_NOISE)
    light = photo.light[uv[:, 1], uv[:, 0]].astype(float)
    return np.full(len(uv), k), xy, light, white, np.full(len(uv), pixel), noise


def _distance(rel: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n,): how far places `rel` (n, 2) are from the line from 0 to `end`, (2) or one for each."""
    t = np.clip((rel * end).sum(axis=-1) / np.maximum((end * end).sum(axis=-1), 1e-12), 0, 1)
    return np.linalg.norm(rel - t[:, None] * end, axis=-1)


def _darkest_streak(
    photos: list[LinearPhoto], sheet: Sheet, foot: np.ndarray, height: float
) -> tuple[float, float] | None:
    """The end, less the foot, of the darkest streak that begins at the foot; None where none is."""
    turns = np.arange(360) * 2 * np.pi / 360
    far = np.arange(0.12 * height, height / np.tan(np.radians(LOWEST_SUN_DEGREES)), STEP)
    rel = (far[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)[:, None]).reshape(-1, 2)
    xy = foot + rel

    def behind(photo: LinearPhoto) -> np.ndarray:
        return _distance(rel, _top(np.array(photo.camera.eye), foot, height)) < 0.06 * height

    light, seen = seen_light(photos, np.c_[xy, np.zeros(len(xy))], behind)
    light = light @ REC_709
    albedo = np.nan_to_num(sheet.at(xy))
    plain = sheet.plain_at(xy, 6e-4) & seen
    if (plain & (albedo > 0.9)).sum() < 200:
        raise InputError(
            "--stand", "an upright on the board's sheet, with white paper around it that is not clipped",
            f"{foot[0]:g},{foot[1]:g},{height:g}",
        )  # fmt: skip
    dark = np.full(len(xy), np.nan)
    for mine in (plain & (albedo > 0.9), plain & (albedo < 0.2)):  # a shadow shows on ink, too
        if mine.any():
            dark[mine] = 1 - light[mine] / np.quantile(light[mine], 0.75)
    by_turn = dark.reshape(len(turns), len(far))
    # A ball's shadow is broad: a streak is darker than what lies to either side.
    by_turn = by_turn - np.fmax(0, np.fmin(np.roll(by_turn, ASIDE, axis=0), np.roll(by_turn, -ASIDE, axis=0)))
    best, end = 0.0, None
    for turn, profile in zip(turns, by_turn, strict=True):
        known = np.flatnonzero(np.isfinite(profile))
        if len(known) < 8:
            continue
        values = profile[known]
        top = np.quantile(values[: max(5, len(values) // 4)], 0.8)
        gain = np.cumsum(np.minimum(values, top) - top / 2)
        if top > SEEN and gain.max() > best:
            best = float(gain.max())
            length = far[known[int(gain.argmax())]]
            end = (float(length * np.cos(turn)), float(length * np.sin(turn)))
    return end
