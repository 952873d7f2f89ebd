"""Photos of a board -> K and distortion, with standard deviations, poses, and warnings: detect, fit, choose, check.

The fit minimises the distance of tag centres (`fit`); lens model and the board's shape are chosen by how well they
predict unseen photos (`model`); the uncertainty follows from how the photos disagree (`uncertainty`).
"""

import itertools
import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np
from threadpoolctl import threadpool_limits

from raytwin.errors import InputError
from raytwin.images.photo_files import list_photos, photo_size, readable_photos
from raytwin.photos.boards import Board, read_board
from raytwin.photos.boards.board import spans_a_plane
from raytwin.photos.camera import lens_model, pose
from raytwin.photos.camera.bias import unbiased
from raytwin.photos.camera.calibration_result import Calibration, CalibrationWarning, Evidence, FoundBoard, View
from raytwin.photos.camera.detection import Find, Tag, detect, detect_photos
from raytwin.photos.camera.diagnostics import CheckInputs, coverage, line_of_sight, misfit, warnings_for
from raytwin.photos.camera.fit import INTRINSICS, MODELS, Fit, ModelSpec, Sighting, fit, matched
from raytwin.photos.camera.model import select_model
from raytwin.photos.camera.uncertainty import FitUncertainty, fit_uncertainty
from raytwin.progress import Progress, silent

LEAST_VIEWS = 3
"""Photos of the board: with fewer the camera is not determined."""

SAME_VIEW = 0.005
"""Share of the image's longer side: photos whose tags lie less than this apart (rms) are one view, as those of a burst.

Photos taken one by one are at least 0.0166 apart in the real sets, and 0.0104 in one that is deliberately alike."""

REPEATED = "the view of another photo, as in a burst or a video"
"""Why a photo is left out whose tags lie where another's do."""

ROUNDS = 3
"""Fits, each without the outliers and the detector's bias found by the one before; a fourth moves fx by less than a
tenth of its sigma, on a bent board too."""

PRELIMINARY = "k1k2"
"""The lens model that `auto` fits before it chooses: enough to find the detector's bias and the outliers."""

REMOVED = {"k1": "k1k2", "k1k2p1p2": "full5", "k1k2k3": "full5"}
"""Lens models that 0.2.0 removed -> the smallest that holds them."""

UNEXPLAINED = 0.05
"""Share of the distance between neighbouring tags: with a larger rms there is no camera.

Sound sets have at most 0.005, a fisheye of 150 degrees 0.04. Boards other than the file says: 0.07 and more."""

MAX_OFF_WIDTHS = 0.03
"""Before anything is fitted: a tag this share of the image's width off its view's homography is an outlier, far more
than any lens bends a board."""


def calibrate(
    photos: str | os.PathLike | Sequence[str | os.PathLike],
    board: str | os.PathLike | Board,
    model: str = "auto",
    progress: Progress = silent,
    find: Find = detect,
    threads: int | None = None,
) -> Calibration:
    """Return the camera that took `photos` of a board, with standard deviations and warnings.

    `photos` are files or folders, `board` a Board or its TOML file. `model`: auto, none, k1k2 or full5. `progress`,
    `find` and `threads` are those of `detect_photos`. Photos without tags or of another size, and files that cannot be
    read, are left out with a warning as long as three others remain. Raises InputError if no camera follows.
    """
    named = [photos] if isinstance(photos, str | os.PathLike) else photos
    listed = [list_photos(path) if path.is_dir() else [path] for path in map(Path, named)]
    paths = list(dict.fromkeys(path for some in listed for path in some))
    board = board if isinstance(board, Board) else read_board(board)
    where = str(paths[0].parent) if paths else "photos"
    _check_model(model)
    if len(paths) < LEAST_VIEWS:
        raise InputError(where, f"at least {LEAST_VIEWS} photos of the board, from different sides", len(paths))
    unique = len({p.name for p in paths}) == len(paths)
    shown = {str(p): p.name if unique else str(p) for p in paths}
    paths, broken = readable_photos(paths)
    paths, image_size, others = _of_one_size(paths)
    found, without = detect_photos(paths, board.family, progress, find, threads)
    wrong = {str(photo): why for photo, why in (broken | others).items()} | without
    progress("fit", 0, 1)
    result = calibrate_detections(
        {shown[p]: tags for p, tags in found.items()},
        image_size, board, model, where, {shown[p]: why for p, why in wrong.items()},
    )  # fmt: skip
    progress("fit", 1, 1)
    by_path = {p: tuple(tags) for p, tags in found.items()}
    return msgspec.structs.replace(result, evidence=msgspec.structs.replace(result.basis, found=by_path))


