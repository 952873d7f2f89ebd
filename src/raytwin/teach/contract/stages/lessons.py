"""The functions of the walk's lessons that no submission need define."""

from typing import Any

import numpy as np

from raytwin.teach.contract.stage import Arrays, Case, Stage, text_variants, unit


def tag_centers(corners: Any) -> Any:
    """The images (N, 2) of the tags' centres, in OpenCV's pixels: (0, 0) is the centre of the top-left pixel."""
    a, b, c, d = np.moveaxis(np.asarray(corners, float), 1, 0)
    return _crossing(a, c, b, d) - 0.5


def _crossing(a: Any, c: Any, b: Any, d: Any) -> Any:
    """A line through two points is their cross product, and so is the point where two lines cross."""
    a, b, c, d = (np.concatenate([p, np.ones((len(p), 1))], axis=1) for p in (a, b, c, d))
    x, y, w = np.cross(np.cross(a, c), np.cross(b, d)).T
    return np.stack([x / w, y / w], axis=-1)


def _tag_cases(seed: int) -> list[Case]:
    """Tags of some 40 pixels, seen head on and from the side."""
    rng = np.random.default_rng(seed)
    square = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    made = []
    for shows, lean in (("tags seen head on", 0.0), ("tags seen from the side", 0.35)):
        turn = rng.uniform(0, 2 * np.pi, 12)
        away = lean * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        scale = 1 / (1 + square @ away.T).T[..., None]  # (12, 4, 1): farther corners are nearer to the middle
        corners = rng.uniform(100, 500, (12, 1, 2)) + rng.uniform(15, 30, (12, 1, 1)) * square * scale
        made.append(Case(shows, (corners,), (tag_centers(corners),)))
    return made


def intrinsics(homographies: Any) -> Any:
    """K (3, 3) of the camera that took all views (Zhang, "A Flexible New Technique for Camera Calibration", 2000)."""
    H = np.asarray(homographies, float)
    B11, B22, B13, B23, B33 = _solved(H)
    cx, cy = -B13 / B11, -B23 / B22
    s = B33 + cx * B13 + cy * B23
    with np.errstate(all="ignore"):
        fx, fy = np.sqrt(s / B11), np.sqrt(s / B22)
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _solved(H: np.ndarray) -> np.ndarray:
    """(B11, B22, B13, B23, B33); B12 is 0 without skew. In pixels scaled to about 1, for the rows' sake."""
    T = np.diag([1e-3, 1e-3, 1.0])
    H = T @ H
    H = H / np.linalg.norm(H, axis=(1, 2), keepdims=True)

    def row(i: int, j: int) -> np.ndarray:
        a, b = H[:, :, i].T, H[:, :, j].T
        return np.stack(
            [a[0] * b[0], a[1] * b[1], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1], a[2] * b[2]], 1
        )

    V = np.concatenate([row(0, 1), row(0, 0) - row(1, 1)])
    return np.asarray(np.linalg.svd(V)[2][-1] * [1e-6, 1e-6, 1e-3, 1e-3, 1])


