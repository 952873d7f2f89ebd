"""Where a ball is: the outline that a sphere makes in each photo, fitted to the edges that are there.

From the eye e a sphere (c, r) is seen within a cone; it touches the sphere along a circle, of radius r q / d about
c - (r/d)² (c - e) with d = |c - e| and q = √(d² - r²). That circle, seen through the lens, is the outline: a conic,
bent by the lens. One photo tells a ball's direction and the angle it fills; how large it is comes from its known
radius, or from resting on the board's plane, or from a second photo.

The rim of a mirror shows what is behind it, a little darker: the edges inside are far stronger than the outline. So a
place is scored by how much of its outline is an edge at all, however faint; only a matt ball is then drawn to them.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from scipy.optimize import least_squares

from raytwin.calib.lighting.linear_photo import LinearPhoto, sample
from raytwin.errors import InputError

RIM = 180
"""Places along an outline."""

LEAST_PX = 24.0
"""Pixels that a ball must be wide."""

RADIUS_SD, PLACE_SD = 0.01, 0.15
"""Standard deviations of what `--ball` says, as shares of the radius: of the radius, and of each coordinate."""

FOUND_SD = 0.2
"""The same for a ball that was found automatically: of the radius and of each coordinate."""

FOUND_SCORE = 0.7
"""The least score of a circle that may be a ball's outline."""

EDGE = 4.0
"""Step across an outline, in 8-bit codes, that counts as a full edge; larger steps add little to the score."""

LEAST_SLOPE = 0.005
"""Slope of the root of the light, per pixel: a smaller one is no edge."""

GRAZING = 0.2
"""The least cosine between ray and normal: nearer to the outline a pixel shows too much at once."""

REACHES = 6.0, 4.0, 3.0, 2.0, 1.5, 1.5
"""Pixels across the outline within which its edge is sought, one fit after the other."""

EDGE_SD, CORRELATED_PIXELS = 0.3, 10
"""Standard deviation of an edge from the outline, in pixels; number of neighbouring outline places that err alike."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere of the board's frame, metres; `prior`, `prior_sd`: center and radius (4) as they were given."""

    center: np.ndarray
    radius: float
    prior: np.ndarray
    prior_sd: np.ndarray
    sigma: np.ndarray
    """One standard deviation of x, y, z and radius."""

    def moved(self, x: np.ndarray, sigma: np.ndarray | None = None) -> "Ball":
        """Return the ball with the center and radius `x` (4)."""
        return replace(self, center=x[:3], radius=float(x[3]), sigma=self.sigma if sigma is None else sigma)

    @property
    def numbers(self) -> np.ndarray:
        return np.array([*self.center, self.radius])

    @property
    def name(self) -> str:
        return f"ball at {','.join(f'{x:.3f}' for x in self.numbers)}"


def prior_of(center: np.ndarray, radius: float, given: bool) -> Ball:
    """A ball as the user gave it, or as it was found by itself."""
    sd = radius * np.array([PLACE_SD] * 3 + [RADIUS_SD] if given else [FOUND_SD] * 4)
    return Ball(center, radius, np.array([*center, radius]), sd, sd)


def outline(photo: LinearPhoto, center: np.ndarray, radius: float, count: int = RIM) -> np.ndarray:
    """(count, 2): pixels of the sphere's outline, in order."""
    eye = np.array(photo.camera.eye)
    away = center - eye
    d = np.linalg.norm(away)
    axis = away / d
    u = np.array([axis[1], -axis[0], 0.0]) if abs(axis[2]) < 0.99 else np.array([0.0, axis[2], -axis[1]])
    u /= math.hypot(*u)
    v = np.array([axis[1] * u[2] - axis[2] * u[1], axis[2] * u[0] - axis[0] * u[2], axis[0] * u[1] - axis[1] * u[0]])
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    r = min(radius, float(0.999 * d))
    ring = r * math.sqrt(d * d - r * r) / d
    return photo.project(center - (r / d) ** 2 * away + ring * (np.cos(turn) * u + np.sin(turn) * v))


