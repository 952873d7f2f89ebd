"""The camera's pose from a flat board: s (x, y, 1) = R p + t for points with z = 0, so (r₁ r₂ t) is a homography."""

from dataclasses import replace
from typing import Any

import numpy as np

from raytwin.scene.lens import distort, undone
from raytwin.teach.contract.stage import Arrays, Case, Stage, text_variants
from raytwin.tracer import undistort


def estimate_pose(K: Any, dist: Any, object_points: Any, image_points: Any) -> Any:
    """R (3, 3) and t (3,) of the homography: unit columns, the board before the camera, R the nearest rotation."""
    p, q = np.asarray(object_points, float), np.asarray(image_points, float)
    H = homography(p[:, :2], on_plane(K, dist, q))
    H = H / np.linalg.norm(H[:, :2], axis=0).mean() * np.sign(H[2, 2])
    U, _, V = np.linalg.svd(columns(H))
    R, t = U @ V, H[:, 2]
    return R, t


def refined(R: Any, t: Any, K: Any, dist: Any, object_points: Any, image_points: Any) -> Any:
    """The pose by least squares of the distance in the picture, as cv2.solvePnP finds it."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    def off(pose: np.ndarray) -> np.ndarray:
        x, y, z = (Rotation.from_rotvec(pose[:3]).apply(object_points) + pose[3:]).T
        seen = np.stack(distort(x / z, y / z, list(dist)), axis=-1)
        return (seen * np.diag(K)[:2] + K[:2, 2] - image_points).ravel()

    best = least_squares(off, [*Rotation.from_matrix(R).as_rotvec(), *t], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return Rotation.from_rotvec(best[:3]).as_matrix(), best[3:]


def on_plane(K: Any, dist: Any, q: Any) -> np.ndarray:
    """Where on the plane z = 1 pixels (N, 2) see: the lens undone."""
    xd, yd = ((q - K[:2, 2]) / np.diag(K)[:2]).T
    return np.stack(undistort(xd, yd, dist), axis=-1)


def columns(H: Any) -> np.ndarray:
    """(r₁ r₂ r₁ x r₂)."""
    return np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])])


def homography(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """H (3, 3) with q ~ H p, least squares of H's nine numbers; points are centred and scaled first (Hartley 1997)."""
    P, Q = scaling(p), scaling(q)
    (x, y, _), (u, v, _) = (M @ np.column_stack([a, np.ones(len(a))]).T for M, a in ((P, p), (Q, q)))
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = [[x, y, one, zero, zero, zero, -u * x, -u * y, -u], [zero, zero, zero, x, y, one, -v * x, -v * y, -v]]
    A = np.concatenate([np.stack(row, axis=1) for row in rows])
    return np.asarray(np.linalg.inv(Q) @ np.linalg.svd(A)[2][-1].reshape(3, 3) @ P)


def scaling(points: np.ndarray) -> np.ndarray:
    middle, size = points.mean(axis=0), points.std()
    return np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]])


def cases(seed: int) -> list[Case]:
    """Boards seen without noise, so that every correct method finds the same, the poses that made them."""
    rng = np.random.default_rng(seed)
    kinds: tuple[tuple[str, Any, tuple[int, int], float], ...] = (
        ("a pinhole", (0, 0, 0, 0, 0), (6, 4), 0.5),
        ("four points", (0, 0, 0, 0, 0), (2, 2), 0.6),
        ("a board that is almost faced", (0, 0, 0, 0, 0), (5, 4), 0.12),
        ("radial distortion", (-0.15, 0.06, 0, 0, 0), (6, 5), 0.5),
        ("all five coefficients", (-0.12, 0.05, 0.004, -0.003, 0.02), (6, 4), 0.45),
    )
    return [_case(*kind, rng) for kind in kinds]


def _case(shows: str, dist: Any, size: tuple[int, int], tilt: float, rng: np.random.Generator) -> Case:
    from scipy.spatial.transform import Rotation

    columns, rows = size
    f = rng.uniform(350, 420)
    K = np.array([[f, 0, rng.uniform(290, 310)], [0, f * rng.uniform(1.02, 1.05), rng.uniform(255, 275)], [0, 0, 1]])
    dist = np.array(dist, float) * rng.uniform(0.8, 1.2, 5)
    while True:
        x, y = np.meshgrid(np.arange(columns) * 0.18 / (columns - 1), np.arange(rows) * 0.13 / (rows - 1))
        points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=-1)
        turned = Rotation.from_rotvec(tilt * rng.uniform(0.8, 1.2) * _direction(rng))
        # The board's z comes out of its face, towards the camera: half a turn about x.
        R = (turned * Rotation.from_euler("xz", [np.pi, rng.uniform(-1.2, -0.4)])).as_matrix()
        t = -R @ [0.09, 0.065, 0] + np.append(rng.uniform(-0.02, 0.02, 2), rng.uniform(0.26, 0.32))
        p = points @ R.T + t
        x, y = distort(p[:, 0] / p[:, 2], p[:, 1] / p[:, 2], dist.tolist())
        u, v = K[0, 0] * x + K[0, 2], K[1, 1] * y + K[1, 2]
        within = u.min() > 0 and u.max() < 640 and v.min() > 0 and v.max() < 480
        if within and not undone(K, dist.tolist(), (640, 480)).fault:
            return Case(shows, (K, dist, points, np.stack([u, v], axis=-1)), (R, t))


def _direction(rng: np.random.Generator) -> np.ndarray:
    """In the image's plane, off its axes."""
    angle = rng.uniform(0.5, 1.0) + np.pi / 2 * rng.integers(4)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def errors(case: Case, got: Arrays) -> np.ndarray:
    """By entry of R, |R - R₀|; and |t - t₀| / |t₀|, infinity where R is none."""
    R, t = got[0], got[1].reshape(3)
    off = np.linalg.norm(t - case.expected[1]) / np.linalg.norm(case.expected[1])
    return np.append(np.abs(R - case.expected[0]).ravel(), off)


HINTS: dict[Any, str] = {
    1: "return R and t, not one matrix",
    3: "cv2.solvePnP's first value tells whether it succeeded: return R, t alone",
    (3,): "R is a rotation vector: cv2.Rodrigues(rvec)[0] is the matrix",
    (3, 1): "R is a rotation vector: cv2.Rodrigues(rvec)[0] is the matrix",
}

REFINED = "    return R, t", "    R, t = refined(R, t, K, dist, object_points, image_points)\n    return R, t"
"""Both forms agree, but of a mistaken input each makes another pose."""
BY_CHANCE = {"board behind the camera"}
"""A homography's sign is that of whatever computes it."""

STAGE = Stage(
    estimate_pose,
    ("R", "t"),
    cases,
    errors,
    2e-4,
    "of an entry of R, or of |t|",
    tuple(replace(v, sometimes=v.name in BY_CHANCE) for v in text_variants(estimate_pose)),
    text_variants(estimate_pose, *REFINED),
    columns=True,
    hints=HINTS,
)
