"""A mirror ball is a photo of everything around it (Debevec, "Rendering Synthetic Objects into Real Scenes", 1998).

From the eye e a sphere (c, r) is seen within a cone; it touches the sphere along a circle, of radius r q / d about
c - (r/d)² (c - e) with d = |c - e| and q = √(d² - r²). That circle, seen through the lens, is the ball's outline. A
pixel's ray d meets the ball where its normal is n, and goes on along ω = d - 2 (d·n) n: the pixel shows the light from
there, times the ball's reflectance.

The rim of a mirror shows what is behind it, a little darker, and edges inside are far stronger: an outline is scored by
how much of it is an edge at all. The board is in the mirror, too, and the photo shows what it looks like. Of all balls
within reach of the given one that of the greatest likelihood is taken (differential evolution), then outline, mirrored
board and what was given are fitted at once, by least squares.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from scipy import ndimage
from scipy.optimize import differential_evolution, least_squares

from raytwin.errors import InputError
from raytwin.photos.boards.board import Board, draw_board
from raytwin.photos.lighting.board_plane import on_board
from raytwin.photos.lighting.linear_photo import LinearPhoto, sample
from raytwin.tracer.lights.envmap_tables import REC_709

LEAST_PX = 24.0
"""Pixels that a ball must be wide."""

RADIUS_SD, PLACE_SD = 0.01, 0.15
"""Standard deviations of what `--ball` says, as shares of the radius: of the radius, and of each coordinate."""

SEARCH_SIGMAS = 2.5
"""A ball is searched for within this many standard deviations of its given place and radius."""

RIM_PLACES = 180
"""Places along an outline."""

FULL_EDGE_CODES = 4.0
"""Step across an outline, in 8-bit codes, that counts as a full edge; larger steps add little to the score."""

EDGE_SHARE = 0.7
"""The least score of an outline that is taken for a ball's."""

OUTLINE_WEIGHT = 60.0
"""Log-likelihood of an outline that is all edge over one that is none."""

SEARCH_STEP, SEARCH_SD = 4, 0.2
"""The search uses every fourth pixel each way; standard deviation of one from the mirrored board, as share of white."""

COVERED = 0.03
"""Metres of the board that a mirrored pixel may cover, down plus across; what it shows is blurred as much."""

FIRST_BLUR_PX, BLUR_LEVELS = 0.7, 5
"""Pixels of the first of a photo's blurs to choose from, each twice the one before; how many there are."""

SHEET_MARGIN = 0.004
"""Metres from the sheet's edge within which its light is not used."""

EDGE_PX, BOARD_SD = 0.7, 0.1
"""Standard deviations in the fit: of an edge from the outline, pixels; of a mirrored pixel, as a share of white."""

CORRELATED = 30
"""Neighbouring pixels, and places of an outline, that err alike."""

EDGE_BIAS = 0.2
"""Pixels by which blur, JPEG and the camera's pose may shift all of an outline."""

SPOT_LEAST, SPOT_AROUND, SPOT_EDGE = 4, 4, 0.75
"""The sun's spot has so many clipped pixels at least, and this many pixels outside it the light has fallen below this
share of the spot's: around a clipped lamp it fades out."""

SUN_PX, SUN_DEGREES = 8.0, 6.0
"""Longest extent of the sun's spot: glare spreads a point over so many pixels or degrees. A longer patch is a lamp."""

LOWEST_SUN_Z = 0.05
"""Least z of the sun's direction: a lower light does not light the board."""

SPOT_PX = 0.12
"""Pixels by which the middle of the sun's spot is off, across and down."""

GRAZING = 0.2
"""The least cosine between ray and normal: nearer to the outline a pixel shows too much at once."""


LEAST_MIRRORED, LEAST_CORRELATION, MAX_REFLECTANCE_RATIO = 50, 0.35, 1.3
"""A mirror shows the board in so many pixels at least, correlates with it so well, and its reflectances of red, green
and blue differ by this factor at most. Four photos of a chrome ball of 80 pixels correlate by 0.50 to 0.78, of an
orange by up to 0.16."""

