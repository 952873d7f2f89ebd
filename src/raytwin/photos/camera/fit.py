"""Tags of a board, seen from many sides -> K, distortion, poses and the tags' places on the board.

    min Σ |project(board) - tag|² + Σ (noise offset / PRIOR_METRES)²

`offset` is how far a tag's centre lies from its place on the sheet: no sheet of paper is flat, no print exact. Of a
board taken for flat, all are 0. OpenCV gives the start; from there it is Gauss-Newton with Marquardt's damping. With
A = d residuals / d shared numbers and B = d residuals / d pose of one view, the pose is eliminated first (Schur
complement): what no pose explains of A and of the residuals r is

    A' = A - B B⁺ A,  r' = r - B B⁺ r,  H = Σ A'^T A' + prior,  g = Σ A'^T r' + prior shared.

The fit, its covariance and the fit without any one photo (`uncertainty`) are sums of these. A pose moves by a turn
omega and a shift tau of the camera's frame: p' = p + omega x p + tau.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from raytwin.errors import InputError
from raytwin.photos.boards import Board, Offsets
from raytwin.photos.camera import lens_model
from raytwin.photos.camera.detection import Tag
from raytwin.scene import Record

INTRINSICS = ("fx", "fy", "cx", "cy")

MODELS: dict[str, tuple[str, ...]] = {"none": (), "k1k2": ("k1", "k2"), "full5": lens_model.NAMES}
"""The coefficients that each lens model fits, smallest first: the first ones of OpenCV's. The others are 0."""

MAX_STEPS, SETTLED_SHARE = 100, 1e-10
"""Most steps; the fit has converged once a step is predicted to lower the sum of squares by less than this fraction."""

PRIOR_METRES = np.array([1e-5, 1e-5, 2e-3])
"""Metres, one standard deviation of a tag's offset before any photo: x, y as printers place ink, z as paper bends."""

IN_PLANE_METRES = 1e-6
"""Metres, the same of the heights' mean and tilt, which belong to the poses."""

NEIGHBOURS = 1.5
"""Tags at most this many times as far apart as the nearest two are neighbours: along rows, columns and diagonals."""

LEAST_NOISE_PX = 0.01
"""Pixels: what a tag's coordinate errs by at least when it is weighed against PRIOR_METRES."""

RIDGE_SHARE = 1e-12
"""Share of the diagonal that is added to it, so that what no photo determines does not move."""


class Sighting(Record, frozen=True):
    """The board's tags in one photo, none of them unknown to the board; internal to the fit."""

    photo: str
    tags: tuple[Tag, ...]


