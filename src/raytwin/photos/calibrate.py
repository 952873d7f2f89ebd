"""Photos of a board -> K and distortion, with standard deviations, poses, and doubts: min sum |project(board) - tag|².

Zhang's closed form, then Levenberg-Marquardt over everything, both by cv2.calibrateCamera, on tag centres. The lens
model is the smallest that predicts views it has not seen.
"""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec
import numpy as np

from raytwin import files
from raytwin.errors import InputError
from raytwin.photos import judge, lens, pose
from raytwin.photos.bias import unbiased
from raytwin.photos.board import Board, spans_a_plane
from raytwin.photos.detect import Progress, Tag, detect_photos
from raytwin.scene import Matrix, Record, Vector

NAMES = ("k1", "k2", "p1", "p2", "k3")

MODELS: dict[str, tuple[str, ...]] = {
    "none": (),
    "k1": ("k1",),
    "k1k2": ("k1", "k2"),
    "k1k2p1p2": ("k1", "k2", "p1", "p2"),
    "k1k2k3": ("k1", "k2", "k3"),
    "full5": NAMES,
}
"""The coefficients that each model fits; the others are 0. To add one: a row here (OpenCV's five are all there are)."""

LADDER = ("none", "k1", "k1k2", "k1k2k3", "full5")
"""What `auto` chooses from, smallest first; each adds coefficients to the one before."""

WITHIN, SIGNIFICANT, FOLDS = 1.05, 3.0, 5
"""`auto` takes the smallest model whose held-out error is within 5 % of the best and whose newest coefficients exceed
3 standard deviations; held-out by turns is a fifth of the views."""

LEAST_VIEWS = 3

ROUNDS = 3
"""Fits, each without the outliers and the detector's bias that the one before tells; a fourth moves fx by 1e-7."""

PRELIMINARY = "k1k2"
"""What `auto` fits before it chooses: enough to tell the detector's bias and the outliers."""

GROSS = 0.03
"""Before anything is fitted: a tag this share of the image's width off its view's homography is an outlier, far more
than any lens bends a board."""


class View(Record, frozen=True):
    """One photo: tags used, root mean squared distance, `p_cam = R_cam_board @ p_board + t_cam_board` (metres)."""

    photo: str
    tags: int
    rms_px: float
    R_cam_board: Matrix
    t_cam_board: Vector


class Warning_(Record, frozen=True):
    """A doubt: `code` is stable (judge.CODES), `text` is for people."""

    code: str
    text: str


class Calibration(Record, frozen=True):
    """The camera and how well it is known; its fields are the keys of the JSON.

    `K` in pixels (OpenCV's: (0, 0) is a pixel's centre); `dist` is a prefix of k1, k2, p1, p2, k3; `sigma` holds one
    standard deviation of fx, fy, cx, cy and of each coefficient that was fitted; `rms_px` is over all tags used.
    """

    image_size: tuple[int, int]
    model: str
    K: Matrix
    dist: tuple[float, ...]
    sigma: dict[str, float]
    rms_px: float
    views: tuple[View, ...]
    warnings: tuple[Warning_, ...] = ()


class Seen(Record, frozen=True):
    """The board's tags in one photo, none of them unknown to the board; internal to the fit."""

    photo: str
    tags: tuple[Tag, ...]


@dataclass(frozen=True, eq=False)
class Fit:
    """What one run of the optimizer gives."""

    K: np.ndarray
    dist: tuple[float, ...]
    sigma: dict[str, float]
    rms_px: float
    poses: tuple[tuple[np.ndarray, np.ndarray], ...]


def calibrate(
    photos: Sequence[str | os.PathLike], board: Board, model: str = "auto", progress: Progress | None = None
) -> Calibration:
    """The camera that took `photos`, all of one size, of one board.

    Photos without tags are left out with a warning as long as three others remain. Raises InputError for anything
    from which no camera follows. `progress(done, total)` counts photos, and the fit as one more.
    """
    paths = [Path(p) for p in photos]
    where = str(paths[0].parent) if paths else "photos"
    _check_model(model)
    if len(paths) < LEAST_VIEWS:
        raise InputError(where, f"at least {LEAST_VIEWS} photos of the board, from different sides", len(paths))
    sizes = [files.photo_size(p) for p in paths]
    for path, size in zip(paths, sizes, strict=True):
        if size != sizes[0]:
            (w, h), (w0, h0) = size, sizes[0]
            raise InputError(path, f"{w0} x {h0} pixels, as {paths[0].name} has", f"{w} x {h}")
    total = len(paths) + 1
    found, wrong = detect_photos(paths, board.family, progress and (lambda done, _: progress(done, total)))
    unique = len({p.name for p in paths}) == len(paths)
    name = {str(p): p.name if unique else str(p) for p in paths}
    result = calibrate_detections(
        {name[p]: tags for p, tags in found.items()},
        sizes[0],
        board,
        model,
        where,
        {name[p]: why for p, why in wrong.items()},
    )
    if progress:
        progress(total, total)
    return result


