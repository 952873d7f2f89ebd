"""Choose the lens model, and whether the board is flat, by how well they predict photos that the fit has not seen.

The five coefficients of a plain OpenCV fit on a flat board are always among the candidates. A smaller model is taken
only where it predicts as well, a bent board only where it predicts better.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from raytwin.calib.boards import Board
from raytwin.calib.photos.fit import MODELS, Fit, ModelSpec, Sighting, fit
from raytwin.calib.photos.uncertainty import leave_one_out
from raytwin.errors import InputError
from raytwin.scene import Record
from raytwin.scene.lens import undone

RELATIVE_SLACK, SLACK_PX = 1.01, 0.002
"""As good as the best: within 1 % of its held-out error, or within this many pixels, far below a detector's noise."""

ALIKE = 1.1
"""Models that predict within this factor of the best add to sigma how far their K lies apart."""

FEW_PHOTOS = 12
"""Photos: with fewer, which lens predicts best is chance, and all five coefficients are fitted."""

FEWEST_FOR_A_BEND = 4
"""Photos: with fewer, the board is taken for flat."""


class ModelTrial(Record, frozen=True):
    """One model's held-out error in pixels, infinite where no fit converges, and a `doubt`, if any."""

    held_out_px: float
    doubt: str = ""


class TrialRow(NamedTuple):
    """One row of the table of models: held-out error in pixels, whether it was taken, and the reason."""

    model: str
    held_out_px: float
    taken: bool
    why: str


def name(form: ModelSpec) -> str:
    """`full5`, or `full5, bent`: the lens, and whether the board is."""
    return f"{form.model}, bent" if form.bent else form.model


Chosen = tuple[Fit, dict[str, ModelTrial], np.ndarray]
"""The chosen fit, the trial of every model, and `gap` (k, k), see `_gap`."""


def select_model(
    views: Sequence[Sighting], image_size: tuple[int, int], board: Board, model: str, start: Fit
) -> Chosen:
    """Choose whether the board is bent, then the lens."""
    trials: dict[str, ModelTrial] = {}
    fits: dict[str, Fit] = {}

    def attempt(form: ModelSpec, begin: Fit) -> None:
        try:
            fits[name(form)] = fit(views, image_size, board, form, begin)
            # A mean of photos, not of squares, so that one foreign photo does not choose the model.
            trials[name(form)] = ModelTrial(float(leave_one_out(fits[name(form)])[1].mean()))
        except InputError:
            trials[name(form)] = ModelTrial(math.inf, "the fit does not converge")

    lenses = list(MODELS) if model == "auto" else [model]
    shapes = [ModelSpec(lenses[-1], bent) for bent in (False, True)[: 1 + (len(views) >= FEWEST_FOR_A_BEND)]]
    for form in shapes:
        attempt(form, start)
    if not fits:
        raise InputError("views", "photos from which a camera follows", "a fit that does not converge")
    good = _as_good(trials, list(trials))
    taken = fits[good[0]]
    if model == "auto":
        forms = [ModelSpec(lens, taken.form.bent) for lens in lenses]
        for smaller in reversed(forms[:-1]):
            attempt(smaller, taken)
        good = _as_good(trials, [name(form) for form in forms])
        if len(views) < FEW_PHOTOS:
            good = [name(taken.form), *(n for n in reversed(good) if n != name(taken.form))]
    folding = [n for n in good if undone(fits[n].K, fits[n].dist, image_size).fault]
    trials |= {n: ModelTrial(trials[n].held_out_px, "the lens folds back inside the frame") for n in folding}
    best = next((n for n in good if n not in folding), good[0])
    return fits[best], trials, _gap(fits, trials, fits[best], len(views))


def _gap(fits: Mapping[str, Fit], trials: Mapping[str, ModelTrial], taken: Fit, photos: int) -> np.ndarray:
    """(k, k): the mean square of how far K and distortion move between the models that predict alike.

    Each model's own covariance assumes that the coefficients it leaves out are 0. With few photos, which do not show
    which model is right, all models count; with more, only the richest lens: without p1 and p2 the centre may lie ten
    standard deviations off and predict as well.
    """

    def numbers(found: Fit) -> np.ndarray:
        value = dict(zip(found.form.names, found.shared, strict=False))
        return np.array([value.get(n, 0.0) for n in taken.form.names])

    limit = ALIKE * min(t.held_out_px for t in trials.values())
    others = [n for n in fits if trials[n].held_out_px <= limit]
    if photos >= FEW_PHOTOS:
        others = [n for n in others if n == name(ModelSpec([*MODELS][-1], taken.form.bent))]
    moved = [numbers(fits[n]) - numbers(taken) for n in others] or [np.zeros(len(taken.form.names))]
    return np.mean([np.outer(m, m) for m in moved], axis=0)


def _as_good(trials: dict[str, ModelTrial], names: Sequence[str]) -> list[str]:
    """Those of the names, smallest first, that predict as well as the best of them."""
    best = min(trials[n].held_out_px for n in names)
    return [n for n in names if trials[n].held_out_px <= max(RELATIVE_SLACK * best, best + SLACK_PX)]


def trial_rows(trials: Mapping[str, ModelTrial], taken: str, photos: int) -> list[TrialRow]:
    """What came of each model, in the order they were tried; empty where there was none to choose.

    `photos`: how many there were; of few, all coefficients are fitted, and the others shown beside.
    """
    chosen = "the smallest that predicts as well as the best"
    if photos < FEW_PHOTOS:
        chosen = "too few photos to choose a smaller one by"
    best = min((t.held_out_px for t in trials.values()), default=math.inf)
    rows = []
    for model, trial in trials.items():
        times = trial.held_out_px / best
        why = "as good" if times <= RELATIVE_SLACK else f"{times:.3g} times the best"
        why = chosen if model == taken else why
        why = why if math.isfinite(times) else ""
        rows.append(TrialRow(model, trial.held_out_px, model == taken, "; ".join(filter(None, (why, trial.doubt)))))
    return rows
