"""An upright of known height on the board: the end of its shadow gives the sun's direction, and the shadow's darkness
gives the sun's share of the light.

White paper in full light has radiance a (E l.z/π + Ls), and a V Ls in the shadow of a thin upright. Of width w and
height h it leaves to the paper at distance d the share V = 1 - w / (2 π d) · h² / (d² + h²) of the sky: one minus the
integral of z d / (π (d² + z²)²) over its height.

The shadow is the darkest streak that begins at the foot. A bar with blurred edges is fitted to it, on plain paper and
on ink alike. The bar's slope gives the azimuth even where the foot was measured wrongly, and its length the elevation.
The top is as thick as the bar is wide, and its shadow ends half a width later.
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

FOOT_SD_METRES = 5e-4
"""Standard deviation of each number of `--stand`: half a millimetre on a ruler."""

END_SD_DEGREES = 0.3
"""Standard deviation of the sun's direction due to the shape of the upright's end."""

SKY_SHARE_SD = 0.02
"""Standard deviation of the sky's share of the light."""

STEP_METRES, DIRECTIONS = 4e-4, 720
"""Spacing of the places along a direction from the foot; number of directions."""

LOWEST_SUN_DEGREES, LONGEST_SHADOW_METRES = 8.0, 1.0
"""Lowest sun above the board, and the longest shadow, that is searched for."""

SIDE_DIRECTIONS = DIRECTIONS // 30
"""Directions (12 degrees) from a streak to either side of it, which must be brighter."""

LEAST_WHITE_PLACES = 1000
"""Least number of places on white paper around the upright."""

DARKNESS_NOISE = 0.2
"""Standard deviation of a place's darkness in the fit: 0.02, since a hundred neighbours err together."""

LEAST_DARKNESS = 0.06
"""Least share of the light that a shadow takes."""

MAX_WIDTH = 0.25
"""Largest width over height of an upright. The shadow of a dice is no bar, and ends at a corner."""

PIXELS_PER_METRE, EDGE_METRES = 2000.0, 6e-4
"""Resolution of the drawn sheet; places this near to an edge between ink and paper are left out."""


@dataclass(frozen=True, eq=False)
class Shadow:
    """`sky_share` (3): the sky's share of the paper's light; the sun's direction `to_light` (3), `sigma` (radians)."""

    sky_share: np.ndarray
    to_light: np.ndarray
    sigma: float


def find_shadow(photo: LinearPhoto, board: Board, stand: tuple[float, float, float]) -> Shadow:
    """Return the shadow of the upright (x, y of its foot, height).

    Raises InputError where it has none on the sheet, where it is thick, or where too little white paper is seen.
    """
    foot, height = np.array(stand[:2]), stand[2]
    if height >= LONGEST_SHADOW_METRES:
        raise InputError("--stand", f"an upright lower than {LONGEST_SHADOW_METRES:g} m", f"{height:g} m")
    turns = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    end = min(height / np.tan(np.radians(LOWEST_SUN_DEGREES)), LONGEST_SHADOW_METRES)
    far = np.arange(0.12 * height, end, STEP_METRES)
    light, dark, white = _around(photo, board, foot, height, turns, far)
    if white.sum() < LEAST_WHITE_PLACES:
        raise InputError(
            "--stand", "an upright on the board's sheet, with white paper around it that is not clipped",
            f"{foot[0]:g},{foot[1]:g},{height:g}",
        )  # fmt: skip
    # A ball's shadow is broad: a streak is darker than what lies to either side.
    sides = np.fmin(np.roll(dark, SIDE_DIRECTIONS, axis=0), np.roll(dark, -SIDE_DIRECTIONS, axis=0))
    streaks = dark - np.fmax(0, sides)
    streaks[np.isnan(streaks[:, far < 0.5 * height]).all(axis=1)] = 0
    top = np.nanquantile(streaks[:, far < 0.5 * height], 0.8, axis=1)[:, None]
    gain = np.nancumsum(np.minimum(streaks, top) - top / 2, axis=1) * (top > LEAST_DARKNESS)
    turn, last = np.unravel_index(gain.argmax(), gain.shape)
    got = f"no shadow of it on the sheet: no sun, or one below {LOWEST_SUN_DEGREES:g} degrees"
    no_shadow = InputError("--stand", "an upright that casts a shadow", got)
    if gain[turn, last] <= 0:
        raise no_shadow
    near = np.arange(turn - 2 * SIDE_DIRECTIONS, turn + 2 * SIDE_DIRECTIONS + 1) % DIRECTIONS
    place = (far < 1.5 * far[last]) & np.isfinite(dark[near])
    angle = turns[near][:, None] - turns[turn]
    along, beside = ((far * f(angle))[place] for f in (np.cos, np.sin))
    pixel = float(np.linalg.norm(np.array(photo.camera.eye) - (*foot, 0)) / photo.camera.fx)

    def cover(bar: np.ndarray) -> np.ndarray:
        """Return how much of a bar with blurred edges lies at each place."""
        length, slope, offset, width, blur, _ = bar
        across = np.abs(beside - offset - slope * along)
        wide = ndtr((width / 2 - across) / blur) - ndtr((-width / 2 - across) / blur)
        return wide * ndtr((length + width / 2 - along) / blur)

    def off(bar: np.ndarray) -> np.ndarray:
        return np.concatenate([(bar[5] * cover(bar) - dark[near][place]) / DARKNESS_NOISE, (bar - start) / sd])

    start = np.array([far[last], 0, 0, 0.05 * height, 0.4 * pixel, top[turn, 0]])
    sd = np.array([0.3 * far[last], 0.1, FOOT_SD_METRES, 0.05 * height, 0.1 * pixel, 0.3])
    low = np.array([0, -1, -0.1, 0.005 * height, 0.1 * pixel, 0])
    bar = least_squares(off, start, loss="soft_l1", bounds=(low, np.inf), x_scale=sd).x
    length, slope, _, width, _, _ = bar
    if width > MAX_WIDTH * height:
        raise InputError("--stand", f"an upright at most {MAX_WIDTH:g} of its height wide", f"{width / height:.2g}")
    azimuth = turns[turn] + np.arctan(slope)
    to_light = np.array([-length * np.cos(azimuth), -length * np.sin(azimuth), height])
    size, paper, share = np.linalg.norm(to_light), white[near][place], cover(bar)
    of_bar = np.stack([1 - share, share], axis=1)
    lit, shaded = np.linalg.lstsq(of_bar[paper], light[near][place][paper], rcond=None)[0]
    if (shaded > lit).any():
        raise no_shadow
    distance = 0.6 * length
    sky_left = 1 - width / (2 * np.pi * distance) * height**2 / (distance**2 + height**2)
    sigma = float(np.hypot(FOOT_SD_METRES / size, np.radians(END_SD_DEGREES)))
    return Shadow(shaded / lit / sky_left, to_light / size, sigma)


def _around(
    photo: LinearPhoto, board: Board, foot: np.ndarray, height: float, turns: np.ndarray, far: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return of places around the foot the light (turns, far, 3); how much darker they are than such paper or ink in
    full light (turns, far), NaN where the upright, an edge of the print or clipping hides it; and which are paper.
    """
    rel = (far[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)[:, None]).reshape(-1, 2)
    sheet, (x0, _, _, y1) = draw_board(board, PIXELS_PER_METRE)
    square = np.ones((1 + 2 * round(EDGE_METRES * PIXELS_PER_METRE),) * 2, np.uint8)
    lowest, highest = (
        sample(f(sheet, square), ((foot + rel) * (1, -1) + (-x0, y1)) * PIXELS_PER_METRE - 0.5)
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
