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
from raytwin.photos.camera import pose
from raytwin.photos.camera.bias import unbiased
from raytwin.photos.camera.calibration_result import Calibration, Evidence, FoundBoard, View
from raytwin.photos.camera.detection import Tag, detect_photos
from raytwin.photos.camera.diagnostics import coverage, line_of_sight, misfit, warnings_for
from raytwin.photos.camera.fit import LENS, MODELS, Fit, ModelSpec, Views, fit
from raytwin.photos.camera.model import covariance, select_model
from raytwin.progress import Progress, silent

LEAST_VIEWS = 3
"""Photos of the board: with fewer the camera is not determined."""

SAME_VIEW = 0.005
"""Share of the image's longer side: photos whose tags lie less than this apart (rms) are one view, as those of a burst.
(Photos taken one by one: at least 0.0104, in a set that is deliberately alike.)"""

ROUNDS = 3
"""Fits, each without the outliers and the detector's bias found by the one before; a fourth moves fx by less than a
tenth of its sigma, on a bent board too."""

REMOVED = {"k1": "k1k2", "k1k2p1p2": "full5", "k1k2k3": "full5"}
"""Lens models that 0.2.0 removed -> the smallest that holds them."""

UNEXPLAINED = 0.05
"""Share of the distance between neighbouring tags: with a larger rms there is no camera. (A fisheye of 150 degrees:
0.04. Boards other than the file says: 0.07 and more.)"""


def calibrate(
    photos: str | os.PathLike | Sequence[str | os.PathLike],
    board: str | os.PathLike | Board,
    model: str = "auto",
    progress: Progress = silent,
) -> Calibration:
    """Return the camera that took `photos` of a board, with standard deviations and warnings.

    `photos` are files or folders, `board` a Board or its TOML file. `model`: auto, none, k1k2 or full5. Photos without
    tags or of another size, and files that cannot be read, are left out with a warning as long as three others remain.
    Raises InputError if no camera follows.
    """
    named = [photos] if isinstance(photos, str | os.PathLike) else photos
    listed = [list_photos(path) if path.is_dir() else [path] for path in map(Path, named)]
    paths = list(dict.fromkeys(itertools.chain(*listed)))
    board = board if isinstance(board, Board) else read_board(board)
    where = str(paths[0].parent) if paths else "photos"
    _check_model(model)
    if len(paths) < LEAST_VIEWS:
        raise InputError(where, f"at least {LEAST_VIEWS} photos of the board, from different sides", len(paths))
    unique = len({p.name for p in paths}) == len(paths)
    shown = {str(p): p.name if unique else str(p) for p in paths}
    paths, broken = readable_photos(paths)
    paths, image_size, others = _of_one_size(paths)
    found, without = detect_photos(paths, board.family, progress)
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
    pose.check_tags(itertools.chain(*detections.values()), board, where)
    _check_inside(detections, image_size, where)
    views = _distinct(detections, SAME_VIEW * max(image_size), board, wrong)
    agree = [pose.consistent(tags, board.flat(), [t.center for t in tags]) for tags in views.values()]
    straight = _kept(views, agree, "too few tags of the board, or all in one line", wrong, board, where)
    pose.check_places(sum(map(len, straight.values())), sum(len(views[photo]) for photo in straight), where)
    # Each fit, even one of k1k2, reveals the detector's bias and the outliers; without both, the next is better.
    result = fit(straight, image_size, board, ModelSpec("k1k2" if model == "auto" else model))
    for _ in range(ROUNDS):
        # Every tag is tested again, so that one which an outlier had pulled away comes back.
        bent, stands = result.shaped(board), result.stands
        moved = {photo: unbiased(views[photo], bent, *at) for photo, at in zip(straight, stands, strict=True)}
        errors = [pose.distances(tags, bent, *at) for tags, at in zip(moved.values(), stands, strict=True)]
        limit = pose.outlier_limit(np.concatenate(errors))
        why = "too few of its tags agree with the camera of the others: another camera or zoom?"
        straight = _kept(moved, [error <= limit for error in errors], why, wrong, board, where)
        result, held_out, gap = select_model(straight, image_size, board, model, result)
    if (share := misfit(result)) > UNEXPLAINED:
        limit = UNEXPLAINED / share * result.rms_px
        got = f"{result.rms_px:.3g} px: the board's file does not describe this board, or the lens is a fisheye"
        raise InputError(where, f"tags at most {limit:.2g} px (rms) off where some camera sees them", got)
    rejected = {photo: {t.id for t in views[photo]} - {t.id for t in tags} for photo, tags in straight.items()}
    found = {photo: tuple(tags) for photo, tags in detections.items()}
    made = _calibration(straight, image_size, board, result, gap)
    evidence = msgspec.structs.replace(made.basis, held_out_px=held_out, found=found)
    warnings = warnings_for(made, result, straight, wrong, rejected)
    return msgspec.structs.replace(made, warnings=warnings, evidence=evidence)