SHADING_PX, SHIFT_PX, COARSEST_METRES = 3.0, 2, 0.1
"""Pixels of the blur that is taken for shading; pixels by which the ball may be off; metres of board that a pixel may
cover there."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere of the board's frame, metres; `covariance` (4, 4) of x, y, z and radius."""

    center: np.ndarray
    radius: float
    covariance: np.ndarray

    def moved(self, x: np.ndarray) -> "Ball":
        """Return the ball with the center and radius `x` (4)."""
        return replace(self, center=x[:3], radius=float(x[3]))

    @property
    def numbers(self) -> np.ndarray:
        return np.array([*self.center, self.radius])

    @property
    def sigma(self) -> np.ndarray:
        """One standard deviation of x, y, z and radius."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def name(self) -> str:
        return f"ball {','.join(f'{x:.4g}' for x in self.numbers)}"


def given_ball(center: np.ndarray, radius: float) -> Ball:
    """The ball as the user gave it."""
    return Ball(np.asarray(center), radius, np.diag((radius * np.array([PLACE_SD] * 3 + [RADIUS_SD])) ** 2))


def outline(photo: LinearPhoto, ball: Ball, count: int = RIM_PLACES) -> np.ndarray:
    """(count, 2): pixels of the ball's outline, in order."""
    eye, r = np.array(photo.camera.eye), ball.radius
    away = ball.center - eye
    d = np.linalg.norm(away)
    u, v = np.linalg.svd(away[None])[2][1:]
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    r = min(r, float(0.999 * d))
    ring = r * math.sqrt(d * d - r * r) / d
    return photo.project(ball.center - (r / d) ** 2 * away + ring * (np.cos(turn) * u + np.sin(turn) * v))


def reflect(photo: LinearPhoto, ball: Ball, uv: np.ndarray) -> tuple[np.ndarray, ...]:
    """(n, 3) points, (n, 3) reflected directions, (n,) cosine of ray and normal, NaN where the ball is missed."""
    d, f = photo.rays(uv), np.array(photo.camera.eye) - ball.center
    b = d @ f
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - (f @ f - ball.radius**2))
    n, cosine = (f + (-b - root)[:, None] * d) / ball.radius, root / ball.radius
    return ball.center + ball.radius * n, d + 2 * cosine[:, None] * n, cosine


def pixels_about(photo: LinearPhoto, ball: Ball, reach: float = 1.0, step: int = 1) -> np.ndarray:
    """(n, 2): every `step`th pixel in the box about `reach` times the ball's outline, within the frame."""
    rim = outline(photo, ball)
    middle, half = rim.mean(axis=0), reach * np.ptp(rim, axis=0) / 2
    low = np.maximum(np.floor(middle - half), 0).astype(int)
    high = np.minimum(np.ceil(middle + half).astype(int), np.array(photo.camera.image_size) - 1)
    ranges = [np.arange(a, b + 1, step) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*ranges), axis=-1).reshape(-1, 2)


def pixels_of(photo: LinearPhoto, ball: Ball) -> np.ndarray:
    """(n, 2): the pixels that show the ball, its rim left out."""
    uv = pixels_about(photo, ball)
    return uv[np.nan_to_num(reflect(photo, ball, uv)[2]) > GRAZING]


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


def _normals(rim: np.ndarray) -> np.ndarray:
    along = np.roll(rim, -1, axis=0) - np.roll(rim, 1, axis=0)
    n = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


SunSpot = tuple[np.ndarray, float]
"""Its middle (2) and its length, in pixels."""


def sun_spot(photo: LinearPhoto, ball: Ball) -> SunSpot | None:
    """The largest short clipped patch on the ball that has a sharp edge.

    The middle is that of its brightest part, so that a lamp beside the sun does not shift it.
    """
    uv = pixels_of(photo, ball)
    clipped = np.zeros(photo.clipped.shape, bool)
    clipped[uv[:, 1], uv[:, 0]] = photo.burnt[uv[:, 1], uv[:, 0]]
    value, labels = photo.light.min(axis=-1), ndimage.label(clipped, np.ones((3, 3)))[0]
    found, most = None, SPOT_LEAST - 1
    for k, box in enumerate(ndimage.find_objects(labels), 1):
        near = tuple(slice(max(0, b.start - SPOT_AROUND), b.stop + SPOT_AROUND) for b in box)
        patch = labels[near] == k
        corner = np.array([near[1].start, near[0].start])
        at = np.argwhere(patch)[:, ::-1] + corner
        length, degrees, up = _extent(photo, ball, at)
        if len(at) <= most or (length > SUN_PX and degrees > SUN_DEGREES) or up < LOWEST_SUN_Z:
            continue
        ring = np.logical_xor(*(ndimage.binary_dilation(patch, iterations=SPOT_AROUND - i) for i in (0, 1)))
        around, top = np.quantile(value[near][ring], 0.9), np.median(value[near][patch])
        if around > SPOT_EDGE * top:
            continue
        weight = np.clip((value[near] - around - 0.3 * (top - around)) / (0.63 * (top - around)), 0, 1)
        weight *= ndimage.binary_dilation(patch, iterations=SPOT_AROUND - 1)
        middle = np.array([(weight * axis).sum() / weight.sum() for axis in np.mgrid[near][::-1]])
        found, most = (middle, length), len(at)
    return found


