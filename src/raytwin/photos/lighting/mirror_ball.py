"""A mirror ball is a photo of everything around it (Debevec, "Rendering Synthetic Objects into Real Scenes", 1998).

From the eye e a sphere (c, r) is seen within a cone; it touches the sphere along a circle, of radius r q / d about
c - (r/d)² (c - e) with d = |c - e| and q = √(d² - r²). That circle, seen through the lens, is the ball's outline. A
pixel's ray d meets the ball where its normal is n, and goes on along ω = d - 2 (d·n) n: the pixel shows the light from
there, times the ball's reflectance.

The rim of a mirror shows what is behind it, a little darker, and edges inside are far stronger: an outline is scored by
how much of it is an edge at all. The mirror also shows the board, whose look the photo tells. Differential evolution
finds the ball near the given one whose outline and mirrored board fit best.

What it shows becomes maps of the light from all around: without its lamps, and of its lamps alone. A texel is the mean
of the pixels about its direction, each weighed by its solid angle and by a Gaussian of its distance: the nearest ones
fill the texels that no pixel shows. The sun's spot is left out. Clipped pixels beside it are lamps, of which the photo
tells the shape alone.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage
from scipy.optimize import differential_evolution

from raytwin.errors import InputError
from raytwin.photos.boards.board import Board, draw_board
from raytwin.photos.lighting.linear_photo import LAMP_CODE, LinearPhoto, sample
from raytwin.tracer.lights.envmap_tables import REC_709, texel_directions

LEAST_BALL_PX = 24.0
"""Least width of a ball."""

CENTER_SD_RADII, RADIUS_SD, SEARCH_SIGMAS = 0.15, 0.01, 2.5
"""Standard deviations of each given coordinate, in radii, and of the given radius, as a share of it; how many of them
the search reaches to either side."""

EDGE_SD_PX, DISTANCE_SD = 0.2, 0.004
"""Standard deviations of the ball that is found: of its outline, across and down, and of its distance, as a share."""

OUTLINE_PLACES = 90
"""Places along an outline."""

FULL_EDGE_CODES = 4.0
"""Step across an outline, in 8-bit codes, that counts as a full edge; larger steps add little to the score."""

LEAST_OUTLINE_SCORE = 0.7
"""Least score of an outline that counts as a ball's."""

OUTLINE_WEIGHT = 60.0
"""Log-likelihood of an outline that is all edge over one that is none."""

MAX_PIXELS_ACROSS = 200
"""Largest number of pixels across the ball in which the mirrored board is searched for."""

FINE_PX, COARSE_PX = 0.7, 3.0
"""The board's details in the mirror lie between these blurs, in such pixels: finer ones are noise, coarser shading."""

BOARD_BLUR_PX = 2.0
"""Blur of the board before it is compared with its mirror image, in which it is smaller."""

PIXELS_PER_SAMPLE = 8
"""Neighbouring pixels that err alike."""

SHEET_MARGIN_METRES = 0.004
"""Distance from the sheet's edge within which its light is not used."""

LEAST_MIRRORED_PIXELS, LEAST_CORRELATION, MAX_REFLECTANCE_RATIO = 50, 0.35, 1.3
"""A mirror shows the board in at least so many pixels, correlates with it at least so well, and its reflectances of
red, green and blue differ by this factor at most."""

LEAST_SPOT_PIXELS, SPOT_MARGIN_PX, SPOT_EDGE = 4, 4, 0.75
"""Least number of clipped pixels in the sun's spot. So far outside it the light has fallen below this share of the
spot's: around a clipped lamp it fades out."""

SUN_PX, SUN_DEGREES = 8.0, 6.0
"""Longest extent of the sun's spot: glare spreads a point over so many pixels or degrees. A longer patch is a lamp."""

LEAST_SUN_Z = 0.05
"""Least z of the sun's direction: a lower light does not light the board."""

LEAST_COSINE = 0.2
"""Least cosine between ray and normal: nearer to the outline a pixel shows too much at once."""


MAP_ROWS = 16
"""Rows of the map: more would not change a matt sphere's shading by half a per cent."""

BLUR_DEGREES = 6.0
"""Standard deviation of the Gaussian: about half a texel."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere of the board's frame, metres; `sigma` (4): one standard deviation of x, y, z and radius."""

    center: np.ndarray
    radius: float
    sigma: np.ndarray