@dataclass(frozen=True)
class ModelSpec:
    """What is fitted besides K and poses: a row of MODELS, and whether the tags' offsets are free (`bent`)."""

    model: str
    bent: bool = False

    def __str__(self) -> str:
        return f"{self.model}, bent" if self.bent else self.model

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters of K and distortion, in the order of `Fit.shared`."""
        return (*INTRINSICS, *MODELS[self.model])

    def camera(self, shared: np.ndarray) -> tuple[np.ndarray, tuple[float, ...]]:
        """K and distortion."""
        fx, fy, cx, cy, *dist = shared[: len(self.names)].tolist()
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), tuple(dist)


@dataclass(frozen=True, eq=False)
class Observations:
    """What v views saw of the n tags `ids` that any of them shows.

    `points` (n, 3) metres: their places before any offset; `pixels` (v, n, 2); `seen` (v, n) bool. `prior` (m, m):
    weights of the squares of `Fit.shared`, 0 of K and distortion, PRIOR_METRES and IN_PLANE_METRES of offsets.
    """

    ids: tuple[int, ...]
    points: np.ndarray
    pixels: np.ndarray
    seen: np.ndarray
    prior: np.ndarray
    image_size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Fit:
    """The sum of squares, `cost`, and its derivatives at one place; that of least cost is what `fit` returns.

    `shared` (m,) is fx, fy, cx, cy, the coefficients of `form`, then the tags' offsets, if free. R (v, 3, 3), t (v, 3):
    the poses. `residuals` (v, n, 2): projected minus seen, pixels, 0 of tags not seen. `A` (v, 2n, m), `r` (v, 2n): A'
    and r' above. `inverse_B` (v, 6, 2n): B⁺; `follow` (v, 6, m): d best pose / d shared.
    """

    form: ModelSpec
    observations: Observations
    shared: np.ndarray
    R: np.ndarray
    t: np.ndarray
    residuals: np.ndarray
    A: np.ndarray
    r: np.ndarray
    inverse_B: np.ndarray
    follow: np.ndarray
    cost: float

    @cached_property
    def total(self) -> np.ndarray:
        """(m, m): H."""
        A = self.A.reshape(-1, len(self.shared))
        return np.asarray(A.T @ A + self.observations.prior)

    @cached_property
    def inverse(self) -> np.ndarray:
        """(m, m): of H."""
        return solve_scaled(self.total, np.eye(len(self.total)))

    @property
    def catch_up(self) -> np.ndarray:
        """(v, 6): how the poses must move to be the best where they are."""
        return -(self.inverse_B @ self.residuals.reshape(len(self.R), -1, 1))[..., 0]

    @property
    def lens(self) -> np.ndarray:
        """(9,): fx, fy, cx, cy, k1, k2, p1, p2, k3; those that are not fitted are 0."""
        return np.pad(self.shared[: len(self.form.names)], (0, 9 - len(self.form.names)))

    @property
    def K(self) -> np.ndarray:
        return self.form.camera(self.shared)[0]

    @property
    def dist(self) -> tuple[float, ...]:
        return self.form.camera(self.shared)[1]

    @property
    def rms_px(self) -> float:
        return float(np.sqrt((self.residuals**2).sum() / self.observations.seen.sum()))

    @property
    def variance(self) -> float:
        """Variance of a coordinate, pixels², of independent errors: residuals² / (coordinates - unknowns).

        What the prior determines of the offsets is no unknown: trace(H^-1 Σ A'^T A') of the shared numbers are.
        """
        unknowns = 6 * len(self.R) + len(self.shared) - (self.observations.prior * self.inverse).sum()
        return float((self.residuals**2).sum() / max(2 * self.observations.seen.sum() - unknowns, 1.0))

    @property
    def free(self) -> np.ndarray:
        """(n, 3) metres: the tags' offsets, 0 of a board taken for flat."""
        return self.shared[len(self.form.names) :].reshape(-1, 3) if self.form.bent else np.zeros((1, 3))

    def offsets(self, board: Board) -> Offsets | None:
        """(x, y, z) of each of the board's tags, metres; None for a board taken for flat."""
        if not self.form.bent:
            return None
        ids = self.observations.ids
        found = dict(zip(ids, self.observations.points + self.free - board.flat().points(ids), strict=True))
        return tuple(tuple(found[tag].tolist()) if tag in found else (0.0, 0.0, 0.0) for tag in board.centers())

    def moved(self, by: np.ndarray, poses: np.ndarray) -> "Fit | None":
        """The shared numbers moved by (m,), the poses by (v, 6); None where that gives no finite cost."""
        turn = np.array([cv2.Rodrigues(pose[:3])[0] for pose in poses])
        t = (turn @ self.t[..., None])[..., 0] + poses[:, 3:]
        return _at(self.form, self.observations, self.shared + by, turn @ self.R, t)


