"""An upright of known height on the board: its shadow's end tells where the sun is, and how dark the shadow is, how
much of the light is the sun's.

White paper in full light has radiance a (E l.z / π + V Ls), in the shadow a V' Ls, with V and V' the shares of the sky
that are left to it (Madsen and Nielsen, "Towards probe-less augmented reality", 2008). A thin upright of width w and
height h takes from the paper at distance d

    w / (2 π d) · h² / (d² + h²)

of the sky: the integral of z d / (π (d² + z²)²) over its height.

The shadow is the darkest streak that begins at the foot: a bar with blurred edges is fitted to how much darker each
place of plain paper or ink is than in full light. Its slope tells where the sun stands, wherever the foot was measured.
Its length tells how high: the top is half a width thick, and so is its shadow.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtr

from raytwin.errors import InputError
from raytwin.photos.boards.board import PAPER, Board, draw_board
from raytwin.photos.lighting.linear_photo import LinearPhoto, sample
from raytwin.tracer.lights.envmap_tables import REC_709

PLACE_SD = 5e-4
"""Metres by which each number of `--stand` is off: half a millimetre on a ruler."""

STEP, TURNS = 4e-4, 720
"""Metres between the places of a streak, and how many directions are looked along."""

LOWEST_SUN_DEGREES = 8.0
"""Degrees above the board from which a sun's shadow is looked for."""

ASIDE = TURNS // 30
"""Turns to either side of a streak, 12 degrees, that must be brighter."""

LEAST_WHITE = 1000
"""Places on white paper that must be seen around the upright."""

SEEN = 0.06
"""How much darker than full light the shadow must be."""

WIDEST_UPRIGHT = 0.25
"""Width over height of the widest upright: the shadow of a dice is no bar, and ends at a corner."""

END_DEGREES = 0.3
"""Standard deviation of the sun's direction due to the shape of the upright's end, in degrees per angle."""

NOISE = 0.2
"""Standard deviation of a place's darkness in the fit: 0.02, and a hundred places err together."""

CORRELATED_PLACES = 12.0
"""Places that err together."""

PER_METRE, PLAIN_METRES = 2000.0, 6e-4
"""Resolution of the drawn sheet; how far from an edge between ink and paper a place must be."""


@dataclass(frozen=True, eq=False)
class Shadow:
    """`dark` (3): light of the paper in the shadow over that beside it, `dark_sd` (3) its standard deviation.

    `to_light` (3), `sigma` radians across; `left`: the sky's share that is left to the shadow; `width` in metres.
    """

    dark: np.ndarray
    dark_sd: np.ndarray
    to_light: np.ndarray
    sigma: float
    left: float
    width: float