def _distinct(detections: Views, apart: float, board: Board, wrong: dict[str, str]) -> dict[str, list[Tag]]:
    """The board's tags in one photo of each view.

    What pulls a view's tags astray is the same in its copies: counted as views, they make sigma too small.
    """
    known, kept, places = board.centers(), dict[str, list[Tag]](), list[dict[int, np.ndarray]]()
    for photo, seen in detections.items():
        tags = [t for t in seen if t.id in known]
        at = {t.id: np.array(t.center) for t in tags}
        both = [np.array([at[i] - there[i] for i in at.keys() & there.keys()]) for there in places]
        if any(len(off) >= 4 and (off**2).sum(axis=1).mean() < apart**2 for off in both):
            wrong[photo] = "the view of another photo, as in a burst or a video"
        else:
            kept[photo] = tags
            places.append(at)
    return kept


def _kept(
    views: Views, inside: Sequence[np.ndarray], why: str, wrong: dict[str, str], board: Board, where: str
) -> dict[str, list[Tag]]:
    """By photo, the tags that are `inside` (a mask by photo); `wrong` gets `why` of the photos with too few."""
    tags = {photo: list(itertools.compress(views[photo], mask)) for photo, mask in zip(views, inside, strict=True)}
    kept = {photo: some for photo, some in tags.items() if spans_a_plane(board.points(t.id for t in some)[:, :2])}
    wrong |= {photo: why for photo in views if photo not in kept}
    if len(kept) < LEAST_VIEWS:
        reasons = "".join(f"; {name}: {of}" for name, of in list(wrong.items())[:3])
        raise InputError(where, f"at least {LEAST_VIEWS} photos that show the board", f"{len(kept)}{reasons}")
    return kept


def _calibration(views: Views, image_size: tuple[int, int], board: Board, result: Fit, gap: np.ndarray) -> Calibration:
    """Without warnings; its evidence without the models' errors and what was detected."""
    names, there, shaped = result.form.names, result.observations.seen, result.shaped(board)
    moves, _ = result.leave_one_out()
    known = covariance(result, moves, gap)
    sigma = np.sqrt(np.diag(known)[: len(names)])
    influence = np.sqrt(((moves[:, :4] / np.maximum(sigma[:4], 1e-300)) ** 2).mean(axis=1)).tolist()
    rms = np.sqrt((result.residuals**2).sum(axis=(1, 2)) / there.sum(axis=1)).tolist()
    each = zip(views.items(), rms, map(pose.rotation, result.R), map(tuple, result.t.tolist()), influence, strict=True)
    tilts = np.degrees(np.arccos(np.clip(np.abs(line_of_sight(result, board)), 0, 1)))
    pixels, bent = result.observations.pixels[there], FoundBoard()
    if shaped.offsets is not None:
        height, across = result.shared[LENS + 2 :: 3], np.zeros(len(known))
        across[LENS + 2 + 3 * np.array([height.argmax(), height.argmin()])] = 1, -1
        sd = math.sqrt(max(float(across @ known @ across), 0.0))
        bent = FoundBoard(shaped.offsets, 1e3 * float(np.ptp(height)), 1e3 * sd)
    evidence = Evidence(
        coverage=coverage(pixels, image_size),
        tilts=tuple(tilts.tolist()),
        held_out_px={},
        taken=str(result.form),
        board=shaped,
        seen=tuple(map(tuple, pixels.tolist())),
        residuals=tuple(map(tuple, result.residuals[there].tolist())),
        found={},
    )
    return Calibration(
        image_size=image_size,
        model=result.form.model,
        K=pose.rotation(result.K),
        dist=result.dist,
        sigma=dict(zip(names, sigma.tolist(), strict=True)),
        rms_px=result.rms_px,
        views=tuple(View(photo, len(tags), *rest) for (photo, tags), *rest in each),
        board=bent,
        evidence=evidence,
    )


def _of_one_size(paths: Sequence[Path]) -> tuple[list[Path], tuple[int, int], dict[Path, str]]:
    """The photos of the commonest size, that size, and why the others are left out.

    Those a quarter turn from the others are left out too: their pixels were turned after the lens had drawn them, and
    its centre and its axes with them.
    """
    sizes = dict(zip(paths, map(photo_size, paths), strict=True))
    (w, h), count = Counter(sizes.values()).most_common(1)[0]
    others = {p: "{} x {}".format(*size) for p, size in sizes.items() if size != (w, h)}
    if others and count < LEAST_VIEWS:
        raise InputError(next(iter(others)), f"{w} x {h} pixels, as other photos have", next(iter(others.values())))
    wrong = {p: f"{size} pixels where most have {w} x {h}" for p, size in others.items()}
    return [p for p in paths if p not in others], (w, h), wrong


def _check_inside(detections: Views, image_size: tuple[int, int], where: str) -> None:
    width, height = image_size
    for u, v in (tag.center for tags in detections.values() for tag in tags):
        if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
            raise InputError(where, f"tags inside {width} x {height} pixels", f"one at {u:.0f}, {v:.0f}")


def _check_model(model: str) -> None:
    if model != "auto" and model not in MODELS:
        instead = f", which 0.2.0 removed: use {REMOVED[model]}" if model in REMOVED else ""
        raise InputError("model", f"one of auto, {', '.join(MODELS)}", repr(model) + instead)
