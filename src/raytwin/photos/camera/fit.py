"""Tags of a board, seen from many sides -> K, distortion, poses and the tags' places on the board.

    min Σ |project(board) - tag|² + Σ (noise offset / PRIOR_METRES)²

`offset` is how far a tag's centre lies from its place on the sheet, 0 of a board taken for flat. OpenCV gives the
start; from there it is Gauss-Newton with Marquardt's damping. With A = d residuals / d shared numbers and B =
d residuals / d pose of one view, the pose is eliminated first (Schur complement): what no pose explains of A and of the
residuals r is

    A' = A - B B⁺ A,  r' = r - B B⁺ r,  H = Σ A'^T A' + prior,  g = Σ A'^T r' + prior shared.

The fit, its covariance and the fit without one of the photos are sums of these. A pose moves by a turn
omega and a shift tau of the camera's frame: p' = p + omega x p + tau.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.photos.boards import Board
from raytwin.photos.camera import lens_model
from raytwin.photos.camera.detection import Tag

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""The lens's numbers, in OpenCV's order: the first of the shared ones."""

LENS = len(NAMES)

MODELS = {"none": NAMES[:4], "k1k2": NAMES[:6], "full5": NAMES}
"""The numbers that each lens model fits, smallest first. The others are 0."""

MAX_STEPS, SETTLED_SHARE = 100, 1e-10
"""The fit has converged once a step is predicted to lower the sum of squares by less than this fraction."""

PRIOR_METRES = (1e-5, 1e-5, 2e-3)
"""Metres, one standard deviation of a tag's offset before any photo: x, y as printers place ink, z as paper bends."""

IN_PLANE_METRES = 1e-6
"""Metres, the same of the heights' mean and tilt, which belong to the poses."""

LEAST_NOISE_PX = 0.01
"""Least standard deviation of a tag's coordinate, pixels, by which it is weighed against PRIOR_METRES."""

RIDGE_SHARE = 1e-12
"""Added to a diagonal of 1, so that what no photo determines does not move."""

Views = Mapping[str, Sequence[Tag]]
"""By photo, tags that all are on the board."""


@dataclass(frozen=True)
class ModelSpec:
    """What is fitted besides K and poses: a row of MODELS, and whether the tags' offsets are free (`bent`)."""

    model: str
    bent: bool = False

    def __str__(self) -> str:
        return f"{self.model}, bent" if self.bent else self.model

    @property
    def names(self) -> tuple[str, ...]:
        return MODELS[self.model]


@dataclass(frozen=True, eq=False)
class Observations:
    """What v views saw of the n tags `ids` that any of them shows.

    `points` (n, 3) metres: their places on the flat sheet; `pixels` (v, n, 2); `seen` (v, n) bool. `prior` (m, m):
    weights of the squares of `Fit.shared`, 0 of the lens's.
    """

    ids: tuple[int, ...]
    points: np.ndarray
    pixels: np.ndarray
    seen: np.ndarray
    prior: np.ndarray


