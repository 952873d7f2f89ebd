"""Where a ball is: the outline that a sphere makes in each photo, fitted to the edges that are there.

From the eye e a sphere (c, r) is seen within a cone; it touches the sphere along a circle, of radius r q / d about
c - (r/d)² (c - e) with d = |c - e| and q = √(d² - r²). That circle, seen through the lens, is the outline: a conic,
bent by the lens. One photo tells a ball's direction and the angle it fills; how large it is comes from its known
radius, or from resting on the board's plane, or from a second photo.
"""

import math
from dataclasses import dataclass

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
"""How well what `--ball` says is known: the radius as a share of itself, the place as a share of the radius."""

EDGE_SHARE = 0.35
"""The least share of the outline that must lie on edges."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere of the board's frame, metres; `sigma`: one standard deviation of x, y, z and radius; `edges`: the share
    of its outlines that lies on edges; `given`: by the user."""

    center: np.ndarray
    radius: float
    sigma: np.ndarray
    edges: float
    given: bool = True

    @property
    def name(self) -> str:
        return f"ball at {','.join(f'{x:.3f}' for x in (*self.center, self.radius))}"


def outline(photo: LinearPhoto, center: np.ndarray, radius: float, count: int = RIM) -> np.ndarray:
    """(count, 2): pixels of the sphere's outline, in order."""
    eye = np.array(photo.camera.eye)
    away = center - eye
    d = np.linalg.norm(away)
    axis = away / d
    u = np.cross(axis, [0.3, 0.9, 0.1])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    r = min(radius, float(0.999 * d))
    ring = r * math.sqrt(d * d - r * r) / d
    return photo.project(center - (r / d) ** 2 * away + ring * (np.cos(turn) * u + np.sin(turn) * v))


def width_px(photo: LinearPhoto, center: np.ndarray, radius: float) -> float:
    """How many pixels wide the ball is: twice the geometric mean of its outline's half axes."""
    rim = outline(photo, center, radius)
    return 2 * math.sqrt(abs(cv2.contourArea(rim.astype(np.float32))) / math.pi)


def fit_ball(photos: list[LinearPhoto], center: np.ndarray, radius: float, given: bool = True) -> Ball:
    """The ball near (center, radius) whose outlines lie on edges in all photos at once.

    Each photo's outline is first moved to where the edges are strongest; from there each place of the outline is drawn
    to the strongest edge across it, robustly, for a part of it may be hidden, or as bright as what is behind it.
    """
    for photo in photos:
        _check_seen(photo, center, radius)
    grads = [_edges(photo) for photo in photos]
    start = np.array([*center, radius])
    sd = np.array([PLACE_SD * radius] * 3 + [RADIUS_SD * radius])
    if not given:
        sd[:] = 0.5 * radius
    best = _searched(photos, grads, start, sd)
    noise = 0.7  # pixels by which the strongest edge misses the outline
    for reach in (0.15, 0.06, 0.03):
        targets = [_drawn(photo, grad, best, reach) for photo, grad in zip(photos, grads, strict=True)]

        def error(x: np.ndarray, targets=targets) -> np.ndarray:
            rows = []
            for photo, (at, normal, there) in zip(photos, targets, strict=True):
                off = ((outline(photo, x[:3], x[3]) - at) * normal).sum(axis=1)
                rows.append(off[there] / noise)
            prior = (x - start) / sd if given else np.array([(x[2] - x[3]) / (0.02 * x[3])])
            # A place in the outline counts for a tenth: its neighbours err with it.
            return np.concatenate([*(r / math.sqrt(10) for r in rows), prior])

        found = least_squares(error, best, loss="soft_l1", x_scale=sd)
        best = found.x
    share = float(np.mean([there.mean() for *_, there in targets]))
    cov = np.linalg.pinv(found.jac.T @ found.jac)
    ball = Ball(best[:3], float(best[3]), np.sqrt(np.diag(cov)), share, given)
    for photo in photos:
        _check_seen(photo, ball.center, ball.radius)
    return ball


def _check_seen(photo: LinearPhoto, center: np.ndarray, radius: float) -> None:
    where = f"{photo.name}: ball {','.join(f'{x:.4g}' for x in (*center, radius))}"
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


def _edges(photo: LinearPhoto) -> np.ndarray:
    """(H, W, 2): the gradient of the photo's codes, of whichever channel changes most."""
    blurred = cv2.GaussianBlur(photo.pixels, (0, 0), 1.0).astype(np.float32)
    dx, dy = (cv2.Scharr(blurred, cv2.CV_32F, i, 1 - i) / 32 for i in (1, 0))
    most = (dx * dx + dy * dy).argmax(axis=-1)[..., None]
    return np.concatenate([np.take_along_axis(d, most, axis=-1) for d in (dx, dy)], axis=-1)


def _normals(rim: np.ndarray) -> np.ndarray:
    along = np.roll(rim, -1, axis=0) - np.roll(rim, 1, axis=0)
    n = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def _strength(grad: np.ndarray, rim: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """How strong an edge across `normal` is at each place; capped, so that no single edge decides."""
    across = np.abs((sample(grad, rim.reshape(-1, 2)).reshape(rim.shape) * normal).sum(axis=-1))
    return np.minimum(np.nan_to_num(across), 12.0)


def _searched(photos: list[LinearPhoto], grads: list[np.ndarray], start: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """The place and radius with most edge along the outlines, on finer and finer grids within some `sd` of `start`."""
    best, span = start.copy(), 3 * sd
    for _ in range(6):
        steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
        scores = []
        for x in best + steps * span:
            score = 0.0
            for photo, grad in zip(photos, grads, strict=True):
                rim = outline(photo, x[:3], max(x[3], 1e-6), 72)
                score += _strength(grad, rim, _normals(rim)).mean()
            scores.append(score - 0.2 * (((x - start) / sd) ** 2).sum())
        best = best + steps[int(np.argmax(scores))] * span
        span = span / 2
    return best


def _drawn(photo: LinearPhoto, grad: np.ndarray, x: np.ndarray, reach: float):
    """For each place of the outline the nearest strong edge across it: where, its normal, and whether there is one."""
    rim = outline(photo, x[:3], x[3])
    normal = _normals(rim)
    far = max(2.0, reach * width_px(photo, x[:3], x[3]) / 2)
    offsets = np.linspace(-far, far, 2 * int(4 * far) + 1)
    strength = _strength(grad, rim[:, None] + offsets[:, None] * normal[:, None], normal[:, None])
    weighed = strength * np.exp(-((offsets / far) ** 2))
    k = weighed.argmax(axis=1)
    there = strength[np.arange(len(rim)), k] > 2.5
    return rim + offsets[k, None] * normal, normal, there


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
    grad, eye, found = _edges(photo), np.array(photo.camera.eye), []
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
        on_edge = (_strength(grad, rim, _normals(rim)) > 2.5).mean()
        found.append((on_edge, center, radius))
    found.sort(key=lambda f: -f[0])
    apart: list[tuple] = []
    for score, center, radius in found:
        if score > EDGE_SHARE and all(np.linalg.norm(center - c) > max(radius, r) for c, r in apart):
            apart.append((center, radius))
    return apart[:most]