def calibrate_detections(
    detections: dict[str, Sequence[Tag]],
    image_size: tuple[int, int],
    board: Board,
    model: str = "auto",
    where: str = "photos",
    wrong: dict[str, str] | None = None,
) -> Calibration:
    """The same from tags already found, by photo; `wrong` says of other photos why they have none."""
    _check_model(model)
    wrong = dict(wrong or {})
    if not any(detections.values()):
        seen = "; ".join(f"{name}: {why}" for name, why in list(wrong.items())[:3])
        raise InputError(where, f"photos of {board.family} tags", seen or "none")
    pose.check_ids(list(detections.values()), board, where)
    views, straight = [], []
    known = board.centers()
    for photo, tags in detections.items():
        tags = [t for t in tags if t.id in known]
        inside = np.ones(len(tags), bool)
        if spans_a_plane(board.points(t.id for t in tags)[:, :2]):
            inside = pose.consistent(*pose.matched(tags, board), GROSS * image_size[0])
        if spans_a_plane(board.points(t.id for t in tags)[inside, :2]):
            views.append(Seen(photo, tuple(tags)))
            straight.append(Seen(photo, tuple(t for t, ok in zip(tags, inside, strict=True) if ok)))
        else:
            wrong.setdefault(photo, f"{len(tags)} tags of the board, too few or in one line")
    _check_enough(views, wrong, where)
    chosen = PRELIMINARY if model == "auto" else model
    for turn in range(ROUNDS):
        # The fit tells the detector's bias and the outliers; without both, the next fit is a better one.
        if model == "auto" and turn == 1:
            chosen = select_model(straight, image_size, board)[0]
        result = fit(straight, image_size, board, chosen)
        if turn < ROUNDS - 1:
            views, straight = _inliers(views, board, result, wrong)
            _check_enough(views, wrong, where)
    outliers = {
        v.photo: sorted({t.id for t in v.tags} - {t.id for t in s.tags}) for v, s in zip(views, straight, strict=True)
    }
    return _calibration(straight, image_size, board, chosen, result, wrong, outliers)


def _inliers(views, board: Board, result: Fit, wrong: dict[str, str]) -> tuple[list[Seen], list[Seen]]:
    """The views that keep enough tags by `result`: all their tags, and the inliers without the detector's bias.

    Every tag is judged anew: one that an outlier had pulled away comes back.
    """
    moved, errors = [], []
    for view, (R, t) in zip(views, result.poses, strict=True):
        tags = unbiased(view.tags, board, R, t, result.K, result.dist)
        points, pixels = pose.matched(tags, board)
        moved.append(tags)
        errors.append(np.linalg.norm(lens.project(points, R, t, result.K, result.dist) - pixels, axis=1))
    limit = pose.outlier_limit(np.concatenate(errors))
    kept, straight = [], []
    for view, tags, error in zip(views, moved, errors, strict=True):
        inside = tuple(t for t, e in zip(tags, error, strict=True) if e <= limit)
        if spans_a_plane(board.points(t.id for t in inside)[:, :2]):
            kept.append(view)
            straight.append(Seen(view.photo, inside))
        else:
            wrong[view.photo] = "too few tags that agree with the board"
    return kept, straight


def select_model(
    views: Sequence[Seen], image_size: tuple[int, int], board: Board
) -> tuple[str, dict[str, tuple[float, bool]]]:
    """The smallest sound model within 5 % of the best held-out error; and each model's error (pixels) and soundness.

    Sound: the fit converges, the radial distortion grows out to the image's corner, and what the model adds to the
    next smaller one exceeds 3 standard deviations. `none` is always sound.
    """
    table: dict[str, tuple[float, bool]] = {}
    smaller: tuple[str, ...] = ()
    for model in LADDER:
        try:
            whole = fit(views, image_size, board, model)
            error = held_out(views, image_size, board, model, whole)
        except InputError:
            table[model] = (math.inf, False)
            continue
        added = [n for n in MODELS[model] if n not in smaller]
        value = dict(zip(NAMES, whole.dist, strict=False))
        clear = not added or any(abs(value[n]) > SIGNIFICANT * whole.sigma[n] for n in added)
        table[model] = (error, clear and lens.is_monotone(whole.K, whole.dist, image_size))
        smaller = MODELS[model]
    sound = [m for m in LADDER if table[m][1]] or ["none"]
    best = min(table[m][0] for m in sound)
    return next(m for m in sound if table[m][0] <= WITHIN * best), table


