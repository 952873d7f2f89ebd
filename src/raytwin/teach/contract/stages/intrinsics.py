"""K from a board's homographies: Zhang, "A Flexible New Technique for Camera Calibration", PAMI 22(11), 2000."""

from typing import Any

import numpy as np

from raytwin.teach.contract.stage import Arrays, Case, Stage, text_variants


def intrinsics(homographies: Any) -> Any:
    """K (3, 3), [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, of the camera that took all views."""
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


def cases(seed: int) -> list[Case]:
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


def errors(case: Case, got: Arrays) -> np.ndarray:
    """|K - K₀| by fx₀."""
    return np.asarray(np.abs(got[0] - case.expected[0]) / case.expected[0][0, 0])


STAGE = Stage(intrinsics, ("K",), cases, errors, 1e-4, "of fx", text_variants(intrinsics))