@dataclass(frozen=True, eq=False)
class Fit:
    """The sum of squares, `cost`, and its derivatives at one place; that of least cost is what `fit` returns.

    `shared` (m,) is NAMES, 0 where `form` does not fit it, then the tags' offsets, if free. R (v, 3, 3), t (v, 3): the
    poses. `residuals` (v, n, 2): projected minus seen, pixels, 0 of tags not seen. `A` (v, 2n, m), `r` (v, 2n): A' and
    r' above. `follow` (v, 6, m): d best pose / d shared; `catch_up` (v, 6): how the poses must move to be the best.
    """

    form: ModelSpec
    observations: Observations
    shared: np.ndarray
    R: np.ndarray
    t: np.ndarray
    residuals: np.ndarray
    A: np.ndarray
    r: np.ndarray
    follow: np.ndarray
    catch_up: np.ndarray
    cost: float

    @cached_property
    def total(self) -> np.ndarray:  # H
        A = self.A.reshape(-1, len(self.shared))
        return np.asarray(A.T @ A + self.observations.prior)

    @cached_property
    def inverse(self) -> np.ndarray:  # of H
        return solve_scaled(self.total, np.eye(len(self.total)))

    @property
    def K(self) -> np.ndarray:
        return lens_model.matrix(self.shared)

    @property
    def dist(self) -> tuple[float, ...]:
        return tuple(self.shared[4 : len(self.form.names)].tolist())

    @property
    def stands(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, tuple[float, ...]]]:
        """By view, R, t, K and distortion."""
        return [(R, t, self.K, self.dist) for R, t in zip(self.R, self.t, strict=True)]

    @property
    def rms_px(self) -> float:
        return float(np.sqrt((self.residuals**2).sum() / self.observations.seen.sum()))

    @property
    def variance(self) -> float:
        """Variance of a coordinate, pixels²: residuals² / (coordinates - unknowns).

        What the prior determines of the offsets is no unknown: trace(H^-1 Σ A'^T A') of the shared numbers are.
        """
        unknowns = 6 * len(self.R) + (np.diag(self.total) > 0).sum() - (self.observations.prior * self.inverse).sum()
        return float((self.residuals**2).sum() / max(2 * self.observations.seen.sum() - unknowns, 1.0))

    def shaped(self, board: Board) -> Board:
        """The board with the offsets found; tags that no photo shows lie on the flat sheet."""
        if not self.form.bent:
            return board.flat()
        found = dict(zip(self.observations.ids, map(tuple, self.shared[LENS:].reshape(-1, 3).tolist()), strict=True))
        return msgspec.structs.replace(board, offsets=tuple(found.get(i, (0.0, 0.0, 0.0)) for i in board.centers()))

    def moved(self, by: np.ndarray, poses: np.ndarray) -> "Fit | None":
        """The shared numbers moved by (m,), the poses by (v, 6); see `_at`."""
        turn = np.array([cv2.Rodrigues(pose[:3])[0] for pose in poses])
        t = (turn @ self.t[..., None])[..., 0] + poses[:, 3:]
        return _at(self.form, self.observations, self.shared + by, turn @ self.R, t)

    def leave_one_out(self) -> tuple[np.ndarray, np.ndarray]:
        """By photo: how the shared numbers move without it (n, m), and its rms distance then (n,), pixels, with the
        pose that fits best."""
        moves = np.array([solve_scaled(self.total - A.T @ A, A.T @ r) for A, r in zip(self.A, self.r, strict=True)])
        off = self.r + (self.A @ moves[..., None])[..., 0]
        return moves, np.sqrt((off**2).sum(axis=1) / self.observations.seen.sum(axis=1))


def fit(views: Views, image_size: tuple[int, int], board: Board, form: ModelSpec, start: Fit | None = None) -> Fit:
    """The camera, poses and offsets of least cost: from `start`, a fit of as many views, where given."""
    if start is not None and len(start.R) == len(views):
        lens, R, t, noise = start.shared[:LENS], start.R, start.t, start.variance**0.5
    else:
        lens, R, t, noise = *_first(views, image_size, board), 0.0
    data = _observe(views, board, form, max(noise, LEAST_NOISE_PX))
    fitted = np.arange(LENS) < len(form.names)
    found = _at(form, data, np.pad(np.where(fitted, lens, 0), (0, len(data.prior) - LENS)), R, t)
    if found is None or not ((found := _settle(found)).shared[:2] > 0).all():
        raise InputError("views", "photos from which a camera follows", "none from which a fit converges")
    return found


def matched(tags: Sequence[Tag], board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Board points (n, 3), metres, and pixels (n, 2) of tags that all are on the board."""
    return board.points(t.id for t in tags), np.array([t.center for t in tags]).reshape(-1, 2)


def _first(views: Views, image_size: tuple[int, int], board: Board) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lens's numbers, R (v, 3, 3) and t (v, 3) by OpenCV, with k1 and k2 on a flat board: to start from."""
    both = zip(*(matched(tags, board.flat()) for tags in views.values()), strict=True)
    points, pixels = ([one.astype(np.float32) for one in side] for side in both)
    flags, stop = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3, (cv2.TERM_CRITERIA_COUNT, 30, 0)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # on several it adds up in any order, and no two fits end in the same bits
    try:
        found = cv2.calibrateCamera(points, pixels, image_size, None, None, flags=flags, criteria=stop)
    except cv2.error as error:
        raise InputError("views", "photos from which a camera follows", error.err) from None
    finally:
        cv2.setNumThreads(threads)
    _, K, dist, turns, shifts = found
    lens = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *dist.ravel()[:5]])
    return lens, np.array([cv2.Rodrigues(turn)[0] for turn in turns]), np.reshape(shifts, (-1, 3))