def fit(
    views: Sequence[Sighting],
    image_size: tuple[int, int],
    board: Board,
    form: ModelSpec,
    start: Fit | None = None,
) -> Fit:
    """The camera, poses and offsets of least cost: from `start`, a fit of as many views, where given."""
    seen = _observe(views, image_size, board, form, start)
    k = len(form.names)
    if start is not None and len(start.R) == len(views):
        lens, R, t = start.lens, start.R, start.t
    else:
        lens, R, t = _flat_start(views, image_size, board)
    found = _at(form, seen, np.pad(lens[:k], (0, len(seen.prior) - k)), R, t)
    if found is None or not ((found := _settle(found)).shared[:2] > 0).all():
        raise InputError("views", "photos from which a camera follows", "none from which a fit converges")
    return found


def matched(tags: Sequence[Tag], board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Board points (n, 3), metres, and pixels (n, 2) of tags that all are on the board."""
    return board.points(t.id for t in tags), np.array([t.center for t in tags]).reshape(-1, 2)


def _flat_start(
    views: Sequence[Sighting], image_size: tuple[int, int], board: Board
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`Fit.lens` of the model k1k2, R (v, 3, 3) and t (v, 3) of a flat board by cv2.calibrateCamera."""
    both = [matched(v.tags, board.flat()) for v in views]
    points, pixels = ([one.astype(np.float32) for one in side] for side in zip(*both, strict=True))
    flags, stop = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3, (cv2.TERM_CRITERIA_COUNT, 30, 0)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # on several it adds up in any order, and no two fits end in the same bits
    try:
        _, K, dist, turns, shifts = cv2.calibrateCamera(
            points, pixels, image_size, None, None, flags=flags, criteria=stop
        )
    except cv2.error as error:
        raise InputError("views", "photos from which a camera follows", error.err) from None
    finally:
        cv2.setNumThreads(threads)
    lens = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *dist.ravel()[:5]])
    return lens, np.array([cv2.Rodrigues(turn)[0] for turn in turns]), np.reshape(shifts, (-1, 3))


def _observe(
    views: Sequence[Sighting], image_size: tuple[int, int], board: Board, form: ModelSpec, start: Fit | None
) -> Observations:
    shown = {tag.id for view in views for tag in view.tags}
    ids = tuple(tag for tag in board.centers() if tag in shown)
    place = {tag: i for i, tag in enumerate(ids)}
    pixels, seen = np.zeros((len(views), len(ids), 2)), np.zeros((len(views), len(ids)), bool)
    for i, view in enumerate(views):
        rows = [place[tag.id] for tag in view.tags]
        pixels[i, rows], seen[i, rows] = [tag.center for tag in view.tags], True
    points = board.flat().points(ids)
    if start is not None and (known := start.offsets(board)) is not None:
        height = dict(zip(board.centers(), known, strict=True))
        points[:, :2] += drawn_in(points[:, :2], np.array([height[tag][2] for tag in ids]))
    noise = LEAST_NOISE_PX if start is None else max(start.variance**0.5, LEAST_NOISE_PX)
    return Observations(ids, points, pixels, seen, _prior(form, points, noise), image_size)


def _prior(form: ModelSpec, points: np.ndarray, noise: float) -> np.ndarray:
    """(m, m): `Observations.prior` where a coordinate errs by `noise` pixels."""
    k, n = len(form.names), len(points) if form.bent else 0
    out = np.zeros((k + 3 * n, k + 3 * n))
    out[range(k, k + 3 * n), range(k, k + 3 * n)] = np.tile((noise / PRIOR_METRES) ** 2, n)
    plane = np.linalg.qr(np.c_[np.ones(len(points)), points[:, :2]])[0][:n]
    out[k + 2 :: 3, k + 2 :: 3] += (noise / IN_PLANE_METRES) ** 2 * plane @ plane.T
    return out


