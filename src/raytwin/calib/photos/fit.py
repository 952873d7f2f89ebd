"""Tags of a board, seen from many sides -> K, distortion, poses and the tags' places on the board.

    min Σ |project(board) - tag|² + Σ (noise offset / PRIOR)²

`offset` is how far a tag's centre lies from its place on the sheet: no sheet of paper is flat, no print exact. Of a
board taken for flat, all are 0. OpenCV gives the start; from there it is Gauss-Newton with Marquardt's damping, where
every view's six numbers of pose are eliminated first. With A = d residuals / d shared, B = d residuals / d pose of view
i (Schur complement),

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

from raytwin.calib.boards import Board, Offsets
from raytwin.calib.photos import lens_model
from raytwin.calib.photos.detection import Tag
from raytwin.errors import InputError
from raytwin.scene import Record

INTRINSICS = ("fx", "fy", "cx", "cy")

MODELS: dict[str, tuple[str, ...]] = {"none": (), "k1k2": ("k1", "k2"), "full5": lens_model.NAMES}
"""The coefficients that each lens model fits, smallest first; the others are 0. To add one: a row here."""

FLAT_STARTS = {
    "none": cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3,
    "k1k2": cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3,
    "full5": 0,
}
"""OpenCV's flags for the fit that each start comes from."""

CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-6)
STEPS, SETTLED = 100, 1e-10
"""Most steps; the fit has converged once a step is predicted to lower the sum of squares by less than this fraction."""

PRIOR = np.array([1e-5, 1e-5, 2e-3])
"""Metres, one standard deviation of a tag's offset before any photo: x, y as printers place ink, z as paper bends."""

IN_PLANE = 1e-6
"""Metres, the same of the heights' mean and tilt, which belong to the poses."""

NEIGHBOURS = 1.5
"""Tags at most this many times as far apart as the nearest two are neighbours: along rows, columns and diagonals."""

LEAST_NOISE_PX = 0.01
"""Pixels: what a tag's coordinate errs by at least when it is weighed against PRIOR."""

RIDGE = 1e-12
"""Share of the diagonal that is added to it, so that what no photo determines does not move."""


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
    """What is fitted besides K and poses: a row of MODELS, and whether the tags' offsets are free (`bent`)."""

    model: str
    bent: bool = False

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
    """What v views saw of the n tags `ids` that any of them shows.

    `points` (n, 3) metres: their places before any offset; `pixels` (v, n, 2); `seen` (v, n) bool; `noise`:
    pixels, what a coordinate is taken to err by where it is weighed against PRIOR.
    """

    ids: tuple[int, ...]
    points: np.ndarray
    pixels: np.ndarray
    seen: np.ndarray
    noise: float
    image_size: tuple[int, int]

    def prior(self, form: ModelSpec) -> np.ndarray:
        """(m, m): the weights of squares of `Fit.shared`: none of K and distortion, PRIOR and IN_PLANE of offsets."""
        k, n = len(form.names), len(self.ids) if form.bent else 0
        out = np.zeros((k + 3 * n, k + 3 * n))
        out[range(k, k + 3 * n), range(k, k + 3 * n)] = np.tile((self.noise / PRIOR) ** 2, n)
        plane = np.linalg.qr(np.c_[np.ones(len(self.ids)), self.points[:, :2]])[0][:n]
        out[k + 2 :: 3, k + 2 :: 3] += (self.noise / IN_PLANE) ** 2 * plane @ plane.T
        return out


@dataclass(frozen=True, eq=False)
class Step:
    """The fit at one place: `shared` (m,) is fx, fy, cx, cy, the coefficients of `form`, then the offsets, if free.

    R (v, 3, 3), t (v, 3): the poses. `residuals` (v, n, 2): projected minus seen, pixels. d residuals by d lens (v, n,
    2, k), by d the tag's own offset (v, n, 2, 3 or 0), by d pose (v, n, 2, 6): 0 of tags not seen. `cost`: the sum of
    squares.
    """

    form: ModelSpec
    observations: Observations
    shared: np.ndarray
    R: np.ndarray
    t: np.ndarray
    residuals: np.ndarray
    of_lens: np.ndarray
    of_tag: np.ndarray
    of_pose: np.ndarray
    prior: np.ndarray
    cost: float

    def gram(self, views: slice = slice(None)) -> np.ndarray:
        """(m, m): A^T A, summed over the views; two tags' offsets share no residual."""
        lens, tag = self.of_lens[views], self.of_tag[views]
        k, n, s = lens.shape[-1], tag.shape[1], tag.shape[-1]
        out, own = np.zeros((k + n * s, k + n * s)), np.zeros((n, s, n, s))
        own[range(n), :, range(n)] = np.einsum("vnci,vncj->nij", tag, tag)
        out[:k, :k] = np.einsum("vnci,vncj->ij", lens, lens)
        out[:k, k:] = np.einsum("vnci,vncj->inj", lens, tag).reshape(k, n * s)
        out[k:, :k], out[k:, k:] = out[:k, k:].T, own.reshape(n * s, n * s)
        return out

    def across(self, columns: np.ndarray) -> np.ndarray:
        """(v, m, x): A^T of each view times columns (v, n, 2, x)."""
        lens = np.einsum("vnci,vncx->vix", self.of_lens, columns, optimize=True)
        tag = np.einsum("vnci,vncx->vnix", self.of_tag, columns)
        v, n, s, x = tag.shape
        return np.concatenate([lens, tag.reshape(v, n * s, x)], axis=1)

    def along(self, view: int, move: np.ndarray) -> np.ndarray:
        """(n, 2): A of the view times a move (m,) of the shared numbers."""
        lens, tag = self.of_lens[view], self.of_tag[view]
        k, s = lens.shape[-1], tag.shape[-1]
        return lens @ move[:k] + (tag @ move[k:].reshape(len(tag), s, 1))[..., 0]


