"""An upright of known height on the board: its shadow's tip tells where the sun is, and how dark the shadow is, how
much of the light is the sun's.

White paper in full light has radiance a (E l.z / π + V Ls), in the shadow a V' Ls, with V and V' the shares of the sky
that are left to it (Madsen and Nielsen, "Towards probe-less augmented reality", 2008). A thin upright of width w and
height h takes from the paper at distance d

    w / (2 π d) · h² / (d² + h²)

of the sky: the integral of z d / (π (d² + z²)²) over its height.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from raytwin.calib.lighting.linear_photo import LinearPhoto
from raytwin.calib.lighting.mirror_ball import Sheet
from raytwin.errors import InputError
from raytwin.lights.envmap_tables import REC_709

PLACE_SD, HEIGHT_SD = 5e-4, 5e-4
"""Metres by which `--stand` is off: half a millimetre on a ruler."""

STEP = 4e-4
"""Metres between the places at which the paper is looked at."""

LOWEST = 8.0
"""Degrees above the board from which a sun's shadow is looked for."""

EDGE_PX = 1.2
"""Pixels from a tag's edge within which paper is not taken for plain."""

SECTOR = 0.8
"""Cosine of the angle to either side of the streak within which its paper is fitted."""

SEEN = 0.06
"""How much darker than full light the shadow must be, and how much the upright must differ from the paper behind."""


@dataclass(frozen=True, eq=False)
class Shadow:
    """`to_light` (3) and `sigma` (2): standard deviations, radians, along the azimuth and the height of the sun;
    `ratio` (3): the paper in the shadow over the paper beside it, with `ratio_sd` (3) and the sky's share `left`; `xy`
    (n, 2), `cover` (n,): white places of the paper, and how much of the shadow lies there."""

    to_light: np.ndarray
    sigma: np.ndarray
    ratio: np.ndarray
    ratio_sd: np.ndarray
    left: float
    tip: np.ndarray
    foot: np.ndarray
    xy: np.ndarray
    cover: np.ndarray


def find_shadow(photos: list[LinearPhoto], sheet: Sheet, stand: tuple[float, float, float]) -> Shadow | None:
    """The shadow of the upright (x, y of its foot, height) on the sheet; None where none is seen."""
    foot, height = np.array(stand[:2]), stand[2]
    xy, value, weight = _paper_around(photos, sheet, foot, height)
    if len(xy) < 200:
        raise InputError("--stand", "an upright on the board's sheet, with white paper around it", f"{stand}")
    bright = value @ REC_709
    polar = xy - foot
    far, turn = np.hypot(*polar.T), np.arctan2(polar[:, 1], polar[:, 0])
    best = _coarse(far, turn, bright, height)
    if best is None:
        return None
    length, azimuth = best
    local = (far < 1.8 * length + 0.3 * height) & (np.cos(turn - azimuth) > SECTOR)
    rel, shade, weight = polar[local], value[local], weight[local, None]
    white = weight[:, 0] == 1

    def covered(x: np.ndarray) -> np.ndarray:
        """How much of the upright's shadow lies at each place: a capsule from the foot to the tip, its edge blurred."""
        tip = x[1] * np.array([np.cos(x[0]), np.sin(x[0])])
        t = np.clip(rel @ tip / (tip @ tip), 0, 1)
        off = np.linalg.norm(rel - t[:, None] * tip, axis=1)
        return 1 / (1 + np.exp(np.clip((off - x[2] / 2) / max(x[3], 1e-5), -50, 50)))

    def solved(m: np.ndarray) -> np.ndarray:
        """Full light and shadow (2, 3), and a slope of the light over the sheet: linear given the cover."""
        return np.linalg.lstsq(weight * np.c_[1 - m, m, rel / height], weight * shade, rcond=None)[0]

    def error(x: np.ndarray) -> np.ndarray:
        m = covered(x)
        return (weight * (np.c_[1 - m, m, rel / height] @ solved(m) - shade) / 0.02).ravel()

    start = np.array([azimuth, length, 0.05 * height, STEP])
    bounds = ([azimuth - 0.5, 0.3 * length, STEP, STEP / 4], [azimuth + 0.5, 2.5 * length, 0.5 * height, 0.1 * height])
    # Where a tag's edges leave a gap the fit has no slope: several lengths are begun with.
    fits = [
        least_squares(error, [azimuth, k * length, *start[2:]], loss="soft_l1", bounds=bounds,
                      x_scale=[0.01, 0.01 * length, STEP, STEP])
        for k in (0.7, 0.9, 1.1, 1.3, 1.6)
    ]  # fmt: skip
    found = min(fits, key=lambda f: f.cost)
    x, m = found.x, covered(found.x)
    levels = solved(m)
    ratio = levels[1] / levels[0]
    if ratio @ REC_709 > 1 - SEEN:
        return None
    left = error(x).std() * 0.02
    # Neighbours err together: as many independent places as the shadow has widths.
    share = np.sqrt(max(1.0, x[2] / STEP))
    cov = np.linalg.pinv(found.jac.T @ found.jac) * (left / 0.02) ** 2 * share**2
    tip = x[1] * np.array([np.cos(x[0]), np.sin(x[0])])
    to_light = np.array([*-tip, height]) / np.hypot(x[1], height)
    place = PLACE_SD / x[1]
    up = np.hypot(*(np.array([np.sqrt(cov[1, 1]) + 1e-12, PLACE_SD]))), HEIGHT_SD * x[1] / height
    squared = x[1] ** 2 + height**2
    sigma = np.array([np.hypot(np.sqrt(cov[0, 0]), place), height * np.hypot(*up) / squared])
    inside = (m > 0.9).sum()
    ratio_sd = np.full(3, 0.01) + left / np.sqrt(max(inside / share**2, 1))
    d = x[1] * np.linspace(0.15, 0.95, 9)
    hidden = (x[2] / (2 * np.pi * d) * height**2 / (d**2 + height**2)).mean()
    return Shadow(to_light, sigma, ratio, ratio_sd, 1 - hidden, foot + tip, foot, xy[local][white], m[white])