def held_out(
    views: Sequence[Seen], image_size: tuple[int, int], board: Board, model: str, start: Fit | None = None
) -> float:
    """Root mean squared pixel distance in views that the fit has not seen, their poses alone being fitted to them.

    Every FOLDS-th view is left out by turns. `start` is a fit of all views to begin from.
    """
    squares, count = 0.0, 0
    folds = min(FOLDS, len(views))
    for k in range(folds):
        rest = [v for i, v in enumerate(views) if i % folds != k]
        found = fit(rest, image_size, board, model, start)
        for view in views[k::folds]:
            points, pixels = pose.matched(view.tags, board)
            _, rvec, tvec = cv2.solvePnP(points, pixels, found.K, np.array(_five(found.dist)))
            error = lens.project(points, cv2.Rodrigues(rvec)[0], tvec, found.K, found.dist) - pixels
            squares, count = squares + float((error**2).sum()), count + len(points)
    return math.sqrt(squares / count)


def fit(views: Sequence[Seen], image_size: tuple[int, int], board: Board, model: str, start: Fit | None = None) -> Fit:
    """K, distortion and poses of least squared pixel distance; from `start`'s K and distortion where given."""
    free = MODELS[model]
    flags = sum(getattr(cv2, f"CALIB_FIX_K{n}") for n in (1, 2, 3) if f"k{n}" not in free)
    flags |= 0 if "p1" in free else cv2.CALIB_ZERO_TANGENT_DIST
    K, dist = None, None
    if start is not None:
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
        K, dist = start.K.copy(), np.array(_five(start.dist))
    both = [pose.matched(v.tags, board) for v in views]
    try:
        rms, K, dist, rvecs, tvecs, deviations, _, _ = cv2.calibrateCameraExtended(
            [p.astype(np.float32) for p, _ in both],
            [p.astype(np.float32) for _, p in both],
            image_size,
            K,
            dist,
            flags=flags,
        )
    except cv2.error as error:
        raise InputError("views", "photos from which a camera follows", error.err or "none") from None
    if not (np.isfinite(K).all() and np.isfinite(dist).all() and K[0, 0] > 0 and K[1, 1] > 0):
        raise InputError("views", "photos from which a camera follows", f"fx, fy = {K[0, 0]:.4g}, {K[1, 1]:.4g}")
    sd = dict(zip(("fx", "fy", "cx", "cy", *NAMES), deviations.ravel()[:9].tolist(), strict=True))
    count = max((NAMES.index(n) + 1 for n in free), default=0)
    return Fit(
        K,
        tuple(dist.ravel()[:count].tolist()),
        {n: sd[n] for n in ("fx", "fy", "cx", "cy", *free)},
        float(rms),
        tuple((cv2.Rodrigues(r)[0], t.ravel()) for r, t in zip(rvecs, tvecs, strict=True)),
    )


def _calibration(views, image_size, board, model, result: Fit, wrong, outliers) -> Calibration:
    shown = []
    for i, view in enumerate(views):
        R, t = result.poses[i]
        rms = math.sqrt(float((_errors(view, board, result, i) ** 2).mean()))
        shown.append(View(view.photo, len(view.tags), rms, pose.rotation(R), tuple(t.tolist())))
    K = result.K
    calibration = Calibration(
        image_size=tuple(image_size),
        model=model,
        K=((float(K[0, 0]), 0.0, float(K[0, 2])), (0.0, float(K[1, 1]), float(K[1, 2])), (0.0, 0.0, 1.0)),
        dist=result.dist,
        sigma=result.sigma,
        rms_px=result.rms_px,
        views=tuple(shown),
    )
    doubts = judge.doubts(calibration, {v.photo: v.tags for v in views}, board, wrong, outliers)
    return msgspec.structs.replace(calibration, warnings=tuple(Warning_(*d) for d in doubts))


def _errors(view: Seen, board: Board, result: Fit, i: int) -> np.ndarray:
    points, pixels = pose.matched(view.tags, board)
    return np.linalg.norm(lens.project(points, *result.poses[i], result.K, result.dist) - pixels, axis=1)


def _check_enough(views: Sequence[Seen], wrong: dict[str, str], where: str) -> None:
    if len(views) < LEAST_VIEWS:
        reasons = "".join(f"; {name}: {why}" for name, why in list(wrong.items())[:3])
        raise InputError(where, f"at least {LEAST_VIEWS} photos that show the board", f"{len(views)}{reasons}")


def _check_model(model: str) -> None:
    if model != "auto" and model not in MODELS:
        raise InputError("model", f"one of auto, {', '.join(MODELS)}", repr(model))


def _five(dist: Sequence[float]) -> tuple[float, ...]:
    return (*dist, *(0.0,) * (5 - len(dist)))