def find_shadow(photo: LinearPhoto, board: Board, stand: tuple[float, float, float]) -> Shadow | None:
    """The shadow of the upright (x, y of its foot, height) on the sheet; None where none is seen.

    Raises InputError where too little white paper is seen around the foot.
    """
    foot, height = np.array(stand[:2]), stand[2]
    turns = np.arange(TURNS) * 2 * np.pi / TURNS
    far = np.arange(0.12 * height, height / np.tan(np.radians(LOWEST_SUN_DEGREES)), STEP)
    light, dark, white = _around(photo, board, foot, height, turns, far)
    if white.sum() < LEAST_WHITE:
        raise InputError(
            "--stand", "an upright on the board's sheet, with white paper around it that is not clipped",
            f"{foot[0]:g},{foot[1]:g},{height:g}",
        )  # fmt: skip
    # A ball's shadow is broad: a streak is darker than what lies to either side.
    sides = np.fmin(np.roll(dark, ASIDE, axis=0), np.roll(dark, -ASIDE, axis=0))
    found = [_end(profile, far) for profile in dark - np.fmax(0, sides)]
    turn = int(np.argmax([gain for gain, *_ in found]))
    gain, length, top = found[turn]
    if gain == 0:
        return None
    near = np.arange(turn - 2 * ASIDE, turn + 2 * ASIDE + 1) % TURNS
    angle = (np.arange(len(near)) - 2 * ASIDE)[:, None] * 2 * np.pi / TURNS
    place = (far < 1.5 * length) & np.isfinite(dark[near])
    along, beside = ((far * f(angle))[place] for f in (np.cos, np.sin))
    pixel = float(np.linalg.norm(np.array(photo.camera.eye) - (*foot, 0)) / photo.camera.fx)

    def cover(x: np.ndarray) -> np.ndarray:
        """How much of the streak lies at each place: a bar whose edges fade."""
        length, slope, offset, width, blur = x
        across, to_end = np.abs(beside - offset - slope * along), along - length - width / 2  # that of its top
        bar = ndtr((width / 2 - across) / blur) - ndtr((-width / 2 - across) / blur)
        return bar * ndtr(-to_end / blur)

    def off(x: np.ndarray) -> np.ndarray:
        return np.concatenate([(x[5] * cover(x[:5]) - dark[near][place]) / NOISE, (x - start) / sd])

    start = np.array([length, 0, 0, 0.05 * height, 0.4 * pixel, top])
    sd = np.array([0.3 * length, 0.1, PLACE_SD, 0.05 * height, 0.1 * pixel, 0.3])
    low, high = start - 6 * sd, start + 6 * sd
    low[3:5] = 1e-4, 0.1 * pixel
    fit = least_squares(off, start, loss="soft_l1", bounds=(low, high), x_scale=sd)
    length, slope, _, width, _, top = fit.x
    direction = turns[turn] + np.arctan(slope)
    to_light = np.array([-length * np.cos(direction), -length * np.sin(direction), height])
    size = np.linalg.norm(to_light)
    paper = white[near][place]
    share, value = cover(fit.x[:5])[paper], light[near][place][paper]
    A = np.stack([1 - share, share], axis=1)
    lit, shaded = np.linalg.lstsq(A, value, rcond=None)[0]
    scatter = ((A @ [lit, shaded] - value) / lit).std(axis=0)
    d = length * np.linspace(0.3, 0.95, 9)
    hidden = float((width / (2 * np.pi * d) * height**2 / (d**2 + height**2)).mean())
    return Shadow(
        shaded / lit, 0.01 + scatter / np.sqrt(max(share.sum() / CORRELATED_PLACES, 1.0)), to_light / size,
        float(np.hypot(PLACE_SD / size, np.radians(END_DEGREES))), 1 - hidden, width,
    )  # fmt: skip


def _around(
    photo: LinearPhoto, board: Board, foot: np.ndarray, height: float, turns: np.ndarray, far: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(turns, far, 3), (turns, far), (turns, far): the light of places around the foot; how much darker they are than
    such paper or ink in full light, NaN where the upright, an edge of the print or clipping hides it; which are paper.
    """
    rel = (far[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)[:, None]).reshape(-1, 2)
    sheet, (x0, _, _, y1) = draw_board(board, PER_METRE)
    square = np.ones((1 + 2 * round(PLAIN_METRES * PER_METRE),) * 2, np.uint8)
    lowest, highest = (
        sample(f(sheet, square), ((foot + rel) * (1, -1) + (-x0, y1)) * PER_METRE - 0.5)
        for f in (cv2.erode, cv2.dilate)
    )
    pixels = photo.project(np.c_[foot + rel, np.zeros(len(rel))])
    light, clipped = sample(photo.light, pixels), sample(photo.clipped.astype(np.float32), pixels)
    # The eye sees the upright in front of the places from the foot to where its top is seen.
    eye = np.array(photo.camera.eye)
    top = (foot - eye[:2]) * (height / (eye[2] - height))
    t = np.clip(rel @ top / (top @ top), 0, 1)
    behind = np.linalg.norm(rel - t[:, None] * top, axis=1) < 0.06 * height
    seen = (clipped == 0) & ~behind
    white, luminance = seen & (lowest > 0.9 * PAPER), light @ REC_709
    dark = np.full(len(rel), np.nan)
    for mine in (white, seen & (highest < 0.2)):  # a shadow shows on ink, too
        if mine.any():
            dark[mine] = 1 - luminance[mine] / np.quantile(luminance[mine], 0.75)
    shape = len(turns), len(far)
    return light.reshape(*shape, 3), dark.reshape(shape), white.reshape(shape)


def _end(profile: np.ndarray, far: np.ndarray) -> tuple[float, float, float]:
    """Of darkness along a streak, at distances `far` (n,): by how much it is a shadow, where it ends, and how dark it
    is before; 0 thrice where it is none."""
    known = np.flatnonzero(np.isfinite(profile))
    if len(known) < 8:
        return 0.0, 0.0, 0.0
    values = profile[known]
    top = float(np.quantile(values[: max(5, len(values) // 4)], 0.8))
    gain = np.cumsum(np.minimum(values, top) - top / 2)
    last = int(gain.argmax())
    if top < SEEN or gain[last] <= 0:
        return 0.0, 0.0, 0.0
    return float(gain[last]), float(far[known[last : last + 2]].mean()), top