def _extent(photo: LinearPhoto, ball: Ball, uv: np.ndarray) -> tuple[float, float, float]:
    """The length of a patch of pixels `uv` (n, 2), in pixels and degrees of what it mirrors, and that's least z."""
    ends = uv[np.unique([f(uv @ d) for d in ((1, 0), (0, 1), (1, 1), (1, -1)) for f in (np.argmin, np.argmax)])]
    out = reflect(photo, ball, ends)[1]
    apart = np.linalg.norm(ends[:, None] - ends, axis=-1).max() + 1
    return float(apart), float(np.degrees(np.arccos(np.clip((out @ out.T).min(), -1, 1)))), float(out[:, 2].min())


@dataclass(frozen=True, eq=False)
class View:
    """A photo as the search sees it: its `codes`, a little blurred; its luminance, each level of `blurred` twice as
    much so, the first by FIRST_BLUR_PX pixels; and where the sheet ends."""

    photo: LinearPhoto
    codes: np.ndarray
    blurred: list[np.ndarray]
    extent: tuple[float, float, float, float]

    def value(self, uv: np.ndarray) -> np.ndarray:
        """(n,): the luminance of pixels `uv` (n, 2)."""
        return self.blurred[0][uv[:, 1], uv[:, 0]]

    def outline_score(self, ball: Ball) -> float:
        """How much of the outline is an edge: about 1 where all of it is."""
        rim = outline(self.photo, ball, RIM_PLACES // 2)
        across = 1.5 * _normals(rim)
        step = np.nan_to_num(np.abs(sample(self.codes, rim + across) - sample(self.codes, rim - across)).max(axis=1))
        return float(np.mean(np.minimum(step, FULL_EDGE_CODES) / FULL_EDGE_CODES + 0.05 * step / (step + 30)))

    def mirrored(self, ball: Ball, uv: np.ndarray, most: float = COVERED) -> np.ndarray:
        """(n,): the luminance of the place of the board that each pixel mirrors, blurred by what the pixel covers; NaN
        where it is none that the photo shows, or covers more than `most` metres."""
        at, right, down = (on_board(*reflect(self.photo, ball, uv + np.array(s))[:2]) for s in ((0, 0), (1, 0), (0, 1)))
        covered = np.linalg.norm(right - at, axis=1) + np.linalg.norm(down - at, axis=1)
        x0, x1, y0, y1 = self.extent
        x, y = at.T
        inside = (
            (x > x0 + SHEET_MARGIN)
            & (x < x1 - SHEET_MARGIN)
            & (y > y0 + SHEET_MARGIN)
            & (y < y1 - SHEET_MARGIN)
            & (covered < most)
        )
        shown, there = np.full(len(uv), np.nan), np.c_[at[inside], np.zeros(inside.sum())]
        if len(there):
            far = np.linalg.norm(there - self.photo.camera.eye, axis=1)
            sigma = 0.2 * covered[inside] * self.photo.camera.fx / far
            level = np.clip(np.rint(np.log2(np.maximum(sigma, 1e-3) / FIRST_BLUR_PX)), 0, BLUR_LEVELS - 1)
            seen, found = self.photo.project(there), np.zeros(len(there))
            for k in np.unique(level).astype(int):
                found[level == k] = sample(self.blurred[k], seen[level == k])
            shown[inside] = found
        return shown

    def board_explains(self, uv: np.ndarray, ball: Ball) -> float:
        """Log-likelihood of the pixels as a mirror of the board over their being even, the best reflectance taken."""
        shown = self.mirrored(ball, uv)
        fine = np.isfinite(shown)
        if SEARCH_STEP**2 * fine.sum() < 300:
            return 0.0
        shown, value = shown[fine], self.value(uv[fine])
        shown, value = shown - shown.mean(), value - value.mean()
        size, along = max(shown @ shown, 1e-9), shown @ value
        rho = np.clip(along / size, 0.3, 1.1)
        return float(2 * rho * along - rho * rho * size) / (2 * SEARCH_SD**2)


def views_of(photos: list[LinearPhoto], board: Board) -> list[View]:
    """What `find_ball` and `check_mirror` look at."""
    extent, views = draw_board(board, 100.0)[1], []
    for photo in photos:
        codes = cv2.GaussianBlur(photo.pixels, (0, 0), 0.7).astype(np.float32)
        luminance = np.minimum(photo.light @ REC_709.astype(np.float32), 1.3)  # the sun equals its glare
        blurred = [cv2.GaussianBlur(luminance, (0, 0), FIRST_BLUR_PX * 2**k) for k in range(BLUR_LEVELS)]
        views.append(View(photo, codes, blurred, extent))
    return views


def find_ball(views: list[View], given: Ball) -> Ball:
    """The ball near `given` that is the likeliest in all photos at once. Raises InputError where none is seen."""
    for view in views:
        check_seen(view.photo, given)
    uv = [pixels_about(view.photo, given, 1.25, SEARCH_STEP) for view in views]

    def unlikely(x: np.ndarray) -> float:
        ball, z = given.moved(x), (x - given.numbers) / given.sigma
        edges = OUTLINE_WEIGHT * np.mean([view.outline_score(ball) for view in views])
        mirrored = sum(view.board_explains(at, ball) for view, at in zip(views, uv, strict=True))
        return float(0.5 * (z @ z) - max(mirrored, 0) - edges)

    low, high = given.numbers - SEARCH_SIGMAS * given.sigma, given.numbers + SEARCH_SIGMAS * given.sigma
    best = differential_evolution(
        unlikely, list(zip(low, high, strict=True)), rng=0, popsize=8, maxiter=30, tol=1e-5, polish=False, init="sobol"
    )
    ball = given.moved(best.x)
    for view in views:
        check_seen(view.photo, ball)
        if (score := view.outline_score(ball)) < EDGE_SHARE:
            expected = "a ball whose outline is seen there"
            raise InputError(f"{view.photo.name}: {given.name}", expected, f"edges along {100 * score:.0f} % of it")
    return _refined(views, ball, given)


def _refined(views: list[View], ball: Ball, given: Ball) -> Ball:
    """The ball that outline, mirrored board and what was given agree on best, by least squares."""
    parts: list[Callable[[Ball], np.ndarray]] = [lambda moved: (moved.numbers - given.numbers) / given.sigma]
    for view in views:
        parts.append(partial(_off_outline, view, outline(view.photo, ball)))
        uv = pixels_of(view.photo, ball)
        uv = uv[np.isfinite(view.mirrored(ball, uv))]
        if len(uv) > 50:
            parts.append(partial(_off_board, view, uv[:: max(1, len(uv) // 1500)]))

    def off(x: np.ndarray) -> np.ndarray:
        return np.concatenate([error(ball.moved(x)) for error in parts])

    fit = least_squares(off, ball.numbers, x_scale=given.sigma, diff_step=1e-4, max_nfev=30)
    pixel = 2 * ball.radius / np.mean([np.ptp(outline(view.photo, ball), axis=0) for view in views])
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) + (EDGE_BIAS * pixel) ** 2 * np.eye(4)
    return replace(ball.moved(fit.x), covariance=covariance)


def _bounded(z: np.ndarray) -> np.ndarray:
    """What is many standard deviations off says little."""
    return 2 * np.arctan(z / 2)


def _off_outline(view: View, rim: np.ndarray, ball: Ball) -> np.ndarray:
    """How far the outline is off the edges beside `rim`, weighed by how much of an edge each is."""
    normal, offsets = _normals(rim), np.arange(-2.0, 2.1, 0.25)
    across = sample(view.codes, (rim + offsets[:, None, None] * normal).reshape(-1, 2)).reshape(
        len(offsets), RIM_PLACES, 3
    )
    slope = np.nan_to_num(np.gradient(across, 0.25, axis=0) ** 2).sum(axis=-1)  # beyond the frame there is none
    weight = slope * (1 - (offsets[:, None] / 2.25) ** 2)
    edge = (weight * offsets[:, None]).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
    clear = np.sqrt(slope.max(axis=0)) / (np.sqrt(slope.max(axis=0)) + FULL_EDGE_CODES)
    moved = ((outline(view.photo, ball) - rim) * normal).sum(axis=1)
    return clear * _bounded((moved - edge) / EDGE_PX) / math.sqrt(CORRELATED)


def _off_board(view: View, uv: np.ndarray, ball: Ball) -> np.ndarray:
    """How far the mirrored board is off what the photo shows of it, but for a factor and an offset."""
    shown, value = view.mirrored(ball, uv), view.value(uv)
    good, off = np.isfinite(shown), np.full(len(uv), 3.0)
    if good.sum() > 50:
        A = np.stack([shown[good], np.ones(good.sum())], axis=1)
        off[good] = (A @ np.linalg.lstsq(A, value[good], rcond=None)[0] - value[good]) / BOARD_SD
    return _bounded(off) / math.sqrt(CORRELATED)


def sun_of(photos: list[LinearPhoto], ball: Ball, suns: Sequence[SunSpot | None]) -> tuple[np.ndarray, float] | None:
    """The sun's direction in the ball and its standard deviation in radians; None where no photo shows one."""
    spots = [(photo, spot[0]) for photo, spot in zip(photos, suns, strict=True) if spot]
    if not spots:
        return None

    def mean(x: np.ndarray) -> np.ndarray:
        d = np.nanmean([reflect(photo, ball.moved(x), at[None])[1][0] for photo, at in spots], axis=0)
        return d / np.linalg.norm(d)

    sun, step = mean(ball.numbers), 1e-3 * ball.radius
    turns = np.stack([(mean(ball.numbers + e) - sun) / step for e in step * np.eye(4)])
    steps = [reflect(photo, ball, at + np.array([(0, 0), (1, 0)]))[1] for photo, at in spots]
    pixel = np.mean([np.linalg.norm(d[1] - d[0]) for d in steps])
    spot = SPOT_PX * pixel / np.sqrt(len(spots))
    return sun, float(np.hypot(np.sqrt(np.trace(turns.T @ ball.covariance @ turns) / 2), spot))


def check_mirror(views: list[View], paper: np.ndarray, ball: Ball, given: Ball) -> np.ndarray:
    """The reflectance (3): what the ball shows of the board over what the photos show of it.

    Raises InputError where it does not show the board, or not in grey.
    """
    seen = [_board_seen(view, ball) for view in views]
    alike = max((alike for alike, *_ in seen), default=0.0)
    if alike < LEAST_CORRELATION:
        got = f"a ball that does not (correlation {alike:.2f}): it is no mirror, or not there"
        raise InputError(given.name, "a mirror ball that shows the board", got)
    reflectance = np.sum([mirror for _, mirror, _ in seen], axis=0) / np.sum([direct for *_, direct in seen]) / paper
    if reflectance.max() > MAX_REFLECTANCE_RATIO * reflectance.min() or not 0.2 < reflectance.mean() < 1.1:
        got = f"one that reflects {', '.join(f'{r:.2f}' for r in reflectance)} of red, green and blue"
        raise InputError(given.name, "a grey mirror ball", got)
    return reflectance


def _board_seen(view: View, ball: Ball) -> tuple[float, np.ndarray, float]:
    """How well the ball's pixels correlate with the board that they mirror, and the sums of both: (3) and luminance.

    Shading is taken out first. A ball may be a pixel or two off: the best of some shifts counts.
    """
    photo, uv = view.photo, pixels_about(view.photo, ball)
    shape = np.ptp(uv, axis=0)[::-1] + 1
    cosine = np.nan_to_num(reflect(photo, ball, uv)[2])
    shown = np.where(cosine > GRAZING, view.mirrored(ball, uv, COARSEST_METRES), np.nan)
    good = np.isfinite(shown) & ~photo.clipped[uv[:, 1], uv[:, 0]]
    if good.sum() < LEAST_MIRRORED:
        return 0.0, np.zeros(3), 0.0

    def detail(values: np.ndarray) -> np.ndarray:
        inside = good.reshape(shape).astype(float)
        mean, weight = (
            cv2.GaussianBlur(a, (0, 0), SHADING_PX) for a in (np.where(good, values, 0.0).reshape(shape), inside)
        )
        return values[good] - (mean / np.maximum(weight, 1e-6)).ravel()[good]

    board, last = detail(shown), np.array(photo.camera.image_size) - 1
    shifts = itertools.product(range(-SHIFT_PX, SHIFT_PX + 1), repeat=2)
    values = (detail(view.value(np.clip(uv + np.array(shift), 0, last))) for shift in shifts)
    alike = max(float(np.corrcoef(board, value)[0, 1]) for value in values)
    return alike, photo.light[uv[good, 1], uv[good, 0]].sum(axis=0), float(shown[good].sum())
