"""The camera's pose from a flat board: s (x, y, 1) = R p + t for points with z = 0, so (r₁ r₂ t) is a homography."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from raytwin.scene.lens import distort, undone
from raytwin.teach.contract.stage import Arrays, Case, Function, Stage, Variant, before, instead
from raytwin.tracer import undistort


def estimate_pose(K: Any, dist: Any, object_points: Any, image_points: Any) -> Any:
    """R (3, 3) and t (3,), or (3, 1), with p_cam = R @ p_board + t.

    The camera frame is OpenCV's: x right, y down, z forward, so the board lies at z > 0.

    K: (3, 3), pixels. dist: (5,), k1, k2, p1, p2, k3.
    object_points: (N, 3), N >= 4, on the board, metres, in one plane: z = 0.
    image_points: (N, 2), where they are seen: u, v in pixels; (0, 0) is the centre of the top-left pixel. They are
        exact, without noise.
    """
    return _pose(K, dist, object_points, image_points)


def _pose(
    K: Any,
    dist: Any,
    object_points: Any,
    image_points: Any,
    compose: Any = None,
    in_pixels: bool = False,
) -> tuple[Any, Any]:
    """By the homography (`compose`: from that alone), then by least squares of the distance on the plane z = 1.

    `in_pixels`: least squares of the distance in the picture, lens and all, as cv2.solvePnP does it.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    p = np.asarray(object_points, float)
    f, c = np.diag(K)[:2], K[:2, 2]
    seen = _on_plane(K, dist, image_points)
    R, t = (compose or _normalised)(_homography(p[:, :2], seen))
    if compose:
        return R, t

    def off(pose: np.ndarray) -> np.ndarray:
        q = Rotation.from_rotvec(pose[:3]).apply(p) + pose[3:]
        x, y = (q[:, :2] / q[:, 2:]).T
        if not in_pixels:
            return (np.stack([x, y], axis=-1) - seen).ravel()
        return (np.stack(distort(x, y, list(dist)), axis=-1) * f + c - image_points).ravel()

    best = least_squares(off, [*Rotation.from_matrix(R).as_rotvec(), *t], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return Rotation.from_rotvec(best[:3]).as_matrix(), best[3:]


def _on_plane(K: Any, dist: Any, q: Any) -> np.ndarray:
    """Where on the plane z = 1 pixels (N, 2) see: the lens undone."""
    xd, yd = ((np.asarray(q) - K[:2, 2]) / np.diag(K)[:2]).T
    return np.stack(undistort(xd, yd, dist), axis=-1)


def _homography(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """H (3, 3) with q ~ H p, least squares of H's nine numbers; points are centred and scaled first (Hartley 1997)."""
    P, Q = _scaling(p), _scaling(q)
    (x, y, _), (u, v, _) = (M @ np.column_stack([a, np.ones(len(a))]).T for M, a in ((P, p), (Q, q)))
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = [[x, y, one, zero, zero, zero, -u * x, -u * y, -u], [zero, zero, zero, x, y, one, -v * x, -v * y, -v]]
    A = np.concatenate([np.stack(row, axis=1) for row in rows])
    return np.asarray(np.linalg.inv(Q) @ np.linalg.svd(A)[2][-1].reshape(3, 3) @ P)


def _scaling(points: np.ndarray) -> np.ndarray:
    middle, size = points.mean(axis=0), points.std()
    return np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]])


def _columns(r1: Any, r2: Any) -> np.ndarray:
    return np.column_stack([r1, r2, np.cross(r1, r2)])