def _intrinsics_cases(seed: int) -> list[Case]:
    """Views of a board by two cameras, from 20 to 45 degrees off its normal."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    made = []
    for shows, n in (("three views", 3), ("ten views", 10)):
        f, tilt, turn = rng.uniform(700, 900), rng.uniform(20, 45, n), rng.uniform(0, 360, n)
        K = np.array([[f, 0, rng.uniform(290, 350)], [0, 1.04 * f, rng.uniform(215, 265)], [0, 0, 1.0]])
        turn = np.linspace(0, 360, n, endpoint=False) + turn[0]
        R = (Rotation.from_euler("zx", np.stack([turn, 180 - tilt], 1), degrees=True)).as_matrix()
        t = np.stack([rng.uniform(-0.05, 0.05, n), rng.uniform(-0.05, 0.05, n), rng.uniform(0.4, 0.7, n)], 1)
        H = K @ np.stack([R[:, :, 0], R[:, :, 1], t], axis=-1) * rng.uniform(0.5, 2, (n, 1, 1))
        made.append(Case(shows, (H,), (K,)))
    return made


def sun_visible(points: Any, to_light: Any, centers: Any, radii: Any) -> Any:
    """1 where the sun is seen from a point, 0 where a sphere is in the way: (N,)."""
    f = np.asarray(centers)[None] - np.asarray(points)[:, None]
    along = f @ np.asarray(to_light)
    square = np.asarray(radii) ** 2 - (f**2).sum(-1) + along**2
    own = np.abs(np.linalg.norm(f, axis=-1) / np.asarray(radii) - 1) < 1e-6
    ahead = along + np.sqrt(np.maximum(square, 0)) > 0
    blocked = (square > 0) & ahead & ~own
    return np.where(blocked.any(axis=1), 0.0, 1.0)


def _sun_cases(seed: int) -> list[Case]:
    """Points on a floor and on the spheres above it, none near a shadow's edge."""
    rng = np.random.default_rng(seed)
    to_light = unit(rng.uniform([0.3, 0.2, 0.8], [0.5, 0.4, 1.0]))
    centers = np.array([[0.0, 0.0, 0.3], [0.5, 0.1, 0.25], [-0.4, 0.4, 0.5]]) + rng.uniform(-0.05, 0.05, (3, 3))
    centers[1] = centers[0] + 0.55 * to_light  # it shades the first, and what that shades
    radii = rng.uniform(0.12, 0.2, 3)
    balls = list(zip(centers, radii, strict=True))
    away = rng.uniform(1.2, 1.5, (3, 8, 1)) * to_light
    floor = rng.uniform(-1, 1, (60, 3)) * [1, 1, 0]
    on = [c + r * unit(rng.normal(size=(12, 3)) + 2 * to_light) for c, r in balls]
    behind, before = ([c + sign * r * a for (c, r), a in zip(balls, away, strict=True)] for sign in (-1, 1))
    drawn = {
        "points on a floor": floor,
        "points behind a sphere": np.concatenate(behind),
        "points before a sphere, on the sun's side": np.concatenate(before),
        "points on the spheres themselves": np.concatenate(on),
    }
    made = []
    for shows, points in drawn.items():
        args = (points[_sure(points, to_light, centers, radii)], to_light, centers, radii)
        made.append(Case(shows, args, (sun_visible(*args),)))
    return made


def _sure(points: np.ndarray, to_light: np.ndarray, centers: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Points whose ray to the sun passes no sphere within 3 % of its radius, but for the sphere that they are on."""
    f = centers - points[:, None]
    passes = np.linalg.norm(np.cross(f, to_light), axis=-1) / radii
    own = np.abs(np.linalg.norm(f, axis=-1) / radii - 1) < 1e-6
    return np.asarray((own | (np.abs(passes - 1) > 0.03)).all(axis=1))


def sky_visible(points: Any, normals: Any, centers: Any, radii: Any) -> Any:
    """The share (N,) of an even sky's light that reaches each surface element past the spheres (Quilez)."""
    f = np.asarray(centers)[None] - np.asarray(points)[:, None]
    d = np.linalg.norm(f, axis=-1)
    cosine = (f * np.asarray(normals)[:, None]).sum(-1) / d
    hidden = (np.asarray(radii) / d) ** 2 * np.maximum(cosine, 0)
    return np.asarray(1 - hidden.sum(axis=1))


def _sky_cases(seed: int) -> list[Case]:
    """Spheres wholly above the horizon, or wholly below it."""
    rng = np.random.default_rng(seed)
    ball = np.array([0.1, -0.1, 0.6]) + rng.uniform(-0.05, 0.05, 3), float(rng.uniform(0.15, 0.25))
    made = []
    for shows, side, centers, radii in (
        ("one sphere above a floor", 0.8, [ball[0]], [ball[1]]),
        ("two spheres", 0.12, [[-1.0, 0.2, 0.7], [0.9, 0.1, 0.8]], [0.3, 0.4]),
        ("a sphere below the horizon", 0.3, [[0.0, 0.0, -1.0]], [0.4]),
    ):
        points = rng.uniform(-side, side, (16, 3)) * [1, 1, 0]
        args = (points, np.tile([0.0, 0.0, 1.0], (16, 1)), np.array(centers), np.array(radii))
        made.append(Case(shows, args, (sky_visible(*args),)))
    tilted = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.25, 0.25, (16, 3))
    args = np.zeros((16, 3)), unit(tilted), np.array([[0.2, 0.1, 1.0]]), np.array([0.3])
    return [*made, Case("tilted surfaces", args, (sky_visible(*args),))]


def errors(case: Case, got: Arrays) -> np.ndarray:
    return np.asarray(np.abs(got[0] - case.expected[0]))


LESSON_STAGES = (
    Stage(tag_centers, ("centers",), _tag_cases, errors, 1e-3, "pixels", text_variants(tag_centers)),
    Stage(intrinsics, ("K",), _intrinsics_cases, errors, 0.05, "pixels", text_variants(intrinsics)),
    Stage(sun_visible, ("visible",), _sun_cases, errors, 1e-6, "of 1", text_variants(sun_visible)),
    Stage(sky_visible, ("share",), _sky_cases, errors, 1e-6, "of 1", text_variants(sky_visible)),
)