def outline(photo: LinearPhoto, ball: Ball) -> np.ndarray:
    """Return the pixels (OUTLINE_PLACES, 2) of the ball's outline, in order."""
    away = ball.center - photo.camera.eye
    d = np.linalg.norm(away)
    r = min(ball.radius, float(0.999 * d))
    u, v = np.linalg.svd(away[None])[2][1:]
    turn = np.linspace(0, 2 * np.pi, OUTLINE_PLACES, endpoint=False)[:, None]
    ring = r * math.sqrt(d * d - r * r) / d
    return photo.project(ball.center - (r / d) ** 2 * away + ring * (np.cos(turn) * u + np.sin(turn) * v))


def reflect(photo: LinearPhoto, ball: Ball, d: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return where rays d (n, 3) meet the ball (n, 3), their reflected directions (n, 3), and the cosines of ray and
    normal (n,); NaN where they miss it."""
    f = np.array(photo.camera.eye) - ball.center
    b = d @ f
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - (f @ f - ball.radius**2))
    n, cosine = (f + (-b - root)[:, None] * d) / ball.radius, root / ball.radius
    return ball.center + ball.radius * n, d + 2 * cosine[:, None] * n, cosine


def pixels_about(photo: LinearPhoto, ball: Ball, reach: float = 1.0, most: int = 1 << 30) -> np.ndarray:
    """Return the pixels (h, w, 2) of the box about `reach` times the ball's outline, within the frame: all of them, or
    every nth, so that at most `most` lie across the ball."""
    rim = outline(photo, ball)
    middle, wide = rim.mean(axis=0), np.ptp(rim, axis=0)
    low = np.maximum(np.floor(middle - reach * wide / 2), 0).astype(int)
    high = np.minimum(np.ceil(middle + reach * wide / 2), np.array(photo.camera.image_size) - 1).astype(int)
    step = math.ceil(wide.max() / most)
    return np.stack(np.meshgrid(*(np.arange(a, b + 1, step) for a, b in zip(low, high, strict=True))), axis=-1)


def check_seen(photo: LinearPhoto, ball: Ball) -> None:
    """Raise InputError where the ball is not whole and large in the photo."""
    rim, size = outline(photo, ball), np.array(photo.camera.image_size)
    distance = np.array(photo.camera.R_cam_board)[2] @ ball.center + photo.camera.t_cam_board[2]
    wide = float(np.ptp(rim, axis=0).max())
    for seen, expected, got in (
        (ball.center[2] > -ball.radius, "on the printed side of the board, z > 0", f"z = {ball.center[2]:g}"),
        (distance > ball.radius, "in front of the camera", "one beside or behind it"),
        (((rim >= 0) & (rim <= size - 1)).all(), "that is whole in the photo", "one that the frame cuts"),
        (wide >= LEAST_BALL_PX, f"at least {LEAST_BALL_PX:.0f} pixels wide", f"{wide:.0f} pixels"),
    ):
        if not seen:
            raise InputError(f"{photo.name}: --ball", f"a ball {expected}", got)


class Search:
    """A photo in which a ball is searched for: scores a ball by its outline and by the board that it mirrors."""

    def __init__(self, photo: LinearPhoto, board: Board, given: Ball) -> None:
        self.photo, (x0, x1, y0, y1) = photo, draw_board(board, 100.0)[1]
        self.middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        self.half = np.array([(x1 - x0) / 2, (y1 - y0) / 2]) - SHEET_MARGIN_METRES
        self.codes = cv2.GaussianBlur(photo.pixels, (0, 0), 0.7).astype(np.float32)
        luminance = photo.light @ REC_709.astype(np.float32)
        self.board = cv2.GaussianBlur(luminance, (0, 0), BOARD_BLUR_PX)
        uv = pixels_about(photo, given, 1 + SEARCH_SIGMAS * CENTER_SD_RADII, MAX_PIXELS_ACROSS)
        self.rays, self.shape = photo.rays(uv.reshape(-1, 2)), uv.shape[:2]
        layers = np.dstack([photo.light, luminance, photo.clipped]).astype(np.float32)
        step = int(uv[0, 1, 0] - uv[0, 0, 0])
        self.seen = cv2.blur(layers, (step, step))[uv[..., 1], uv[..., 0]]

    def outline_score(self, ball: Ball) -> float:
        """Return how much of the outline is an edge: about 1 where all of it is."""
        rim = outline(self.photo, ball)
        along = np.roll(rim, -1, axis=0) - np.roll(rim, 1, axis=0)
        across = 1.5 * np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
        step = np.nan_to_num(np.abs(sample(self.codes, rim + across) - sample(self.codes, rim - across)).max(axis=1))
        return float(np.mean(np.minimum(step, FULL_EDGE_CODES) / FULL_EDGE_CODES + 0.05 * step / (step + 30)))

    def mirrored_board(self, ball: Ball) -> tuple[float, float, np.ndarray]:
        """Return the correlation of the ball's pixels with the board that they mirror, its log-likelihood over none,
        and their light over the luminance of what they mirror (3)."""
        points, out, cosine = reflect(self.photo, ball, self.rays)
        with np.errstate(invalid="ignore", divide="ignore"):
            down = (out[:, 2] < -0.02) & (cosine > LEAST_COSINE)
            at = points - (points[:, 2] / np.where(down, out[:, 2], np.nan))[:, None] * out
            on_sheet = (np.abs(at[:, :2] - self.middle) < self.half).all(axis=1)
        if on_sheet.sum() < LEAST_MIRRORED_PIXELS:
            return 0.0, 0.0, np.ones(3)
        direct = np.full(self.shape, np.nan)
        direct[on_sheet.reshape(self.shape)] = sample(self.board, self.photo.project(at[on_sheet]))
        good = np.isfinite(direct) & (self.seen[..., 4] == 0)
        a, b = (_detail(values, good) for values in (direct, self.seen[..., 3]))
        alike = max(float(a @ b / np.sqrt((a @ a) * (b @ b) + 1e-12)), 0.0)
        likelihood = -len(a) / (2 * PIXELS_PER_SAMPLE) * math.log(max(1 - alike**2, 1e-6))
        return alike, likelihood, self.seen[good][:, :3].sum(axis=0) / max(direct[good].sum(), 1e-9)


def _detail(values: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return the `good` ones (n,) of values (h, w), without their finest noise and their shading."""
    layers = np.dstack([np.where(good, values, 0), good]).astype(np.float32)
    fine, coarse = (cv2.GaussianBlur(layers, (0, 0), sigma)[good] for sigma in (FINE_PX, COARSE_PX))
    return fine[:, 0] / np.maximum(fine[:, 1], 1e-6) - coarse[:, 0] / np.maximum(coarse[:, 1], 1e-6)


def find_ball(photo: LinearPhoto, board: Board, center: np.ndarray, radius: float) -> tuple[Ball, np.ndarray]:
    """Return the likeliest ball near the given one, and its reflectance (3).

    Raises InputError where none is seen, where it does not show the board, or not in grey.
    """
    given = Ball(center, radius, np.array([CENTER_SD_RADII] * 3 + [RADIUS_SD]) * radius)
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
    sigma = np.hypot(EDGE_SD_PX * np.linalg.norm(away) / photo.camera.fx, DISTANCE_SD * away)
    ball = Ball(best[:3], float(best[3]), np.array([*sigma, RADIUS_SD * radius]))
    score, (alike, _, reflected) = search.outline_score(ball), search.mirrored_board(ball)
    reflectance = reflected / photo.paper_colour
    grey = reflectance.max() < MAX_REFLECTANCE_RATIO * reflectance.min() and 0.2 < reflectance.mean() < 1.1
    by_colour = ", ".join(f"{r:.2f}" for r in reflectance)
    for seen, expected, got in (
        (score >= LEAST_OUTLINE_SCORE, "a ball whose outline is seen there", f"edges along {100 * score:.0f} % of it"),
        (alike >= LEAST_CORRELATION, "a mirror ball that shows the board", f"no mirror (correlation {alike:.2f})"),
        (grey, "a grey mirror ball", f"one that reflects {by_colour} of red, green and blue"),
    ):
        if not seen:
            raise InputError(f"{photo.name}: --ball", expected, got)
    return ball, reflectance


@dataclass(frozen=True, eq=False)
class SunSpot:
    """The sun's image in a ball: its `middle` (2) and `length` in pixels, `to_light` (3), and `sigma` in radians."""

    middle: np.ndarray
    length: float
    to_light: np.ndarray
    sigma: float


def sun_spot(photo: LinearPhoto, ball: Ball) -> SunSpot | None:
    """Return the largest short clipped patch on the ball that has a sharp edge; None without one."""
    uv = pixels_about(photo, ball)
    _, out, cosine = (a.reshape(*uv.shape[:2], -1) for a in reflect(photo, ball, photo.rays(uv.reshape(-1, 2))))
    value, burnt = (image[uv[..., 1], uv[..., 0]].min(axis=-1) for image in (photo.light, photo.pixels))
    clipped = (burnt >= LAMP_CODE) & (np.nan_to_num(cosine[..., 0]) > LEAST_COSINE)
    labels, count = ndimage.label(clipped, np.ones((3, 3)))
    found, most = None, LEAST_SPOT_PIXELS - 1
    for patch in (labels == k + 1 for k in range(count)):
        mean = out[patch].mean(axis=0)
        degrees = 2 * np.degrees(np.arccos(np.clip((out[patch] @ mean / np.linalg.norm(mean)).min(), -1, 1)))
        length = float(np.ptp(uv[patch], axis=0).max() + 1)
        around, grown = (ndimage.binary_dilation(patch, iterations=n) for n in (SPOT_MARGIN_PX, SPOT_MARGIN_PX - 1))
        ring, top = np.quantile(value[around & ~grown], 0.9), np.median(value[patch])
        is_lamp = (length > SUN_PX and degrees > SUN_DEGREES) or ring > SPOT_EDGE * top
        if patch.sum() <= most or is_lamp or out[patch][:, 2].min() < LEAST_SUN_Z:
            continue
        weight = np.where(grown, np.clip((value - ring) / (top - ring), 0, 1), 0)
        middle = (weight[..., None] * uv).sum(axis=(0, 1)) / weight.sum()
        to_light = reflect(photo, ball, photo.rays(middle[None]))[1][0]
        sigma = 4 * EDGE_SD_PX / np.ptp(outline(photo, ball), axis=0).mean()  # twice the normal's
        found, most = SunSpot(middle, length, to_light, float(sigma)), patch.sum()
    return found


@dataclass(frozen=True, eq=False)
class MirrorBall:
    """A mirror ball, its reflectance (3), the sun's spot in it, and the maps (rows, 2 rows, 3) of what it shows:
    without lamps, and of clipped lamps alone."""

    ball: Ball
    reflectance: np.ndarray
    spot: SunSpot | None
    dim: np.ndarray
    lamps: np.ndarray


def find_mirror(photo: LinearPhoto, board: Board, center: np.ndarray, radius: float) -> MirrorBall:
    """Return the mirror ball near the given one, see `find_ball`."""
    ball, reflectance = find_ball(photo, board, center, radius)
    spot = sun_spot(photo, ball)
    return MirrorBall(ball, reflectance, spot, *mirrored_maps(photo, ball, reflectance, spot))


def mirrored_maps(
    photo: LinearPhoto, ball: Ball, reflectance: np.ndarray, spot: SunSpot | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return two maps (rows, 2 rows, 3): radiance without lamps, and that of the clipped lamps."""
    uv = pixels_about(photo, ball, most=MAX_PIXELS_ACROSS).reshape(-1, 2)
    uv = uv[np.nan_to_num(reflect(photo, ball, photo.rays(uv))[2]) > LEAST_COSINE]
    if spot:
        uv = uv[np.linalg.norm(uv - spot.middle, axis=1) > spot.length / 2 + SPOT_MARGIN_PX - 1]
    out, right, down = (reflect(photo, ball, photo.rays(uv + np.array(s)))[1] for s in ((0, 0), (0.1, 0), (0, 0.1)))
    steradians = np.linalg.norm(np.cross(right - out, down - out), axis=1)
    radiance = np.maximum(photo.light[uv[:, 1], uv[:, 0]], 0) / reflectance
    lamp = photo.pixels[uv[:, 1], uv[:, 0]].min(axis=1, keepdims=True) >= LAMP_CODE
    texels = texel_directions(MAP_ROWS, 2 * MAP_ROWS).reshape(-1, 3)
    near = np.exp((texels @ out.T - 1) / np.radians(BLUR_DEGREES) ** 2) * steradians
    both = near @ np.c_[radiance * ~lamp, radiance * lamp] / near.sum(axis=1, keepdims=True)
    dim, lamps = both.reshape(MAP_ROWS, -1, 2, 3).transpose(2, 0, 1, 3).astype(np.float32)
    return dim, lamps
