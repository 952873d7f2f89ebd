"""Tags of a board, seen from many sides -> K, distortion, poses and the board's shape: min Σ |project(board) - tag|².

OpenCV's first fit gives the start; from there it is Gauss-Newton with Marquardt's damping, where every view's six
numbers of pose are eliminated first. With A = d residuals / d shared, B = d residuals / d pose of the view i (Schur
complement),

    H_i = A^T A - A^T B (B^T B)^-1 B^T A,  g_i = A^T r - A^T B (B^T B)^-1 B^T r

are all that the view says about the numbers that the views share; the fit, its covariance and the fit without any one
photo (`uncertainty`) are sums of them. A pose moves by a turn omega and a shift tau of the camera's frame:
p' = p + omega x p + tau.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from raytwin.calib.boards import Board, Heights
from raytwin.calib.boards.shape import DEGREES, Bending, bending, count
from raytwin.calib.photos import lens_model
from raytwin.calib.photos.detection import Tag
from raytwin.errors import InputError
from raytwin.scene import Record

INTRINSICS = ("fx", "fy", "cx", "cy")

MODELS: dict[str, tuple[str, ...]] = {
    "none": (),
    "k1": ("k1",),
    "k1k2": ("k1", "k2"),
    "k1k2p1p2": ("k1", "k2", "p1", "p2"),
    "k1k2k3": ("k1", "k2", "k3"),
    "full5": lens_model.NAMES,
}
"""The coefficients that each model fits; the others are 0. To add one: a row here (OpenCV's five are all there are)."""

START = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-6)
STEPS, SETTLED = 100, 1e-10
"""Most steps; the fit has converged once a step is predicted to lower the sum of squares by less than this fraction."""


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV on one thread meanwhile: on several it adds up in any order, and no two fits end in the same bits."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


class Sighting(Record, frozen=True):
    """The board's tags in one photo, none of them unknown to the board; internal to the fit."""

    photo: str
    tags: tuple[Tag, ...]


@dataclass(frozen=True)
class ModelSpec:
    """What is fitted besides K and poses: a row of MODELS, the degree of the board's heights (0: flat), and whether a
    stretch of the board's y is free."""

    model: str
    degree: int = 0
    stretch: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters of K and distortion, in the order of `Fit.shared`."""
        return (*INTRINSICS, *MODELS[self.model])

    def camera(self, shared: np.ndarray) -> tuple[np.ndarray, tuple[float, ...]]:
        """K and k1, k2, p1, p2, k3 from the parameters; a coefficient that is not fitted is 0."""
        fx, fy, cx, cy = shared[:4]
        value = dict(zip(MODELS[self.model], shared[4:].tolist(), strict=False))
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), tuple(value.get(name, 0.0) for name in lens_model.NAMES)


@dataclass(frozen=True, eq=False)
class Observations:
    """What v views saw, a row each, padded to the most tags t that any has.

    `points` (v, t, 3) metres on the flat board; `pixels` (v, t, 2); `weight` (v, t): 1, or 0 where padded; `rows` (v,
    t): the tag's place in the board's list; `middle_y`: the mean y of the board's centres, metres.
    """

    points: np.ndarray
    pixels: np.ndarray
    weight: np.ndarray
    rows: np.ndarray
    bending: Bending | None
    middle_y: float
    image_size: tuple[int, int]

    def count(self) -> int:
        """Coordinates seen."""
        return 2 * int(self.weight.sum())


@dataclass(frozen=True, eq=False)
class Step:
    """The fit at one place: `shared` (m,) is fx, fy, cx, cy, the coefficients of `form`, then the board's shape.

    R (v, 3, 3), t (v, 3): the poses. `residuals` (v, t, 2): projected minus seen, pixels; `A` (v, 2 t, m), `B` (v, 2 t,
    6): see above. `cost`: the sum of squares.
    """

    form: ModelSpec
    observations: Observations
    shared: np.ndarray
    R: np.ndarray
    t: np.ndarray
    residuals: np.ndarray
    A: np.ndarray
    B: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class Fit(Step):
    """What the optimizer gives: where it settled, and `H` (v, m, m), `g` (v, m), see above. `follow` (v, 6, m): d pose
    by d shared; `local` (v, 6, 6): (B^T B)^-1."""

    H: np.ndarray
    g: np.ndarray
    follow: np.ndarray
    local: np.ndarray

    @property
    def K(self) -> np.ndarray:
        return self.form.camera(self.shared)[0]

    @property
    def dist(self) -> tuple[float, ...]:
        known = max((lens_model.NAMES.index(name) + 1 for name in MODELS[self.form.model]), default=0)
        return self.form.camera(self.shared)[1][:known]

    @property
    def poses(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        return tuple(zip(self.R, self.t, strict=True))

    @property
    def rms_px(self) -> float:
        return float(np.sqrt((self.residuals**2).sum() / self.observations.weight.sum()))

    @property
    def variance(self) -> float:
        """Variance of a coordinate, pixels², of independent errors: residuals² / (coordinates - unknowns)."""
        unknowns = 6 * len(self.R) + self.determined
        return float((self.residuals**2).sum() / max(self.observations.count() - unknowns, 1))

    @property
    def determined(self) -> int:
        """Number of shared parameters that the tags determine: few rows do not determine every term of a shape."""
        return int((np.diag(self.H.sum(axis=0)) > 0).sum())

    @property
    def shape(self) -> Heights | None:
        """The board's fitted shape; None for a board taken as flat and of the described pitch."""
        if not (self.form.degree or self.form.stretch):
            return None
        c, stretch = _shape_of(self.shared, self.form)
        flat = (0.0,) * count(DEGREES[0])
        return Heights(self.form.degree or DEGREES[0], tuple(c.tolist()) or flat, stretch)