def drawn_in(xy: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(n, 2): how a sheet's points (n, 2) move within its plane where it bends to heights (n,) and does not stretch.

    Neighbours stay as far apart as they were: e·(d_j - d_i) = -(z_j - z_i)²/(2 L), in least squares, with e the unit
    vector between them and L their distance.
    """
    far = np.linalg.norm(xy[:, None] - xy, axis=-1)
    i, j = np.nonzero(np.triu(far <= NEIGHBOURS * np.where(far > 0, far, np.inf).min(), 1))
    e = (xy[j] - xy[i]) / far[i, j, None]
    rows, change = np.zeros((len(i), len(xy), 2)), -((height[j] - height[i]) ** 2) / (2 * far[i, j])
    rows[range(len(i)), i], rows[range(len(i)), j] = -e, e
    return np.linalg.lstsq(rows.reshape(len(i), -1), change, rcond=None)[0].reshape(-1, 2)


def _at(form: ModelSpec, seen: Observations, shared: np.ndarray, R: np.ndarray, t: np.ndarray) -> Fit | None:
    """The fit at one place; None where a tag is behind the camera or the cost is not finite."""
    K, dist = form.camera(shared)
    (v, n), k = seen.seen.shape, len(form.names)
    board = seen.points + (shared[k:].reshape(-1, 3) if form.bent else 0.0)
    points = board @ R.swapaxes(1, 2) + t[:, None]
    known = seen.seen[..., None]
    with np.errstate(all="ignore"):
        residuals, of_lens, of_point = lens_model.linearise(points, seen.pixels, K, dist, MODELS[form.model])
        A = of_lens = np.where(known[..., None], of_lens, 0)
        of_point = np.where(known[..., None], of_point, 0)
        residuals = np.where(known, residuals, 0)
        cost = float((residuals**2).sum() + shared @ seen.prior @ shared)
    if not np.isfinite(cost) or (points[..., 2] <= 0)[seen.seen].any():
        return None
    if form.bent:
        of_tag = (of_point @ R[:, None])[:, :, :, None] * np.eye(n)[:, None, :, None]
        A = np.concatenate([of_lens, of_tag.reshape(v, n, 2, 3 * n)], axis=-1)
    A, B = (d.reshape(v, 2 * n, -1) for d in (A, lens_model.of_pose(points, of_point)))
    # Of few tags in a line a turn about it is not determined, and does not move.
    inverse_B = np.linalg.pinv(B, rcond=1e-7)
    follow, r = -inverse_B @ A, residuals.reshape(v, 2 * n, 1)
    r = (r - B @ (inverse_B @ r))[..., 0]
    return Fit(form, seen, shared, R, t, residuals, A + B @ follow, r, inverse_B, follow, cost)


def _settle(here: Fit) -> Fit:
    """Gauss-Newton, damped after Marquardt where a step would make it worse."""
    damping, prior = 1e-6, here.observations.prior
    for _ in range(MAX_STEPS):
        g = np.einsum("vri,vr->i", here.A, here.r) + prior @ here.shared
        d = -solve_scaled(here.total + damping * np.diag(np.diag(here.total)), g)
        left, shared = here.r + here.A @ d, here.shared + d
        promised = here.cost - float((left**2).sum() + shared @ prior @ shared)
        if promised <= SETTLED_SHARE * here.cost:
            break
        there = here.moved(d, here.follow @ d + here.catch_up)
        if there is not None and here.cost - there.cost < promised / 2:
            # Where views barely separate two parameters, the poses follow along a curved valley: let them catch up.
            there = there.moved(np.zeros(len(d)), there.catch_up)
        if there is not None and there.cost <= here.cost:
            here, damping = there, max(damping / 10, 1e-12)
        elif damping > 1e9:
            break
        else:
            damping = max(damping, 1e-6) * 10
    return here


def solve_scaled(S: np.ndarray, right: np.ndarray) -> np.ndarray:
    """S^-1 right for a positive S; pixels, coefficients and metres differ by orders of magnitude: its diagonal is made
    1."""
    size = np.diag(S)
    scale = np.where(size > 0, 1 / np.sqrt(np.where(size > 0, size, 1)), 0)
    scaled = S * np.outer(scale, scale) + RIDGE_SHARE * np.eye(len(S))
    return (scale * np.linalg.solve(scaled, (scale * right.T).T).T).T