# BLAS sums in another order on several threads: the last bits would depend on their number, and nothing is faster.
@threadpool_limits.wrap(limits=1, user_api="blas")
def calibrate_detections(
    detections: Mapping[str, Sequence[Tag]],
    image_size: tuple[int, int],
    board: Board,
    model: str = "auto",
    where: str = "photos",
    wrong: Mapping[str, str] | None = None,
) -> Calibration:
    """The same from tags already found, by photo. `wrong` says of other photos why they have none."""
    _check_model(model)
    wrong = dict(wrong or {})
    if not any(detections.values()):
        seen = "; ".join(f"{name}: {why}" for name, why in list(wrong.items())[:3])
        raise InputError(where, f"photos of {board.family} tags", seen or "none")
    pose.check_tags(list(detections.values()), board, where)
    _check_inside(detections, image_size)
    distinct = _distinct(detections, image_size)
    wrong |= dict.fromkeys((photo for photo in detections if photo not in distinct), REPEATED)
    views, straight = _first_views(distinct, image_size, board, wrong)
    _check_enough(views, wrong, where)
    pose.check_places(sum(len(v.tags) for v in straight), sum(len(v.tags) for v in views), where)
    result = fit(straight, image_size, board, ModelSpec(PRELIMINARY if model == "auto" else model))
    for _ in range(ROUNDS):
        # This fit reveals the detector's bias and the outliers; without both, the next fit is better.
        views, straight = _inliers(views, board, result, wrong)
        _check_enough(views, wrong, where)
        result, held_out, gap = select_model(straight, image_size, board, model, result)
    _check_explained(result, where)
    read = [{t.id for t in v.tags} for v in views]
    outliers = {v.photo: sorted(ids - {t.id for t in v.tags}) for ids, v in zip(read, straight, strict=True)}
    known = fit_uncertainty(result, gap)
    made = _calibration(straight, board, result, known, held_out, detections)
    warnings = warnings_for(CheckInputs(made, result, known, straight, board, wrong, outliers))
    return msgspec.structs.replace(made, warnings=tuple(CalibrationWarning(*w) for w in warnings))


def _distinct(detections: Mapping[str, Sequence[Tag]], image_size: tuple[int, int]) -> dict[str, Sequence[Tag]]:
    """One photo of each view.

    What pulls a view's tags astray is the same in its copies: counted as views, they make sigma too small.
    """
    column = {tag: i for i, tag in enumerate({t.id for tags in detections.values() for t in tags})}
    places = np.full((len(detections), len(column), 2), np.nan)
    for row, tags in zip(places, detections.values(), strict=True):
        row[[column[t.id] for t in tags]] = np.array([t.center for t in tags]).reshape(-1, 2)
    kept = list[int]()
    for i in range(len(places)):
        square = ((places[kept] - places[i]) ** 2).sum(axis=-1)
        both = np.isfinite(square).sum(axis=1)
        if not ((both >= 4) & (np.nansum(square, axis=1) < both * (SAME_VIEW * max(image_size)) ** 2)).any():
            kept.append(i)
    names = list(detections)
    return {names[i]: detections[names[i]] for i in kept}


def _first_views(
    detections: Mapping[str, Sequence[Tag]],
    image_size: tuple[int, int],
    board: Board,
    wrong: dict[str, str],
) -> tuple[list[Sighting], list[Sighting]]:
    """The board in the photos, in the photos' order: all its tags, and those that one homography agrees with."""
    views, straight = [], []
    known, flat = board.centers(), board.flat()
    for photo, seen in detections.items():
        tags = [t for t in seen if t.id in known]
        points, pixels = matched(tags, flat)
        inside = np.zeros(len(tags), bool)
        if spans_a_plane(points[:, :2]):
            inside = pose.consistent(points, pixels, MAX_OFF_WIDTHS * image_size[0])
        kept = tuple(itertools.compress(tags, inside))
        if spans_a_plane(flat.points(t.id for t in kept)[:, :2]):
            views.append(Sighting(photo, tuple(tags)))
            straight.append(Sighting(photo, kept))
        else:
            wrong.setdefault(photo, f"{len(tags)} tags of the board, too few or in one line")
    return views, straight


def _shaped(board: Board, result: Fit) -> Board:
    return msgspec.structs.replace(board, offsets=result.offsets(board))


def _inliers(
    views: Sequence[Sighting], board: Board, result: Fit, wrong: dict[str, str]
) -> tuple[list[Sighting], list[Sighting]]:
    """The views that keep enough tags by `result`: all their tags, and the inliers without the detector's bias.

    Every tag is tested again, so that one which an outlier had pulled away comes back.
    """
    moved, errors = [], []
    shaped = _shaped(board, result)
    for view, R, t in zip(views, result.R, result.t, strict=True):
        tags = unbiased(view.tags, shaped, R, t, result.K, result.dist)
        points, pixels = matched(tags, shaped)
        moved.append(tags)
        errors.append(np.linalg.norm(lens_model.project(points, R, t, result.K, result.dist) - pixels, axis=1))
    limit = pose.outlier_limit(np.concatenate(errors))
    kept, straight = [], []
    for view, tags, error in zip(views, moved, errors, strict=True):
        inside = tuple(t for t, e in zip(tags, error, strict=True) if e <= limit)
        if spans_a_plane(shaped.points(t.id for t in inside)[:, :2]):
            kept.append(view)
            straight.append(Sighting(view.photo, inside))
        else:
            wrong[view.photo] = "too few of its tags agree with the camera of the others: another camera or zoom?"
    return kept, straight