def fit(
    views: Sequence[Sighting],
    image_size: tuple[int, int],
    board: Board,
    form: ModelSpec,
    start: Fit | None = None,
) -> Fit:
    """The camera, poses and the shape of least squared pixel distance; from `start`, a fit of the same views, where
    given."""
    seen = _observe(views, image_size, board, form)
    if start is None or len(start.R) != len(views):
        K, dist, R, t = _first(views, image_size, board)
    else:
        K, dist, R, t = start.K, start.dist, start.R, start.t
    value = dict(zip(lens_model.NAMES, dist, strict=False))
    shared = np.zeros(4 + len(MODELS[form.model]) + _shape_count(form))
    shared[: len(form.names)] = K[0, 0], K[1, 1], K[0, 2], K[1, 2], *(value.get(n, 0.0) for n in MODELS[form.model])
    if start is not None and (start.form.degree, start.form.stretch) == (form.degree, form.stretch):
        shared[len(form.names) :] = start.shared[len(start.form.names) :]
    try:
        found = _settle(_step(form, seen, shared, R, t))
    except np.linalg.LinAlgError:
        raise InputError("views", "photos from which a camera follows", "tags that contradict each other") from None
    if not (np.isfinite(found.shared).all() and (found.shared[:2] > 0).all()):
        fx, fy = found.shared[:2]
        raise InputError("views", "photos from which a camera follows", f"fx, fy = {fx:.4g}, {fy:.4g}")
    return found