def _behind(photo: LinearPhoto, xy: np.ndarray, foot: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """How far places of the paper (n, 2) are from what the upright hides in this photo, metres, and how high up it is
    seen nearest to them, 0 to 1."""
    eye = np.array(photo.camera.eye)
    along = (foot - eye[:2]) * height / (eye[2] - height)  # to where the eye sees the top, on the board
    t = np.clip((xy - foot) @ along / (along @ along), 0, 1)
    return np.linalg.norm(xy - foot - t[:, None] * along, axis=1), t


def light_at_places(photos: list[LinearPhoto], shadow: Shadow, height: float) -> np.ndarray:
    """(p, n, 3): the light of the shadow's places in each photo; NaN where the upright hides them."""
    layers = []
    for photo in photos:
        light = photo.at(photo.project(np.c_[shadow.xy, np.zeros(len(shadow.xy))]))
        light[_behind(photo, shadow.xy, shadow.foot, height)[0] < 0.08 * height] = np.nan
        layers.append(light)
    return np.stack(layers)


def _paper_around(
    photos: list[LinearPhoto], sheet: Sheet, foot: np.ndarray, height: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of the sheet (n, 2) within reach of a shadow and off the tags' edges; the light that white paper would
    send back there (n, 3), the median over the photos; how much each counts (n,), ink less than paper.

    What the upright itself hides in a photo is left out there.
    """
    reach = height / np.tan(np.radians(LOWEST))
    x0, x1, y0, y1 = sheet.extent
    xs = np.arange(max(x0, foot[0] - reach), min(x1, foot[0] + reach), STEP)
    ys = np.arange(max(y0, foot[1] - reach), min(y1, foot[1] + reach), STEP)
    xy = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    finest = min(
        float(np.linalg.norm(np.array(p.camera.eye) - (*foot, 0)) / p.camera.fx) for p in photos
    )  # metres per pixel
    xy = xy[sheet.plain_at(xy, min(EDGE_PX * finest, 1.5e-3))]
    if not len(xy):
        return xy, np.empty((0, 3)), np.empty(0)
    layers, differs = [], []
    for photo in photos:
        light = photo.at(photo.project(np.c_[xy, np.zeros(len(xy))]))
        off, t = _behind(photo, xy, foot, height)
        behind = (off < 0.08 * height) & np.isfinite(light[:, 0])
        on_it = behind & (off < 0.02 * height + STEP) & (t > 0.4)
        if on_it.sum() > 5:
            differs.append(np.abs(light[on_it] @ REC_709 - np.nanmedian(light @ REC_709)).mean())
        light[behind] = np.nan
        layers.append(light)
    if differs and max(differs) < SEEN:
        raise InputError(
            f"--stand {foot[0]:g},{foot[1]:g},{height:g}", "an upright that stands there, to be seen in the photos",
            "white paper where its top must be: it does not stand upright, or not there",
        )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of places that no photo shows
        value = np.nanmedian(np.stack(layers), axis=0)
    good = np.isfinite(value).all(axis=1)
    xy, value, white = xy[good], value[good], sheet.at(xy[good]) > 0.5
    # How black the ink is, these photos say.
    ink = np.median(value[~white], axis=0) / np.median(value[white], axis=0) if (~white).sum() > 50 else np.ones(3)
    albedo = np.where(white[:, None], 1.0, ink)
    return xy, value / albedo, np.sqrt(albedo @ REC_709)


def _coarse(far: np.ndarray, turn: np.ndarray, bright: np.ndarray, height: float) -> tuple[float, float] | None:
    """(length, azimuth) of the darkest streak that begins at the foot; None where none is dark enough."""
    lit = float(np.median(bright[bright > np.median(bright)]))
    dark = np.clip((lit - bright) / lit, 0, 1)
    bins, step = 360, 0.04 * height
    k = ((turn / (2 * np.pi) % 1) * bins).astype(int) % bins
    rings = int(far.max() / step) + 1
    r = np.minimum((far / step).astype(int), rings - 1)
    near = far > 0.1 * height
    total, count = np.zeros((bins, rings)), np.zeros((bins, rings))
    np.add.at(total, (k[near], r[near]), dark[near])
    np.add.at(count, (k[near], r[near]), 1)
    # A streak is some millimetres wide, an angle that shrinks outwards: neighbours are added up over two widths.
    best, found = 0.0, None
    level = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
    for i in range(bins):
        profile = level[i]
        known = np.flatnonzero(np.isfinite(profile))
        if len(known) < 3:
            continue
        values = profile[known]
        top = np.quantile(values[: max(3, len(values) // 4)], 0.7)
        if top < SEEN:
            continue
        gain = np.cumsum(values - top / 2)
        end = int(gain.argmax())
        if gain[end] > best:
            best, found = float(gain[end]), ((known[end] + 1) * step, (i + 0.5) * 2 * np.pi / bins)
    return found
