"""Photos of a board -> K and distortion, with standard deviations, poses, and doubts: detect, fit, doubt.

The fit is on tag centres (`fit`); the lens model is the smallest that predicts views it has not seen (`selection`).
"""

import math
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin import files
from raytwin.boards.board import Board, spans_a_plane
from raytwin.errors import InputError
from raytwin.photos import lens, pose, uncertainty
from raytwin.photos.bias import unbiased
from raytwin.photos.detection import Find, Tag, detect, detect_photos
from raytwin.photos.doubts import coverage, doubts_about, tilts
from raytwin.photos.fit import MODELS, Fit, Seen, fit
from raytwin.photos.model import ModelTrial, select_model
from raytwin.progress import Progress, silent
from raytwin.scene import Matrix, Record, Vector

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
    """A doubt: `code` is stable (doubts.CODES), `text` is for people."""

    code: str
    text: str


class Calibration(Record, frozen=True):
    """The camera and how well it is known; its fields, `evidence` aside, are the keys of the JSON.

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
    evidence: uncertainty.Evidence | None = None

    def numbers(self) -> dict[str, Any]:
        """What the JSON holds."""
        return {k: v for k, v in msgspec.structs.asdict(self).items() if k != "evidence"}


def calibrate(
    photos: Sequence[str | os.PathLike],
    board: Board,
    model: str = "auto",
    progress: Progress = silent,
    find: Find = detect,
    threads: int | None = None,
) -> Calibration:
    """The camera that took `photos`, all of one size, of one board. `find`, `threads`: see `detect_photos`.

    Photos without tags are left out with a warning as long as three others remain. Raises InputError for anything
    from which no camera follows.
    """
    paths = [Path(p) for p in photos]
    where = str(paths[0].parent) if paths else "photos"
    _check_model(model)
    if len(paths) < LEAST_VIEWS:
        raise InputError(where, f"at least {LEAST_VIEWS} photos of the board, from different sides", len(paths))
    paths, image_size, doubts = _of_one_size(paths)
    found, wrong = detect_photos(paths, board.family, progress, find, threads)
    unique = len({p.name for p in paths}) == len(paths)
    name = {str(p): p.name if unique else str(p) for p in paths}
    progress("fit", 0, 1)
    result = calibrate_detections(
        {name[p]: tags for p, tags in found.items()},
        image_size,
        board,
        model,
        where,
        {name[p]: why for p, why in wrong.items()},
        doubts,
    )
    progress("fit", 1, 1)
    return result


def calibrate_detections(
    detections: dict[str, Sequence[Tag]],
    image_size: tuple[int, int],
    board: Board,
    model: str = "auto",
    where: str = "photos",
    wrong: dict[str, str] | None = None,
    doubts: Sequence[Warning_] = (),
) -> Calibration:
    """The same from tags already found, by photo.

    `wrong` says of other photos why they have none, `doubts` are about the photos themselves.
    """
    _check_model(model)
    wrong = dict(wrong or {})
    if not any(detections.values()):
        seen = "; ".join(f"{name}: {why}" for name, why in list(wrong.items())[:3])
        raise InputError(where, f"photos of {board.family} tags", seen or "none")
    pose.check_ids(list(detections.values()), board, where)
    _check_inside(detections, image_size)
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
    trials: dict[str, ModelTrial] = {}
    chosen = PRELIMINARY if model == "auto" else model
    for turn in range(ROUNDS):
        # The fit tells the detector's bias and the outliers; without both, the next fit is a better one.
        if model == "auto" and turn == 1:
            chosen, trials = select_model(straight, image_size, board)
        result = fit(straight, image_size, board, chosen)
        if turn < ROUNDS - 1:
            views, straight = _inliers(views, board, result, wrong)
            _check_enough(views, wrong, where)
    outliers = {
        v.photo: sorted({t.id for t in v.tags} - {t.id for t in s.tags}) for v, s in zip(views, straight, strict=True)
    }
    found = _calibration(straight, image_size, board, chosen, result, trials)
    more = doubts_about(found, {v.photo: v.tags for v in straight}, board, wrong, outliers)
    return msgspec.structs.replace(found, warnings=(*doubts, *(Warning_(*d) for d in more)))


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


def _calibration(views, image_size, board, model, result: Fit, trials: dict[str, ModelTrial]) -> Calibration:
    shown = []
    for i, view in enumerate(views):
        R, t = result.poses[i]
        rms = math.sqrt(float((_errors(view, board, result, i) ** 2).mean()))
        shown.append(View(view.photo, len(view.tags), rms, pose.rotation(R), tuple(t.tolist())))
    K = result.K
    middle = np.append(np.mean(list(board.centers().values()), axis=0), 0.0)
    seen = tuple(tuple(map(float, t.center)) for v in views for t in v.tags)
    evidence = uncertainty.Evidence(
        coverage=coverage(np.array(seen), image_size),
        tilts=tuple(tilts(shown, board)),
        distance=float(np.median([np.linalg.norm(R @ middle + t) for R, t in result.poses])),
        covariance=tuple(map(tuple, uncertainty.covariance(views, board, result, model).tolist())),
        trials=trials,
        seen=seen,
    )
    return Calibration(
        image_size=tuple(image_size),
        model=model,
        K=((float(K[0, 0]), 0.0, float(K[0, 2])), (0.0, float(K[1, 1]), float(K[1, 2])), (0.0, 0.0, 1.0)),
        dist=result.dist,
        sigma=result.sigma,
        rms_px=result.rms_px,
        views=tuple(shown),
        evidence=evidence,
    )


def _errors(view: Seen, board: Board, result: Fit, i: int) -> np.ndarray:
    points, pixels = pose.matched(view.tags, board)
    return np.linalg.norm(lens.project(points, *result.poses[i], result.K, result.dist) - pixels, axis=1)


def _of_one_size(paths: Sequence[Path]) -> tuple[list[Path], tuple[int, int], list[Warning_]]:
    """The photos of the commonest size, that size, and doubts about which way up the photos are.

    Photos a quarter turn from the others are left out: their pixels were turned after the lens had drawn them, and its
    centre and its axes with them. Any other size is an error.
    """
    sizes = dict(zip(paths, map(files.photo_size, paths), strict=True))
    size = Counter(sizes.values()).most_common(1)[0][0]
    example = next(p for p in paths if sizes[p] == size)
    kept = [p for p in paths if sizes[p] == size]
    swapped = [p for p in paths if sizes[p] == size[::-1] != size]
    expected = f"{size[0]} x {size[1]} pixels, as {example.name} has"
    for path in paths:
        w, h = sizes[path]
        if path not in kept and path not in swapped:
            raise InputError(path, expected, f"{w} x {h}")
        if path in swapped and len(kept) < LEAST_VIEWS:
            raise InputError(path, expected, f"{w} x {h}: the same, turned by a quarter")
    doubts = []
    if swapped:
        w, h = size
        text = f"left out, being {h} x {w} where the others are {w} x {h}: pixels turned after the photo was taken"
        doubts.append(Warning_("swapped-orientation", f"{_some(swapped)}: {text}"))
    by_turn: dict[int, list[Path]] = {}
    for path in kept:
        by_turn.setdefault(files.photo_orientation(path), []).append(path)
    if len(by_turn) > 1:
        groups = sorted(by_turn.items(), key=lambda group: -len(group[1]))
        text = "; ".join(f"{turn} in {len(of)} ({_some(of)})" for turn, of in groups)
        doubts.append(
            Warning_("mixed-orientation", f"EXIF orientations differ: {text}: sound only if no pixels were ever turned")
        )
    return kept, size, doubts


def _some(paths: Sequence[Path]) -> str:
    return ", ".join([p.name for p in paths[:3]] + ["..."] * (len(paths) > 3))


def _check_inside(detections: dict[str, Sequence[Tag]], image_size: tuple[int, int]) -> None:
    width, height = image_size
    for photo, tags in detections.items():
        for tag in tags:
            u, v = tag.center
            if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
                inside = -0.5 <= u <= height - 0.5 and -0.5 <= v <= width - 0.5
                hint = " (width and height swapped?)" if inside else ""
                raise InputError(photo, f"tags inside {width} x {height} pixels", f"one at {u:.0f}, {v:.0f}{hint}")


def _check_enough(views: Sequence[Seen], wrong: dict[str, str], where: str) -> None:
    if len(views) < LEAST_VIEWS:
        reasons = "".join(f"; {name}: {why}" for name, why in list(wrong.items())[:3])
        raise InputError(where, f"at least {LEAST_VIEWS} photos that show the board", f"{len(views)}{reasons}")


def _check_model(model: str) -> None:
    if model != "auto" and model not in MODELS:
        raise InputError("model", f"one of auto, {', '.join(MODELS)}", repr(model))
