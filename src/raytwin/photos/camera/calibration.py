"""Photos of a board -> K and distortion, with standard deviations, poses, and warnings: detect, fit, choose, check."""

import itertools
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np
from threadpoolctl import threadpool_limits

from raytwin.errors import InputError, check_one_of
from raytwin.images.photo_files import list_photos, photo_size, readable_photos
from raytwin.photos.boards import Board, read_board
from raytwin.photos.camera import pose
from raytwin.photos.camera.bias import unbiased
from raytwin.photos.camera.calibration_result import Calibration, Evidence, FoundBoard, View
from raytwin.photos.camera.detection import Tag, detect_photos
from raytwin.photos.camera.diagnostics import warnings_for
from raytwin.photos.camera.fit import LENS, MODELS, Fit, ModelSpec, Views, fit
from raytwin.photos.camera.model import covariance, select_model
from raytwin.progress import Progress, silent

LEAST_VIEWS = 3
"""Photos of the board: with fewer the camera is not determined."""

ROUNDS = 3
"""Number of times the model is chosen and fitted, each without the outliers and the detector's bias that the fit before
found. A fourth moves fx by less than a tenth of its sigma."""


def calibrate(
    photos: str | os.PathLike | Sequence[str | os.PathLike],
    board: str | os.PathLike | Board,
    model: str = "auto",
    progress: Progress = silent,
) -> Calibration:
    """Return the camera that took `photos` of a board, with standard deviations and warnings.

    `photos` are files or folders, `board` a Board or its TOML file. `model`: auto, none, k1k2 or full5. Photos without
    tags and files that cannot be read are left out with a warning as long as three others remain. Raises InputError if
    no camera follows, and for photos of several sizes.
    """
    named = [photos] if isinstance(photos, str | os.PathLike) else photos
    listed = [list_photos(path) if path.is_dir() else [path] for path in map(Path, named)]
    paths = list(dict.fromkeys(itertools.chain(*listed)))
    board = board if isinstance(board, Board) else read_board(board)
    where = str(paths[0].parent) if paths else "photos"
    check_one_of("model", model, ("auto", *MODELS))
    if len(paths) < LEAST_VIEWS:
        raise InputError(where, f"at least {LEAST_VIEWS} photos of the board, from different sides", len(paths))
    unique = len({p.name for p in paths}) == len(paths)
    shown = {str(p): p.name if unique else str(p) for p in paths}
    paths, broken = readable_photos(paths)
    image_size = photo_size(paths[0])
    for path in paths:
        if (size := photo_size(path)) != image_size:
            want = "{} x {} pixels, as the first photo has: leave out one of the two".format(*image_size)
            raise InputError(path, want, "{} x {}".format(*size))
    found, without = detect_photos(paths, board.family, progress)
    wrong = {shown[str(photo)]: why for photo, why in (broken | without).items()}
    progress("fit", 0, 1)
    tags = {shown[photo]: seen for photo, seen in found.items()}
    result = calibrate_detections(tags, image_size, board, model, where, wrong)
    progress("fit", 1, 1)
    return result


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
    """Return the camera from the tags found in each photo. `wrong`: why other photos have none, by photo."""
    wrong = dict(wrong or {})
    if not any(detections.values()):
        seen = "; ".join(f"{name}: {why}" for name, why in list(wrong.items())[:3])
        raise InputError(where, f"photos of {board.family} tags", seen or "none")
    pose.check_tags(itertools.chain(*detections.values()), board, where)
    views = {photo: [tag for tag in tags if tag.id in board.centers()] for photo, tags in detections.items()}
    agree = [pose.consistent(tags, board.flat(), [t.center for t in tags]) for tags in views.values()]
    straight = _kept(views, agree, "too few tags of the board, or all in one line", wrong, board, where)
    pose.check_places(sum(map(len, straight.values())), sum(len(views[photo]) for photo in straight), where)
    result = fit(straight, image_size, board, ModelSpec("k1k2" if model == "auto" else model))
    for _ in range(ROUNDS):
        # Every tag is tested again: one that an outlier had pulled away comes back.
        bent, stands = result.shaped(board), result.stands
        moved = {photo: unbiased(views[photo], bent, *at) for photo, at in zip(straight, stands, strict=True)}
        errors = [pose.distances(tags, bent, *at) for tags, at in zip(moved.values(), stands, strict=True)]
        limit = pose.outlier_limit(np.concatenate(errors))
        why = "too few of its tags agree with the camera of the others: another camera or zoom?"
        straight = _kept(moved, [error <= limit for error in errors], why, wrong, board, where)
        result, held_out, gap = select_model(straight, image_size, board, model, result)
    rejected = {photo: {t.id for t in views[photo]} - {t.id for t in tags} for photo, tags in straight.items()}
    made = _calibration(straight, image_size, board, result, held_out, gap)
    return msgspec.structs.replace(made, warnings=warnings_for(made, result, straight, board, wrong, rejected))


def _kept(
    views: Views, inside: Sequence[np.ndarray], why: str, wrong: dict[str, str], board: Board, where: str
) -> dict[str, list[Tag]]:
    """By photo, the tags that are `inside` (a mask per photo). Photos with too few go to `wrong`, with `why`."""
    tags = {photo: list(itertools.compress(views[photo], mask)) for photo, mask in zip(views, inside, strict=True)}
    kept = {photo: some for photo, some in tags.items() if pose.spans_a_plane(some, board)}
    wrong |= {photo: why for photo in views if photo not in kept}
    if len(kept) < LEAST_VIEWS:
        reasons = "".join(f"; {name}: {of}" for name, of in list(wrong.items())[:3])
        raise InputError(where, f"at least {LEAST_VIEWS} photos that show the board", f"{len(kept)}{reasons}")
    return kept


def _calibration(
    views: Views, image_size: tuple[int, int], board: Board, result: Fit, held_out: dict[str, float], gap: np.ndarray
) -> Calibration:
    """Without warnings."""
    names, is_seen, shaped = result.form.names, result.observations.seen, result.shaped(board)
    moves, _ = result.leave_one_out()
    cov = covariance(result, moves, gap)
    sigma = np.sqrt(np.diag(cov)[: len(names)])
    influence = np.sqrt(((moves[:, :4] / np.maximum(sigma[:4], 1e-300)) ** 2).mean(axis=1)).tolist()
    rms = np.sqrt((result.residuals**2).sum(axis=(1, 2)) / is_seen.sum(axis=1)).tolist()
    each = zip(views.items(), rms, map(pose.rotation, result.R), map(tuple, result.t.tolist()), influence, strict=True)
    bent = FoundBoard()
    if shaped.offsets is not None:
        height, across = result.shared[LENS + 2 :: 3], np.zeros(len(cov))
        across[LENS + 2 + 3 * np.array([height.argmax(), height.argmin()])] = 1, -1
        sd = math.sqrt(max(float(across @ cov @ across), 0.0))
        bent = FoundBoard(shaped.offsets, 1e3 * float(np.ptp(height)), 1e3 * sd)
    seen, off = (tuple(map(tuple, of[is_seen].tolist())) for of in (result.observations.pixels, result.residuals))
    return Calibration(
        image_size=image_size,
        model=result.form.model,
        K=pose.rotation(result.K),
        dist=result.dist,
        sigma=dict(zip(names, sigma.tolist(), strict=True)),
        rms_px=result.rms_px,
        views=tuple(View(photo, len(tags), *rest) for (photo, tags), *rest in each),
        board=bent,
        evidence=Evidence(held_out, str(result.form), shaped, seen, off),
    )