@dataclass(frozen=True, eq=False)
class Fit(Step):
    """Where it settled, and `total` (m, m): Σ H_i and the prior, `inverse` its inverse; `g` (v, m), see above.

    `cross` (v, m, 6): A^T B; `follow` (v, 6, m): d pose by d shared; `local` (v, 6, 6): (B^T B)^-1.
    """

    total: np.ndarray
    inverse: np.ndarray
    g: np.ndarray
    cross: np.ndarray
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
        return float(np.sqrt((self.residuals**2).sum() / self.observations.seen.sum()))

    @property
    def variance(self) -> float:
        """Variance of a coordinate, pixels², of independent errors: residuals² / (coordinates - unknowns).

        What the prior determines of the offsets is no unknown: trace(total^-1 Σ H_i) of the shared numbers are.
        """
        unknowns = 6 * len(self.R) + len(self.shared) - (self.prior * self.inverse).sum()
        return float((self.residuals**2).sum() / max(2 * self.observations.seen.sum() - unknowns, 1.0))

    def without(self, view: int) -> np.ndarray:
        """(m, m): `total` without H_i of one view."""
        return self.total - self.gram(slice(view, view + 1)) - self.cross[view] @ self.follow[view]

    def offsets(self, board: Board) -> Offsets | None:
        """(x, y, z) of each of the board's tags, metres; None for a board taken for flat."""
        if not self.form.bent:
            return None
        ids = self.observations.ids
        free = self.shared[len(self.form.names) :].reshape(-1, 3)
        found = dict(zip(ids, self.observations.points + free - board.flat().points(ids), strict=True))
        return tuple(tuple(found[tag].tolist()) if tag in found else (0.0, 0.0, 0.0) for tag in board.centers())


def fit(
    views: Sequence[Sighting],
    image_size: tuple[int, int],
    board: Board,
    form: ModelSpec,
    start: Fit | None = None,
) -> Fit:
    """The camera, poses and offsets of least cost: from `start`, a fit of as many views, where given.

    Else the best of the fits from each of FLAT_STARTS: of few photos one of them alone may be lost.
    """
    seen = _observe(views, image_size, board, start)
    if start is not None and len(start.R) == len(views):
        starts = [(start.K, start.dist, start.R, start.t)]
    else:
        starts = _flat_starts(views, image_size, board)
    found = []
    for K, dist, R, t in starts:
        value = dict(zip(lens_model.NAMES, dist, strict=False))
        shared = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *(value.get(n, 0.0) for n in MODELS[form.model])]
        if form.bent:
            shared = [*shared, *np.zeros(3 * len(seen.ids))]
        made = _settle(_step(form, seen, seen.prior(form), np.array(shared), R, t))
        if np.isfinite(made.shared).all() and np.isfinite(made.cost) and (made.shared[:2] > 0).all():
            found.append(made)
    if not found:
        raise InputError("views", "photos from which a camera follows", "none from which a fit converges")
    return min(found, key=lambda f: f.cost)


