"""A mirror ball is a photo of everything around it (Debevec, "Rendering Synthetic Objects into Real Scenes", 1998).

From the eye e a sphere (c, r) is seen within a cone; it touches the sphere along a circle, of radius r q / d about
c - (r/d)² (c - e) with d = |c - e| and q = √(d² - r²). That circle, seen through the lens, is the ball's outline. A
pixel's ray d meets the ball where its normal is n, and goes on along ω = d - 2 (d·n) n: the pixel shows the light from
there, times the ball's reflectance.

The rim of a mirror shows what is behind it, a little darker, and edges inside are far stronger: an outline is scored by
how much of it is an edge at all. The board is in the mirror, too, and the photo shows what it looks like. Of all balls
near the given one that is taken which outline and mirrored board agree on best (differential evolution).
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage
from scipy.optimize import differential_evolution

from raytwin.errors import InputError
from raytwin.photos.boards.board import Board, draw_board
from raytwin.photos.lighting.linear_photo import BURNT, LinearPhoto, sample
from raytwin.tracer.lights.envmap_tables import REC_709

LEAST_PX = 24.0
"""Pixels that a ball must be wide."""

PLACE_SD, SEARCH_SIGMAS = 0.15, 2.5
"""Standard deviation of each given coordinate, in radii; the ball is searched for within so many of them."""

RADIUS_SD = 0.01
"""Standard deviation of the given radius, as a share of it."""

RIM_PLACES = 90
"""Places along an outline."""

FULL_EDGE_CODES = 4.0
"""Step across an outline, in 8-bit codes, that counts as a full edge; larger steps add little to the score."""

EDGE_SHARE = 0.7
"""The least score of an outline that is taken for a ball's."""

OUTLINE_WEIGHT = 60.0
"""Log-likelihood of an outline that is all edge over one that is none."""

PIXELS_ACROSS = 200
"""Pixels of the ball from side to side in which the mirrored board is looked for, at most."""

FINE, COARSE = 0.7, 3.0
"""The board's details in the mirror lie between these blurs, in such pixels: finer ones are noise, coarser shading."""

BOARD_BLUR = 2.0
"""Pixels by which the board is blurred where it is compared with its mirror image, in which it is smaller."""

CORRELATED = 8
"""Neighbouring pixels that err alike."""

SHEET_MARGIN = 0.004
"""Metres from the sheet's edge within which its light is not used."""

LEAST_MIRRORED, LEAST_CORRELATION, MAX_REFLECTANCE_RATIO = 50, 0.35, 1.3
"""A mirror shows the board in so many pixels at least, correlates with it so well, and its reflectances of red, green
and blue differ by this factor at most."""

EDGE_PX = 0.2
"""Pixels by which the outline is off, across and down."""

SPOT_LEAST, SPOT_AROUND, SPOT_EDGE = 4, 4, 0.75
"""The sun's spot has so many clipped pixels at least, and this many pixels outside it the light has fallen below this
share of the spot's: around a clipped lamp it fades out."""

SUN_PX, SUN_DEGREES = 8.0, 6.0
"""Longest extent of the sun's spot: glare spreads a point over so many pixels or degrees. A longer patch is a lamp."""

LOWEST_SUN_Z = 0.05
"""Least z of the sun's direction: a lower light does not light the board."""

GRAZING = 0.2
"""The least cosine between ray and normal: nearer to the outline a pixel shows too much at once."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere of the board's frame, metres; `sigma` (4): one standard deviation of x, y, z and radius."""

    center: np.ndarray
    radius: float
    sigma: np.ndarray

    @property
    def name(self) -> str:
        return f"ball {','.join(f'{x:.4g}' for x in (*self.center, self.radius))}"


def outline(photo: LinearPhoto, ball: Ball) -> np.ndarray:
    """(RIM_PLACES, 2): pixels of the ball's outline, in order."""
    away = ball.center - photo.camera.eye
    d = np.linalg.norm(away)
    r = min(ball.radius, float(0.999 * d))
    u, v = np.linalg.svd(away[None])[2][1:]
    turn = np.linspace(0, 2 * np.pi, RIM_PLACES, endpoint=False)[:, None]
    ring = r * math.sqrt(d * d - r * r) / d
    return photo.project(ball.center - (r / d) ** 2 * away + ring * (np.cos(turn) * u + np.sin(turn) * v))


