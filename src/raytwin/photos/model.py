"""Which distortion model: the smallest that predicts views it has not seen, by cross-validation over the views."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import cv2

from raytwin.boards.board import Board
from raytwin.errors import InputError
from raytwin.photos import lens, pose
from raytwin.photos.fit import MODELS, NAMES, Fit, Seen, fit
from raytwin.scene import Record
from raytwin.scene.lens import undone

LADDER = ("none", "k1", "k1k2", "k1k2k3", "full5")
"""What `auto` chooses from, smallest first; each adds coefficients to the one before."""

WITHIN, SIGNIFICANT, FOLDS = 1.05, 3.0, 5
"""`auto` takes the smallest model whose held-out error is within 5 % of the best and whose newest coefficients exceed
3 standard deviations; held-out by turns is a fifth of the views."""


class ModelTrial(Record, frozen=True):
    """What came of fitting one model: its held-out error in pixels, infinite where no fit converges, and `doubt`.

    `doubt` says why the model is unsound, and is empty where it is sound.
    """

    held_out_px: float
    doubt: str = ""

    @property
    def sound(self) -> bool:
        return not self.doubt


def select_model(views: Sequence[Seen], image_size: tuple[int, int], board: Board) -> tuple[str, dict[str, ModelTrial]]:
    """The smallest sound model within 5 % of the best held-out error; and what came of each model.

    Sound: the fit converges, its distortion can be undone over the whole image, and what the model adds to the
    next smaller one exceeds 3 standard deviations. Where none is, `none` is taken.
    """
    trials: dict[str, ModelTrial] = {}
    smaller: tuple[str, ...] = ()
    for model in LADDER:
        try:
            whole = fit(views, image_size, board, model)
            error = held_out(views, image_size, board, model, whole)
        except InputError:
            trials[model] = ModelTrial(math.inf, "the fit does not converge")
            continue
        trials[model] = ModelTrial(error, _doubt(whole, [n for n in MODELS[model] if n not in smaller], image_size))
        smaller = MODELS[model]
    sound = [m for m in LADDER if trials[m].sound] or ["none"]
    best = min(trials[m].held_out_px for m in sound)
    return next(m for m in sound if trials[m].held_out_px <= WITHIN * best), trials


class Told(NamedTuple):
    """A model that was tried: its held-out error in pixels, whether it was taken, and why, or why not."""

    model: str
    held_out_px: float
    taken: bool
    why: str


def explained(trials: Mapping[str, ModelTrial], taken: str) -> list[Told]:
    """What came of each model, in the order they were tried; empty where the model was given."""
    best = min((t.held_out_px for t in trials.values() if t.sound), default=math.inf)
    told = []
    for model, trial in trials.items():
        times = trial.held_out_px / best
        if model == taken:
            why = "the smallest that is sound and near the best" if trial.sound else "none is sound"
        elif trial.doubt:
            why = trial.doubt
        elif times > WITHIN:
            why = f"{times:.3g} times the best"
        else:
            why = "larger than needed"
        told.append(Told(model, trial.held_out_px, model == taken, why))
    return told


def _doubt(whole: Fit, added: Sequence[str], image_size: tuple[int, int]) -> str:
    value = dict(zip(NAMES, whole.dist, strict=False))
    if added and not any(abs(value[n]) > SIGNIFICANT * whole.sigma[n] for n in added):
        return f"{', '.join(added)} within {SIGNIFICANT:g} standard deviations of 0"
    fault = undone(whole.K, whole.dist, image_size).fault
    return f"the distortion cannot be undone at {fault}" if fault else ""


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
            _, rvec, tvec = cv2.solvePnP(points, pixels, found.K, lens.five(found.dist))
            error = lens.project(points, cv2.Rodrigues(rvec)[0], tvec, found.K, found.dist) - pixels
            squares, count = squares + float((error**2).sum()), count + len(points)
    return math.sqrt(squares / count)