def _normalised(H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(R, t) of H ~ (r₁ r₂ t): unit columns, the board before the camera, R the nearest rotation."""
    H = H / np.linalg.norm(H[:, :2], axis=0).mean() * np.sign(H[2, 2])
    U, _, V = np.linalg.svd(_columns(H[:, 0], H[:, 1]))
    return np.asarray(U @ V), H[:, 2]


CORRECT_FORMS: tuple[Function, ...] = (
    partial(_pose, in_pixels=True),
    partial(_pose, compose=_normalised),
)
"""cv2.solvePnP, and the homography alone: they agree, but of a mistaken input each makes another pose."""


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


# ------------------------------------------------------------------------------------------ typical mistakes


def _after(change: Callable[[Any, Any], tuple[Any, Any]]) -> Callable[[Function], Function]:
    return lambda f: lambda *args: change(*f(*args))


def _composed(compose: Callable[[np.ndarray], tuple[Any, Any]]) -> Callable[[Function], Function]:
    return lambda f: lambda K, dist, p, q: _pose(K, dist, p, q, compose)


def _by_corner(H: np.ndarray) -> tuple[Any, Any]:
    """H[2, 2] = 1, as cv2.findHomography has it, and t taken as it is; R made a rotation."""
    return _normalised(H)[0], H[:, 2] / H[2, 2]


def _unscaled(H: np.ndarray) -> tuple[Any, Any]:
    """t of the homography as it is found, of length 1, and R made a rotation."""
    return _normalised(H)[0], H[:, 2] * np.sign(H[2, 2]) / np.linalg.norm(H)


def _untouched(H: np.ndarray) -> tuple[Any, Any]:
    H = H / H[2, 2]
    return _columns(H[:, 0], H[:, 1]), H[:, 2]


def _behind(R: Any, t: Any) -> tuple[Any, Any]:
    return R * [-1, -1, 1], -t


def _by_other(K: Any, fx: int, fy: int, cx: int, cy: int) -> np.ndarray:
    """K of these entries of (fx, fy, cx, cy)."""
    numbers = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    return np.array([[numbers[fx], 0, numbers[cx]], [0, numbers[fy], numbers[cy]], [0, 0, 1]])


FLIP = np.diag([1.0, -1.0, -1.0])
INPUT_MISTAKES = (
    Variant("distortion-kept", "the distortion is not undone: dist is left out",
            before(lambda K, dist, p, q: (K, 0 * dist, p, q))),
    Variant("distortion-sign", "the distortion is undone with the wrong sign", before(lambda K, dist, p, q: (K,
            -dist, p, q))),
    Variant("tangential-left-out", "the tangential distortion p1, p2 is left out",
            before(lambda K, dist, p, q: (K, dist * [1, 1, 0, 0, 1], p, q))),
    Variant("coefficients-order", "the coefficients are read as k1, k2, k3, p1, p2: the order is k1, k2, p1, p2, k3",
            before(lambda K, dist, p, q: (K, dist[[0, 1, 3, 4, 2]], p, q))),
    Variant("half-pixel", "half a pixel is added to the image points: (0, 0) is the centre of the top-left pixel "
            "already",
            before(lambda K, dist, p, q: (K, dist, p, q + 0.5))),
    Variant("half-pixel", "half a pixel is taken off the image points: (0, 0) is the centre of the top-left pixel "
            "already",
            before(lambda K, dist, p, q: (K, dist, p, q - 0.5))),
    Variant("u and v swapped", "u and v of the image points are swapped: the column u comes first",
            before(lambda K, dist, p, q: (K, dist, p, q[:, ::-1]))),
    Variant("x and y swapped", "x and y of the board's points are swapped",
            before(lambda K, dist, p, q: (K, dist, p[:, [1, 0, 2]], q))),
    Variant("board turned over", "the board's y points the other way", before(lambda K, dist, p, q: (K, dist,
            p * [1, -1, 1], q))),
    Variant("origin in the board's middle", "the board's points are centred first, and t is that of their mean: t "
            "belongs "
            "to the origin (0, 0, 0) of object_points", before(lambda K, dist, p, q: (K, dist, p - p.mean(axis=0),
            q))),
    Variant("K left out", "K is left out: points on the plane z = 1 are ((u - cx) / fx, (v - cy) / fy), pixels are not",
            before(lambda K, dist, p, q: (np.eye(3), 0 * dist, p, q))),
    Variant("undistorted twice", "the distortion is undone twice: once in the points, once by what they are given to",
            before(lambda K, dist, p, q: (K, dist, p, _on_plane(K, dist, q) * np.diag(K)[:2] + K[:2, 2]))),
    *(Variant(name, sentence, before(lambda K, dist, p, q, of=of: (_by_other(K, *of), dist, p, q)))
      for name, sentence, of in (
          ("one focal length", "fx is used for both axes: v is divided by fy = K[1, 1]", (0, 0, 2, 3)),
          ("one focal length", "fy is used for both axes: u is divided by fx = K[0, 0]", (1, 1, 2, 3)),
          ("swapped-focal", "fx and fy are swapped: u goes with fx, v with fy", (1, 0, 2, 3)),
          ("swapped-centre", "cx and cy are swapped: u goes with cx, v with cy", (0, 1, 3, 2)),
          ("swapped-centre", "cx is used for both axes: v goes with cy = K[1, 2]", (0, 1, 2, 2)),
          ("swapped-centre", "cy is used for both axes: u goes with cx = K[0, 2]", (0, 1, 3, 3)))),
)  # fmt: skip
"""The correct function, given something else."""

RESULT_MISTAKES = (
    Variant("transposed R", "R is transposed: p_cam = R @ p_board + t", _after(lambda R, t: (R.T, t))),
    Variant("inverse pose", "the inverse pose is returned, the camera's in the board's frame: p_cam = R @ p_board + t "
            "is "
            "wanted, so return R.T and -R.T @ t of what you have", _after(lambda R, t: (R.T, -R.T @ t))),
    Variant("eye for t", "t is the camera's place in the board's frame, -R.T @ t: wanted is the board's origin in the "
            "camera's frame", _after(lambda R, t: (R, -R.T @ t))),
    Variant("sign of t", "t has the wrong sign", _after(lambda R, t: (R, -t))),
    Variant("board behind the camera", "the board is behind the camera: a homography is known up to its sign, take the "
            "one with t[2] > 0", _after(_behind), sometimes=True),
    Variant("t not scaled", "t is not to scale: divide the homography by the length of its first columns, which are r1 "
            "and r2, not by H[2, 2]", _composed(_by_corner)),
    Variant("t not scaled", "t is not to scale: divide it, too, by the length of the homography's first columns, which "
            "are r1 and r2", _composed(_unscaled)),
    Variant("homography not scaled", "R and t are not to scale: divide the homography by the length of its first "
            "columns, so that R is a rotation", _composed(_untouched)),
    Variant("third column", "R's third column has the wrong sign: it is r1 x r2, so that det R = 1",
            _after(lambda R, t: (R * [1, 1, -1], t))),
    Variant("y up", "y points up: in the camera frame y points down, as rows do",
            _after(lambda R, t: (np.diag([1, -1, 1]) @ R, np.diag([1, -1, 1]) @ t))),
    Variant("OpenGL's frame", "the pose is that of OpenGL's camera, y up and z backwards: here y points down and z "
            "forward",
            _after(lambda R, t: (FLIP @ R, FLIP @ t))),
)  # fmt: skip

HINTS: dict[Any, str] = {
    1: "return R and t, not one matrix",
    3: "cv2.solvePnP's first value tells whether it succeeded: return R, t alone",
    (3,): "R is a rotation vector: cv2.Rodrigues(rvec)[0] is the matrix",
    (3, 1): "R is a rotation vector: cv2.Rodrigues(rvec)[0] is the matrix",
}

STAGE = Stage(
    estimate_pose,
    ("R", "t"),
    cases,
    errors,
    2e-4,
    "of an entry of R, or of |t|",
    INPUT_MISTAKES + RESULT_MISTAKES,
    tuple(Variant(v.name, v.sentence, instead(v.change(form))) for v in INPUT_MISTAKES for form in CORRECT_FORMS),
    columns=True,
    hints=HINTS,
)