def matched(tags: Sequence[Tag], board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Board points (n, 3), metres, and pixels (n, 2) of tags that all are on the board."""
    return board.points(t.id for t in tags), np.array([t.center for t in tags]).reshape(-1, 2)


def _first(
    views: Sequence[Sighting], image_size: tuple[int, int], board: Board
) -> tuple[np.ndarray, tuple[float, ...], np.ndarray, np.ndarray]:
    """K, distortion and poses of the flat board, by OpenCV: Zhang's closed form, and steps from there."""
    both = [matched(v.tags, board.flat()) for v in views]
    points, pixels = ([one.astype(np.float32) for one in side] for side in zip(*both, strict=True))
    flags = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    try:
        with one_thread():
            _, K, dist, turns, shifts = cv2.calibrateCamera(
                points, pixels, image_size, None, None, flags=flags, criteria=START
            )
    except cv2.error as error:
        raise InputError("views", "photos from which a camera follows", error.err or "none") from None
    R = np.array([cv2.Rodrigues(turn)[0] for turn in turns])
    t = np.array([shift.ravel() for shift in shifts])
    if not (np.isfinite(K).all() and np.isfinite(dist).all() and K[0, 0] > 0 and K[1, 1] > 0):
        raise InputError("views", "photos from which a camera follows", f"fx, fy = {K[0, 0]:.4g}, {K[1, 1]:.4g}")
    return K, tuple(dist.ravel()[:5].tolist()), R, t


def _observe(views: Sequence[Sighting], image_size: tuple[int, int], board: Board, form: ModelSpec) -> Observations:
    most = max(len(v.tags) for v in views)
    points, pixels = np.zeros((len(views), most, 3)), np.zeros((len(views), most, 2))
    weight, rows = np.zeros((len(views), most)), np.zeros((len(views), most), int)
    flat, centers = board.flat(), board.centers()
    place = {tag: i for i, tag in enumerate(centers)}
    for i, view in enumerate(views):
        n = len(view.tags)
        points[i, :n], pixels[i, :n] = matched(view.tags, flat)
        points[i, n:] = points[i, 0]  # in front of the camera wherever the others are
        weight[i, :n] = 1
        rows[i, :n] = [place[tag.id] for tag in view.tags]
    middle_y = float(np.mean([y for _, y in centers.values()]))
    bent = bending(tuple(centers.values()), form.degree) if form.degree else None
    return Observations(points, pixels, weight, rows, bent, middle_y, image_size)


def _shape_count(form: ModelSpec) -> int:
    return count(form.degree) + form.stretch


def _shape_of(shared: np.ndarray, form: ModelSpec) -> tuple[np.ndarray, float]:
    """The coefficients of the board's heights, and the stretch of its y, which is the last parameter."""
    at = len(form.names)
    return shared[at : at + count(form.degree)], float(shared[-1]) if form.stretch else 0.0


def _shaped(seen: Observations, form: ModelSpec, shared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The board's points with its shape (v, t, 3), and how they move with its numbers (v, t, s, 3), metres."""
    points = seen.points.copy()
    moves = np.zeros((*points.shape[:2], _shape_count(form), 3))
    c, stretch = _shape_of(shared, form)
    if seen.bending is not None:
        points += seen.bending.move(c)[seen.rows]
        moves[:, :, : len(c)] = seen.bending.moves(c)[seen.rows]
    if form.stretch:
        along = seen.points[..., 1] - seen.middle_y
        points[..., 1] += stretch * along
        moves[:, :, -1, 1] = along
    return points, moves


def _step(form: ModelSpec, seen: Observations, shared: np.ndarray, R: np.ndarray, t: np.ndarray) -> Step:
    K, dist = form.camera(shared)
    board, moves = _shaped(seen, form, shared)
    points = board @ R.swapaxes(1, 2) + t[:, None]
    with np.errstate(all="ignore"):  # a step too far gives no finite cost, and is not taken
        r, A, of_point = lens_model.linearise(points, seen.pixels, K, dist, MODELS[form.model])
        A = np.concatenate([A, np.einsum("vtci,vij,vtsj->vtcs", of_point, R, moves, optimize=True)], axis=-1)
        w = seen.weight[..., None]
        r, A, B = r * w, A * w[..., None], lens_model.of_pose(points, of_point) * w[..., None]
        cost = float((r * r).sum())
    if not np.isfinite(cost) or (points[..., 2] <= 0).any():
        cost = np.inf
    v, n, _ = r.shape
    return Step(form, seen, shared, R, t, r, A.reshape(v, 2 * n, -1), B.reshape(v, 2 * n, 6), cost)


def _moved(here: Step, d_shared: np.ndarray, d_poses: np.ndarray) -> Step:
    turn = np.array([cv2.Rodrigues(turned)[0] for turned in d_poses[:, :3]])
    t = (turn @ here.t[..., None])[..., 0] + d_poses[:, 3:]
    return _step(here.form, here.observations, here.shared + d_shared, turn @ here.R, t)


def _settle(here: Step) -> Fit:
    """Gauss-Newton, damped after Marquardt where a step would make it worse."""
    damping = 1e-6
    for _ in range(STEPS):
        d_shared, d_poses, promised = _solve(here, damping)
        if promised <= SETTLED * here.cost:
            break
        there = _moved(here, d_shared, d_poses)
        for _ in range(2):
            # Where views barely separate two parameters, the poses follow them along a curved valley: let them catch
            # up.
            if not (np.isfinite(there.cost) and here.cost - there.cost < promised / 2):
                break
            Bt = there.B.swapaxes(1, 2)
            catch_up = -np.linalg.solve(Bt @ there.B, Bt @ _column(there))[..., 0]
            there = _moved(there, np.zeros(len(there.shared)), catch_up)
        if there.cost <= here.cost:
            here, damping = there, max(damping / 10, 1e-12)
        elif damping > 1e9:
            break
        else:
            damping = max(damping, 1e-6) * 10
    AB, BB = here.A.swapaxes(1, 2) @ here.B, here.B.swapaxes(1, 2) @ here.B
    local = np.linalg.inv(BB)
    r = _column(here)
    follow = -local @ AB.swapaxes(1, 2)
    H = here.A.swapaxes(1, 2) @ here.A + AB @ follow
    g = (here.A.swapaxes(1, 2) @ r + follow.swapaxes(1, 2) @ (here.B.swapaxes(1, 2) @ r))[..., 0]
    return Fit(**vars(here), H=H, g=g, follow=follow, local=local)


def _column(here: Step) -> np.ndarray:
    """(v, 2 t, 1): the residuals, by view."""
    return here.residuals.reshape(len(here.R), -1, 1)


def _solve(here: Step, damping: float) -> tuple[np.ndarray, np.ndarray, float]:
    """The step of the shared numbers (m,) and of the poses (v, 6), and by how much it should lessen the squares."""
    A, B, r = here.A, here.B, _column(here)
    At, Bt = A.swapaxes(1, 2), B.swapaxes(1, 2)
    AB, BB, Br = At @ B, Bt @ B, Bt @ r
    inverse = np.linalg.inv(BB * (1 + damping * np.eye(6)))
    U, rhs = (At @ A).sum(axis=0), (At @ r).sum(axis=0)[:, 0]
    S = U * (1 + damping * np.eye(len(U))) - (AB @ inverse @ AB.swapaxes(1, 2)).sum(axis=0)
    right = rhs - (AB @ inverse @ Br).sum(axis=0)[:, 0]
    d = -solve_scaled(S, right)
    poses = -(inverse @ (Br + AB.swapaxes(1, 2) @ d[:, None]))[..., 0]
    promised = -float(d @ rhs + (poses * Br[..., 0]).sum())
    return d, poses, promised


def solve_scaled(S: np.ndarray, right: np.ndarray) -> np.ndarray:
    """S^-1 right for a positive S; pixels, coefficients and metres differ by orders of magnitude: its diagonal is made
    1.

    Parameters that S does not determine stay 0.
    """
    size = np.diag(S)
    scale = np.where(size > 0, 1 / np.sqrt(np.where(size > 0, size, 1)), 0)
    inverse = np.linalg.pinv(S * np.outer(scale, scale), rcond=1e-13, hermitian=True)
    return (scale * (inverse @ (scale * right.T).T).T).T