def width_px(photo: LinearPhoto, center: np.ndarray, radius: float) -> float:
    """How many pixels wide the ball is: twice the geometric mean of its outline's half axes."""
    rim = outline(photo, center, radius)
    return 2 * math.sqrt(abs(cv2.contourArea(rim.astype(np.float32))) / math.pi)


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


def pixels_about(photo: LinearPhoto, ball: Ball, reach: float = 1.0, step: int = 1) -> np.ndarray:
    """(n, 2): every `step`th pixel in the box about `reach` times the ball's outline, within the frame."""
    rim = outline(photo, ball.center, ball.radius)
    middle, half = rim.mean(axis=0), reach * np.ptp(rim, axis=0) / 2
    low = np.maximum(np.floor(middle - half), 0).astype(int)
    high = np.minimum(np.ceil(middle + half).astype(int), np.array(photo.camera.image_size) - 1)
    ranges = [np.arange(a, b + 1, step) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*ranges), axis=-1).reshape(-1, 2)


def pixels_of(photo: LinearPhoto, ball: Ball) -> np.ndarray:
    """(n, 2): the pixels that show the ball, its rim left out."""
    uv = pixels_about(photo, ball)
    return uv[np.nan_to_num(reflect(photo, ball, uv)[2]) > GRAZING]


def softened(photo: LinearPhoto) -> np.ndarray:
    """(H, W, 3): the photo's codes without the noise of single pixels."""
    return cv2.GaussianBlur(photo.pixels, (0, 0), 0.7).astype(np.float32)


def outline_score(photo: LinearPhoto, image: np.ndarray, x: np.ndarray) -> float:
    """How much of the outline of the ball `x` (4) is an edge of `image`, the photo's codes: about 1 where all of it
    is."""
    rim = outline(photo, x[:3], x[3], RIM // 2)
    across = 1.5 * _normals(rim)
    step = np.nan_to_num(np.abs(sample(image, rim + across) - sample(image, rim - across)).max(axis=1))
    return float(np.mean(np.minimum(step, EDGE) / EDGE + 0.05 * step / (step + 30)))


def fit_edges(photos: list[LinearPhoto], ball: Ball) -> Ball:
    """The ball drawn to the edges by its outline, to a tenth of a pixel: by least squares, robustly.

    Edges are sought in the root of the light, in which noise is even; each place's is the mean along its normal,
    weighed by the squared slope.
    """
    images = [cv2.GaussianBlur(np.sqrt(np.maximum(photo.light, 0)), (0, 0), 0.7) for photo in photos]
    for reach in REACHES:
        edges = [_edge_at(photo, image, ball, reach) for photo, image in zip(photos, images, strict=True)]
        fit = least_squares(
            partial(_off_edges, photos, edges, ball), ball.numbers, loss="soft_l1", x_scale=ball.prior_sd
        )
        ball = ball.moved(fit.x, np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac))))
    return ball


def _edge_at(photo: LinearPhoto, image: np.ndarray, ball: Ball, reach: float) -> tuple[np.ndarray, ...]:
    """For each place of the outline: where it is, its normal, how far along that its edge is, and if there is one."""
    rim = outline(photo, ball.center, ball.radius)
    normal, offsets = _normals(rim), np.arange(-reach, reach + 0.1, 0.25)
    across = sample(image, (rim + offsets[:, None, None] * normal).reshape(-1, 2)).reshape(len(offsets), RIM, 3)
    slope = (np.gradient(across, 0.25, axis=0) ** 2).sum(axis=-1)
    weight = slope * (1 - (offsets[:, None] / (reach + 0.25)) ** 2)
    off = (weight * offsets[:, None]).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
    return rim, normal, off, slope.max(axis=0) > LEAST_SLOPE**2


