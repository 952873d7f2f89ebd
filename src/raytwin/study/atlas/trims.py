"""Which pixels can see a sphere: the paper's box of eight corners beside the conic's, as spheres come near, and aside.

A sphere that crosses the camera's plane has a hyperbola for its outline, which reaches to infinity; a box round
projected points is finite.
"""

from math import acos, atan, degrees, pi, sin

import numpy as np

from raytwin.fast import corner_box, trim_boxes
from raytwin.scene import Camera, Sphere
from raytwin.study.atlas.experiment import Error, Experiment
from raytwin.tracer import STAGES

WIDTH, HEIGHT = 32, 24
WIDE_FOCAL_LENGTH = 0.25
"""The focal length of a view of 127 degrees, in widths."""

CHUNK = 2000
"""Spheres boxed at a time: bounds the memory."""
IDENTITY = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def camera_of(focal: float, dist: tuple[float, ...] = ()) -> Camera:
    """`focal` in widths of the frame."""
    f = focal * WIDTH
    K = ((f, 0.0, (WIDTH - 1) / 2), (0.0, f, (HEIGHT - 1) / 2), (0.0, 0.0, 1.0))
    return Camera((WIDTH, HEIGHT), K, IDENTITY, (0.0, 0.0, 0.0), dist)


def cut(camera: Camera, centers: np.ndarray, radii: np.ndarray) -> dict[str, Error]:
    """Return the share of pixels whose rays meet the spheres (n, 3), (n,) but lie outside each sphere's box."""
    u, v = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
    d = np.stack([a.ravel() for a in STAGES.back_project(u, v, camera)])
    ways: dict[str, list[int]] = {"eight corners": [], "conic: raytwin": []}
    seen = 0
    for start in range(0, len(radii), CHUNK):
        c, r = centers[start : start + CHUNK], radii[start : start + CHUNK]
        balls = [Sphere((x, y, z), radius) for (x, y, z), radius in zip(c.tolist(), r.tolist(), strict=True)]
        along, away = c @ d, (c * c).sum(axis=1)[:, None]
        # Rays within rounding of the outline do not count.
        meets = (away - along * along < (r * r)[:, None] * (1 - 1e-9)) & ((along > 0) | (away < (r * r)[:, None]))
        seen += int(meets.sum())
        boxes = {"eight corners": [corner_box(b, camera) for b in balls], "conic: raytwin": trim_boxes(balls, camera)}
        for name, found in boxes.items():
            x0, y0, x1, y1 = np.array(found).T[..., None]
            inside = (x0 <= u.ravel()) & (u.ravel() < x1) & (y0 <= v.ravel()) & (v.ravel() < y1)
            ways[name].append(int((meets & ~inside).sum()))
    return {name: sum(found) / max(seen, 1) for name, found in ways.items()}


RADIUS = 0.5
"""Radius of the sphere that moves aside, in units of its distance from the eye."""


def aside(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Spheres whose centres lie x degrees off the axis, in any direction, under a view of 127 degrees."""
    turn = 2 * np.pi * rng.random(n)
    a = np.radians(x)
    centers = np.stack([np.sin(a) * np.cos(turn), np.sin(a) * np.sin(turn), np.full(n, np.cos(a))], axis=1)
    size = 10 ** rng.uniform(-2, 2, n)
    return cut(camera_of(WIDE_FOCAL_LENGTH), centers * size[:, None], RADIUS * size)


def near(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Spheres of radius 1 with their centres at the distance x, in any direction before or behind the eye."""
    w = rng.normal(size=(n, 3))
    return cut(camera_of(WIDE_FOCAL_LENGTH), x * w / np.linalg.norm(w, axis=1, keepdims=True), np.ones(n))


SHARE = "share of visible pixels cut away"
ZISSERMAN = "Hartley and Zisserman, Multiple View Geometry (2004), ch. 8"
OURS = ("conic: raytwin",)
CROSSING = degrees(acos(RADIUS))
"""Off the axis so far, the sphere touches the camera's plane."""

NEAREST = 1 / sin((pi / 2 - atan(0.5 / WIDE_FOCAL_LENGTH)) / 2)
"""A sphere this near can touch the camera's plane and the frame's side at once."""

EXPERIMENTS = (
    Experiment(
        "trim-aside", "The box round a sphere that moves aside", "angle off the axis, degrees", SHARE, 1e-3,
        (10.0, 20.0, 30.0, 40.0, 50.0, 55.0, 60.0, 65.0, 70.0, 75.0, 80.0, 85.0), aside, OURS,
        "At acos(r / d) off the axis the sphere crosses the camera's plane: its outline reaches to infinity, and a box "
        "round the projections of eight points is finite, so visible pixels are cut. The conic's tangents are angles, "
        "which stay right whatever lies behind.",
        ZISSERMAN, {"eight corners": lambda x: 0.05 * (x > CROSSING)}, slack=1.1, trials=300,
    ),
    Experiment(
        "trim-near", "The box round a sphere that comes near", "distance of its centre / radius", SHARE, 1e-3,
        (20.0, 10.0, 6.0, 4.0, 3.0, 2.0, 1.4, 1.1, 0.9, 0.5, 0.2, 0.1), near, OURS,
        "A near sphere crosses the camera's plane and the frame's side at once, and a camera within it sees nothing "
        "else. The eight corners are then projected through the eye, some to the wrong side, and what they leave out "
        "is wrongly cut.",
        ZISSERMAN, {"eight corners": lambda x: 0.05 * (x < NEAREST)}, slack=2, trials=300,
    ),
)  # fmt: skip