def matched(tags: Sequence[Tag], board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Board points (n, 3), metres, and pixels (n, 2) of tags that all are on the board."""
    return board.points(t.id for t in tags), np.array([t.center for t in tags]).reshape(-1, 2)


Start = tuple[np.ndarray, tuple[float, ...], np.ndarray, np.ndarray]
"""K, distortion, R (v, 3, 3), t (v, 3)."""


def _flat_starts(views: Sequence[Sighting], image_size: tuple[int, int], board: Board) -> list[Start]:
    """The flat board by OpenCV: Zhang's closed form, and steps from there, for each lens model."""
    both = [matched(v.tags, board.flat()) for v in views]
    points, pixels = ([one.astype(np.float32) for one in side] for side in zip(*both, strict=True))
    found, why = [], "none"
    for flags in FLAT_STARTS.values():
        try:
            with one_thread():
                _, K, dist, turns, shifts = cv2.calibrateCamera(
                    points, pixels, image_size, None, None, flags=flags, criteria=CRITERIA
                )
        except cv2.error as error:
            why = error.err or why
            continue
        why = f"fx, fy = {K[0, 0]:.4g}, {K[1, 1]:.4g}"
        if np.isfinite(K).all() and np.isfinite(dist).all() and K[0, 0] > 0 and K[1, 1] > 0:
            R = np.array([cv2.Rodrigues(turn)[0] for turn in turns])
            found.append((K, tuple(dist.ravel()[:5].tolist()), R, np.array([s.ravel() for s in shifts])))
    if not found:
        raise InputError("views", "photos from which a camera follows", why)
    return found


def _observe(views: Sequence[Sighting], image_size: tuple[int, int], board: Board, start: Fit | None) -> Observations:
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
    return Observations(ids, points, pixels, seen, noise, image_size)


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


def _step(
    form: ModelSpec, seen: Observations, prior: np.ndarray, shared: np.ndarray, R: np.ndarray, t: np.ndarray
) -> Step:
    K, dist = form.camera(shared)
    k, free = len(form.names), 3 if form.bent else 0
    board = seen.points + (shared[k:].reshape(-1, 3) if form.bent else 0.0)
    points = board @ R.swapaxes(1, 2) + t[:, None]
    known = seen.seen[..., None]
    with np.errstate(all="ignore"):  # a step too far gives no finite cost, and is not taken
        r, of_lens, of_point = lens_model.linearise(points, seen.pixels, K, dist, MODELS[form.model])
        of_pose, of_tag = lens_model.of_pose(points, of_point), (of_point @ R[:, None])[..., :free]
        r = np.where(known, r, 0)
        of_lens, of_tag, of_pose = (np.where(known[..., None], d, 0) for d in (of_lens, of_tag, of_pose))
        cost = float((r * r).sum() + shared @ prior @ shared)
    if not np.isfinite(cost) or (points[..., 2] <= 0)[seen.seen].any():
        cost = np.inf
    return Step(form, seen, shared, R, t, r, of_lens, of_tag, of_pose, prior, cost)


def _moved(here: Step, d_shared: np.ndarray, d_poses: np.ndarray) -> Step:
    turn = np.array([cv2.Rodrigues(turned)[0] for turned in d_poses[:, :3]])
    t = (turn @ here.t[..., None])[..., 0] + d_poses[:, 3:]
    return _step(here.form, here.observations, here.prior, here.shared + d_shared, turn @ here.R, t)


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
            BB, Br = _of_poses(there)
            there = _moved(there, np.zeros(len(there.shared)), -np.linalg.solve(BB, Br)[..., 0])
        if there.cost <= here.cost:
            here, damping = there, max(damping / 10, 1e-12)
        elif damping > 1e9:
            break
        else:
            damping = max(damping, 1e-6) * 10
    BB, Br = _of_poses(here)
    local = _inverse(BB)
    cross = here.across(here.of_pose)
    follow = -local @ cross.swapaxes(1, 2)
    total = here.gram() + np.einsum("vma,van->mn", cross, follow, optimize=True) + here.prior
    g = here.across(here.residuals[..., None])[..., 0] + (follow.swapaxes(1, 2) @ Br)[..., 0]
    return Fit(
        **vars(here), total=total, inverse=solve_scaled(total, np.eye(len(total))), g=g, cross=cross, follow=follow,
        local=local,
    )  # fmt: skip


def _of_poses(here: Step) -> tuple[np.ndarray, np.ndarray]:
    """B^T B (v, 6, 6) and B^T r (v, 6, 1)."""
    v = len(here.R)
    B, r = here.of_pose.reshape(v, -1, 6), here.residuals.reshape(v, -1, 1)
    return B.swapaxes(1, 2) @ B, B.swapaxes(1, 2) @ r


def _inverse(BB: np.ndarray) -> np.ndarray:
    """(v, 6, 6): the inverses; of few tags in a line a turn about it is not determined, and does not move."""
    return np.linalg.pinv(BB, rcond=1e-14, hermitian=True)


def _solve(here: Step, damping: float) -> tuple[np.ndarray, np.ndarray, float]:
    """The step of the shared numbers (m,) and of the poses (v, 6), and by how much it should lessen the squares."""
    cross, (BB, Br) = here.across(here.of_pose), _of_poses(here)
    inverse = _inverse(BB * (1 + damping * np.eye(6)))
    U = here.gram() + here.prior
    rhs = here.across(here.residuals[..., None]).sum(axis=0)[:, 0] + here.prior @ here.shared
    S = U + damping * np.diag(np.diag(U)) - np.einsum("vma,vna->mn", cross @ inverse, cross, optimize=True)
    d = -solve_scaled(S, rhs - (cross @ inverse @ Br).sum(axis=0)[:, 0])
    poses = -(inverse @ (Br + cross.swapaxes(1, 2) @ d[:, None]))[..., 0]
    promised = -float(d @ rhs + (poses * Br[..., 0]).sum())
    return d, poses, promised


def solve_scaled(S: np.ndarray, right: np.ndarray) -> np.ndarray:
    """S^-1 right for a positive S; pixels, coefficients and metres differ by orders of magnitude: its diagonal is made
    1."""
    size = np.diag(S)
    scale = np.where(size > 0, 1 / np.sqrt(np.where(size > 0, size, 1)), 0)
    scaled = S * np.outer(scale, scale) + RIDGE * np.eye(len(S))
    return (scale * np.linalg.solve(scaled, (scale * right.T).T).T).T