def _calibration(
    views: Sequence[Sighting],
    board: Board,
    result: Fit,
    known: FitUncertainty,
    held_out: dict[str, float],
    detections: Mapping[str, Sequence[Tag]],
) -> Calibration:
    names, seen, there = result.form.names, result.observations, result.observations.seen
    sigma = np.sqrt(np.diag(known.covariance)[: len(names)])
    moved = known.moves[:, : len(INTRINSICS)] / np.maximum(sigma[: len(INTRINSICS)], 1e-300)
    influence = np.sqrt((moved**2).mean(axis=1)).tolist()
    rms = np.sqrt((result.residuals**2).sum(axis=(1, 2)) / there.sum(axis=1)).tolist()
    shown = tuple(
        View(view.photo, len(view.tags), rms[i], pose.rotation(result.R[i]), tuple(result.t[i].tolist()), influence[i])
        for i, view in enumerate(views)
    )
    cosine = line_of_sight(result, board)
    evidence = Evidence(
        coverage=coverage(seen.pixels[there], seen.image_size),
        tilts=tuple(np.degrees(np.arccos(np.clip(np.abs(cosine), 0, 1))).tolist()),
        held_out_px=held_out,
        taken=str(result.form),
        board=_shaped(board, result),
        seen=tuple(map(tuple, seen.pixels[there].tolist())),
        residuals=tuple(map(tuple, result.residuals[there].tolist())),
        found={photo: tuple(tags) for photo, tags in detections.items()},
    )
    return Calibration(
        image_size=(int(seen.image_size[0]), int(seen.image_size[1])),
        model=result.form.model,
        K=pose.rotation(result.K),
        dist=result.dist,
        sigma=dict(zip(names, sigma.tolist(), strict=True)),
        rms_px=result.rms_px,
        views=shown,
        board=_found_board(board, result, known),
        evidence=evidence,
    )


def _found_board(board: Board, result: Fit, known: FitUncertainty) -> FoundBoard:
    if not result.form.bent:
        return FoundBoard()
    height, across = result.free[:, 2], np.zeros(len(result.shared))
    across[len(result.form.names) + 3 * np.array([height.argmax(), height.argmin()]) + 2] = 1, -1
    sigma = math.sqrt(max(float(across @ known.covariance @ across), 0.0))
    return FoundBoard(result.offsets(board), 1e3 * float(np.ptp(height)), 1e3 * sigma)


def _of_one_size(paths: Sequence[Path]) -> tuple[list[Path], tuple[int, int], dict[Path, str]]:
    """The photos of the commonest size, that size, and why the others are left out.

    Those a quarter turn from the others are left out too: their pixels were turned after the lens had drawn them, and
    its centre and its axes with them.
    """
    sizes = dict(zip(paths, map(photo_size, paths), strict=True))
    size, count = Counter(sizes.values()).most_common(1)[0]
    w, h = size
    others = [p for p in paths if sizes[p] != size]
    if others and count < LEAST_VIEWS:
        raise InputError(others[0], f"{w} x {h} pixels, as other photos have", "{} x {}".format(*sizes[others[0]]))
    kept = [p for p in paths if sizes[p] == size]
    return kept, size, {p: "{} x {} pixels where most have {} x {}".format(*sizes[p], w, h) for p in others}


def _check_inside(detections: Mapping[str, Sequence[Tag]], image_size: tuple[int, int]) -> None:
    width, height = image_size
    for photo, tags in detections.items():
        for tag in tags:
            u, v = tag.center
            if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
                inside = -0.5 <= u <= height - 0.5 and -0.5 <= v <= width - 0.5
                hint = " (width and height swapped?)" if inside else ""
                raise InputError(photo, f"tags inside {width} x {height} pixels", f"one at {u:.0f}, {v:.0f}{hint}")


def _check_enough(views: Sequence[Sighting], wrong: dict[str, str], where: str) -> None:
    if len(views) < LEAST_VIEWS:
        reasons = "".join(f"; {name}: {why}" for name, why in list(wrong.items())[:3])
        raise InputError(where, f"at least {LEAST_VIEWS} photos that show the board", f"{len(views)}{reasons}")


def _check_explained(result: Fit, where: str) -> None:
    if (share := misfit(result)) > UNEXPLAINED:
        limit = UNEXPLAINED / share * result.rms_px
        got = f"{result.rms_px:.3g} px: the board's file does not describe this board, or the lens is a fisheye"
        raise InputError(where, f"tags at most {limit:.2g} px (rms) off where some camera sees them", got)


def _check_model(model: str) -> None:
    if model != "auto" and model not in MODELS:
        instead = f", which 0.2.0 removed: use {REMOVED[model]}" if model in REMOVED else ""
        raise InputError("model", f"one of auto, {', '.join(MODELS)}", repr(model) + instead)