def _off_edges(photos: list[LinearPhoto], edges: list[tuple[np.ndarray, ...]], ball: Ball, x: np.ndarray) -> np.ndarray:
    rows = [(x - ball.prior) / ball.prior_sd]
    for photo, (rim, normal, off, there) in zip(photos, edges, strict=True):
        moved = ((outline(photo, x[:3], x[3]) - rim) * normal).sum(axis=1)
        rows.append((moved - off)[there] / EDGE_SD / math.sqrt(CORRELATED_PIXELS))
    return np.concatenate(rows)


def check_seen(photo: LinearPhoto, ball: Ball) -> None:
    """Raises InputError where the ball is not whole and large in the photo."""
    center, radius = ball.center, ball.radius
    where = f"{photo.name}: ball {','.join(f'{x:.4g}' for x in ball.numbers)}"
    if center[2] + radius <= 0:
        raise InputError(where, "a ball on the printed side of the board, z > 0", f"z = {center[2]:g}")
    cam = np.array(photo.camera.R_cam_board) @ center + np.array(photo.camera.t_cam_board)
    if cam[2] <= radius:
        raise InputError(where, "a ball in front of the camera", "one beside or behind it")
    rim = outline(photo, center, radius)
    if (rim < 0).any() or (rim > np.array(photo.camera.image_size) - 1).any():
        raise InputError(where, "a ball that is whole in the photo", "one that the frame cuts")
    if (wide := width_px(photo, center, radius)) < LEAST_PX:
        raise InputError(where, f"a ball at least {LEAST_PX:.0f} pixels wide", f"{wide:.0f} pixels")


def _normals(rim: np.ndarray) -> np.ndarray:
    along = np.roll(rim, -1, axis=0) - np.roll(rim, 1, axis=0)
    n = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def find_balls(photo: LinearPhoto, extent: tuple[float, float, float, float], most: int = 4) -> list[tuple]:
    """Circles of the photo as balls that rest on the board's plane beside its tags: (center, radius), best first.

    A circle of p pixels about a pixel whose ray is ω fills an angle; a sphere that touches z = 0 under that ray has
    one centre and radius.
    """
    x0, x1, y0, y1 = extent
    grey = cv2.GaussianBlur(cv2.cvtColor(photo.pixels, cv2.COLOR_RGB2GRAY), (0, 0), 1.5)
    sheet = photo.project(np.array([(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)], float))
    cv2.fillConvexPoly(grey, np.rint(sheet).astype(np.int32), float(np.median(grey)))  # tags are full of circles
    small = min(1.0, 800 / max(grey.shape))
    grey = cv2.resize(grey, None, fx=small, fy=small, interpolation=cv2.INTER_AREA)
    circles = cv2.HoughCircles(
        grey, cv2.HOUGH_GRADIENT, 1.5, 10, param1=40, param2=20, minRadius=int(LEAST_PX * small / 2),
        maxRadius=min(grey.shape) // 5,
    )  # fmt: skip
    if circles is None:
        return []
    codes = softened(photo)
    eye, found = np.array(photo.camera.eye), []
    for u, v, p in circles[0][:80] / small:
        rays = photo.rays(np.array([(u, v), (u + p, v), (u, v + p), (u - p, v), (u, v - p)]))
        sine = math.sin(float(np.mean(np.arccos(np.clip(rays[1:] @ rays[0], -1, 1)))))
        if rays[0, 2] > -0.1:
            continue
        d = eye[2] / (sine - rays[0, 2])  # eye + d ω has height d sin
        center, radius = eye + d * rays[0], d * sine
        inside = x0 - radius / 2 < center[0] < x1 + radius / 2 and y0 - radius / 2 < center[1] < y1 + radius / 2
        rim = outline(photo, center, radius)
        if inside or (rim < 1).any() or (rim > np.array(photo.camera.image_size) - 2).any():
            continue
        found.append((outline_score(photo, codes, np.array([*center, radius])), center, radius))
    found.sort(key=lambda f: -f[0])
    apart: list[tuple] = []
    for score, center, radius in found:
        if score > FOUND_SCORE and all(np.linalg.norm(center - c) > max(radius, r) for c, r in apart):
            apart.append((center, radius))
    return apart[:most]