def reflect(photo: LinearPhoto, ball: Ball, d: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of rays d (n, 3): points (n, 3), reflected directions (n, 3), cosine of ray and normal (n,); NaN where they miss
    the ball."""
    f = np.array(photo.camera.eye) - ball.center
    b = d @ f
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - (f @ f - ball.radius**2))
    n, cosine = (f + (-b - root)[:, None] * d) / ball.radius, root / ball.radius
    return ball.center + ball.radius * n, d + 2 * cosine[:, None] * n, cosine


def pixels_about(photo: LinearPhoto, ball: Ball, reach: float = 1.0, most: int = 1 << 30) -> np.ndarray:
    """(h, w, 2): pixels of the box about `reach` times the ball's outline, within the frame: all of them, or every nth,
    so that at most `most` lie across the ball."""
    rim = outline(photo, ball)
    middle, wide = rim.mean(axis=0), np.ptp(rim, axis=0)
    low = np.maximum(np.floor(middle - reach * wide / 2), 0).astype(int)
    high = np.minimum(np.ceil(middle + reach * wide / 2), np.array(photo.camera.image_size) - 1).astype(int)
    step = math.ceil(wide.max() / most)
    return np.stack(np.meshgrid(*(np.arange(a, b + 1, step) for a, b in zip(low, high, strict=True))), axis=-1)


def check_seen(photo: LinearPhoto, ball: Ball) -> None:
    """Raises InputError where the ball is not whole and large in the photo."""
    where = f"{photo.name}: {ball.name}"
    if ball.center[2] + ball.radius <= 0:
        raise InputError(where, "a ball on the printed side of the board, z > 0", f"z = {ball.center[2]:g}")
    cam = np.array(photo.camera.R_cam_board) @ ball.center + np.array(photo.camera.t_cam_board)
    if cam[2] <= ball.radius:
        raise InputError(where, "a ball in front of the camera", "one beside or behind it")
    rim = outline(photo, ball)
    if not ((rim >= 0) & (rim <= np.array(photo.camera.image_size) - 1)).all():
        raise InputError(where, "a ball that is whole in the photo", "one that the frame cuts")
    wide = 2 * math.sqrt(abs(cv2.contourArea(rim.astype(np.float32))) / math.pi)
    if wide < LEAST_PX:
        raise InputError(where, f"a ball at least {LEAST_PX:.0f} pixels wide", f"{wide:.0f} pixels")


class Search:
    """A photo in which a ball is searched for: how well the outline and the mirrored board fit a ball of any place."""

    def __init__(self, photo: LinearPhoto, board: Board, given: Ball) -> None:
        self.photo, (x0, x1, y0, y1) = photo, draw_board(board, 100.0)[1]
        self.middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        self.half = np.array([(x1 - x0) / 2, (y1 - y0) / 2]) - SHEET_MARGIN
        self.codes = cv2.GaussianBlur(photo.pixels, (0, 0), 0.7).astype(np.float32)
        luminance = photo.light @ REC_709.astype(np.float32)
        self.board = cv2.GaussianBlur(luminance, (0, 0), BOARD_BLUR)
        uv = pixels_about(photo, given, 1 + SEARCH_SIGMAS * PLACE_SD, PIXELS_ACROSS)
        self.rays, self.shape = photo.rays(uv.reshape(-1, 2)), uv.shape[:2]
        layers = np.dstack([photo.light, luminance, photo.clipped]).astype(np.float32)
        step = int(uv[0, 1, 0] - uv[0, 0, 0])
        self.seen = cv2.blur(layers, (step, step))[uv[..., 1], uv[..., 0]]

    def outline_score(self, ball: Ball) -> float:
        """How much of the outline is an edge: about 1 where all of it is."""
        rim = outline(self.photo, ball)
        along = np.roll(rim, -1, axis=0) - np.roll(rim, 1, axis=0)
        across = 1.5 * np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
        step = np.nan_to_num(np.abs(sample(self.codes, rim + across) - sample(self.codes, rim - across)).max(axis=1))
        return float(np.mean(np.minimum(step, FULL_EDGE_CODES) / FULL_EDGE_CODES + 0.05 * step / (step + 30)))

    def mirrored_board(self, ball: Ball) -> tuple[float, float, np.ndarray]:
        """How well the ball's pixels correlate with the board that they mirror, the log-likelihood of that over none,
        and their light over the luminance of what they mirror (3)."""
        points, out, cosine = reflect(self.photo, ball, self.rays)
        with np.errstate(invalid="ignore", divide="ignore"):
            down = (out[:, 2] < -0.02) & (cosine > GRAZING)
            at = points - (points[:, 2] / np.where(down, out[:, 2], np.nan))[:, None] * out
            on_sheet = (np.abs(at[:, :2] - self.middle) < self.half).all(axis=1)
        if on_sheet.sum() < LEAST_MIRRORED:
            return 0.0, 0.0, np.ones(3)
        direct = np.full(self.shape, np.nan)
        direct[on_sheet.reshape(self.shape)] = sample(self.board, self.photo.project(at[on_sheet]))
        good = np.isfinite(direct) & (self.seen[..., 4] == 0)
        a, b = (_detail(values, good) for values in (direct, self.seen[..., 3]))
        alike = max(float(a @ b / np.sqrt((a @ a) * (b @ b) + 1e-12)), 0.0)
        likelihood = -len(a) / (2 * CORRELATED) * math.log(max(1 - alike**2, 1e-6))
        return alike, likelihood, self.seen[good][:, :3].sum(axis=0) / max(direct[good].sum(), 1e-9)


def _detail(values: np.ndarray, good: np.ndarray) -> np.ndarray:
    """(n,): the `good` ones of values (h, w), without their finest noise and their shading."""
    layers = np.dstack([np.where(good, values, 0), good]).astype(np.float32)
    fine, coarse = (cv2.GaussianBlur(layers, (0, 0), sigma)[good] for sigma in (FINE, COARSE))
    return fine[:, 0] / np.maximum(fine[:, 1], 1e-6) - coarse[:, 0] / np.maximum(coarse[:, 1], 1e-6)


def find_ball(photo: LinearPhoto, board: Board, center: np.ndarray, radius: float) -> tuple[Ball, np.ndarray]:
    """The likeliest ball near the given one, and its reflectance (3).

    Raises InputError where none is seen, where it does not show the board, or not in grey.
    """
    given = Ball(center, radius, np.array([PLACE_SD] * 3 + [RADIUS_SD]) * radius)
    check_seen(photo, given)
    search, numbers = Search(photo, board, given), np.array([*center, radius])

    def unlikely(x: np.ndarray) -> float:
        ball, z = Ball(x[:3], x[3], given.sigma), (x - numbers) / given.sigma
        mirrored = search.mirrored_board(ball)[1]
        return float(0.5 * z @ z - OUTLINE_WEIGHT * search.outline_score(ball) - mirrored)

    low, high = numbers - SEARCH_SIGMAS * given.sigma, numbers + SEARCH_SIGMAS * given.sigma
    best = differential_evolution(
        unlikely, list(zip(low, high, strict=True)), rng=0, popsize=16, maxiter=40, tol=1e-5, polish=False, init="sobol"
    ).x
    away = best[:3] - photo.camera.eye
    sigma = np.hypot(EDGE_PX * np.linalg.norm(away) / photo.camera.fx, RADIUS_SD * away)
    ball = Ball(best[:3], float(best[3]), np.array([*sigma, RADIUS_SD * radius]))
    if (score := search.outline_score(ball)) < EDGE_SHARE:
        expected = "a ball whose outline is seen there"
        raise InputError(f"{photo.name}: {given.name}", expected, f"edges along {100 * score:.0f} % of it")
    alike, _, reflected = search.mirrored_board(ball)
    if alike < LEAST_CORRELATION:
        got = f"a ball that does not (correlation {alike:.2f}): it is no mirror, or not there"
        raise InputError(given.name, "a mirror ball that shows the board", got)
    reflectance = reflected / photo.paper_colour
    if reflectance.max() > MAX_REFLECTANCE_RATIO * reflectance.min() or not 0.2 < reflectance.mean() < 1.1:
        got = f"one that reflects {', '.join(f'{r:.2f}' for r in reflectance)} of red, green and blue"
        raise InputError(given.name, "a grey mirror ball", got)
    return ball, reflectance


@dataclass(frozen=True, eq=False)
class SunSpot:
    """The sun's image in a ball: its `middle` (2) and `length` in pixels, `to_light` (3), and `sigma` in radians."""

    middle: np.ndarray
    length: float
    to_light: np.ndarray
    sigma: float


def sun_spot(photo: LinearPhoto, ball: Ball) -> SunSpot | None:
    """The largest short clipped patch on the ball that has a sharp edge; None without one."""
    uv = pixels_about(photo, ball)
    _, out, cosine = (a.reshape(*uv.shape[:2], -1) for a in reflect(photo, ball, photo.rays(uv.reshape(-1, 2))))
    value, burnt = (image[uv[..., 1], uv[..., 0]].min(axis=-1) for image in (photo.light, photo.pixels))
    labels, count = ndimage.label((burnt >= BURNT) & (np.nan_to_num(cosine[..., 0]) > GRAZING), np.ones((3, 3)))
    found, most = None, SPOT_LEAST - 1
    for patch in (labels == k + 1 for k in range(count)):
        mean = out[patch].mean(axis=0)
        degrees = 2 * np.degrees(np.arccos(np.clip((out[patch] @ mean / np.linalg.norm(mean)).min(), -1, 1)))
        length = float(np.ptp(uv[patch], axis=0).max() + 1)
        around, grown = (ndimage.binary_dilation(patch, iterations=n) for n in (SPOT_AROUND, SPOT_AROUND - 1))
        ring, top = np.quantile(value[around & ~grown], 0.9), np.median(value[patch])
        is_lamp = (length > SUN_PX and degrees > SUN_DEGREES) or ring > SPOT_EDGE * top
        if patch.sum() <= most or is_lamp or out[patch][:, 2].min() < LOWEST_SUN_Z:
            continue
        weight = np.where(grown, np.clip((value - ring) / (top - ring), 0, 1), 0)
        middle = (weight[..., None] * uv).sum(axis=(0, 1)) / weight.sum()
        to_light = reflect(photo, ball, photo.rays(middle[None]))[1][0]
        sigma = 4 * EDGE_PX / np.ptp(outline(photo, ball), axis=0).mean()  # twice the normal's
        found, most = SunSpot(middle, length, to_light, float(sigma)), patch.sum()
    return found