def _observe(views: Views, board: Board, form: ModelSpec, noise: float) -> Observations:
    """`views` as arrays, where a coordinate errs by `noise` pixels."""
    shown = {tag.id for tags in views.values() for tag in tags}
    ids = tuple(tag for tag in board.centers() if tag in shown)
    row = {tag: i for i, tag in enumerate(ids)}
    pixels, seen = np.zeros((len(views), len(ids), 2)), np.zeros((len(views), len(ids)), bool)
    for i, tags in enumerate(views.values()):
        rows = [row[tag.id] for tag in tags]
        pixels[i, rows], seen[i, rows] = [tag.center for tag in tags], True
    points, n = board.flat().points(ids), len(ids) if form.bent else 0
    prior = np.diag([*(0.0,) * LENS, *(noise / np.tile(PRIOR_METRES, n)) ** 2])
    plane = np.linalg.qr(np.c_[np.ones(len(ids)), points[:, :2]])[0][:n]
    prior[LENS + 2 :: 3, LENS + 2 :: 3] += (noise / IN_PLANE_METRES) ** 2 * plane @ plane.T
    return Observations(ids, points, pixels, seen, prior)


def _at(form: ModelSpec, data: Observations, shared: np.ndarray, R: np.ndarray, t: np.ndarray) -> Fit | None:
    """The fit at one place; None where a tag is behind the camera or the cost is not finite."""
    (v, n), seen, fitted = data.seen.shape, data.seen[..., None], np.arange(LENS) < len(form.names)
    points = (data.points + (shared[LENS:].reshape(-1, 3) if form.bent else 0.0)) @ R.swapaxes(1, 2) + t[:, None]
    with np.errstate(all="ignore"):
        residuals, of_lens, of_point = lens_model.linearise(
            points, data.pixels, lens_model.matrix(shared), shared[4:LENS]
        )
        residuals, of_point = np.where(seen, residuals, 0), np.where(seen[..., None], of_point, 0)
        A = np.where(seen[..., None] & fitted, of_lens, 0)
        cost = float((residuals**2).sum() + shared @ data.prior @ shared)
    if not np.isfinite(cost) or (points[..., 2] <= 0)[data.seen].any():
        return None
    if form.bent:
        of_tag = (of_point @ R[:, None])[:, :, :, None] * np.eye(n)[:, None, :, None]
        A = np.concatenate([A, of_tag.reshape(v, n, 2, 3 * n)], axis=-1)
    A, B = (d.reshape(v, 2 * n, -1) for d in (A, lens_model.of_pose(points, of_point)))
    # A turn about a line of few tags is not determined: by the pseudo-inverse it stays as it is.
    inverse_B, r = np.linalg.pinv(B, rcond=1e-7), residuals.reshape(v, 2 * n, 1)
    follow, catch_up = -inverse_B @ A, -inverse_B @ r
    r = (r + B @ catch_up)[..., 0]
    return Fit(form, data, shared, R, t, residuals, A + B @ follow, r, follow, catch_up[..., 0], cost)


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
            # Where views barely separate two parameters, the valley is curved: move the poses to its bottom.
            there = there.moved(np.zeros(len(d)), there.catch_up)
        if there is not None and there.cost <= here.cost:
            here, damping = there, max(damping / 10, 1e-12)
        elif damping > 1e9:
            break
        else:
            damping = max(damping, 1e-6) * 10
    return here


def solve_scaled(S: np.ndarray, right: np.ndarray) -> np.ndarray:
    """S^-1 right for a positive S, scaled to a diagonal of 1: pixels and metres differ by orders of magnitude."""
    size = np.diag(S)
    scale = np.where(size > 0, 1 / np.sqrt(np.where(size > 0, size, 1)), 0)
    scaled = S * np.outer(scale, scale) + RIDGE_SHARE * np.eye(len(S))
    return (scale * np.linalg.solve(scaled, (scale * right.T).T).T).T
