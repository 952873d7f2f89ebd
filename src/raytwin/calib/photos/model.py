"""Choose the lens model and the board's shape by how well they predict photos that the fit has not seen.

The five coefficients of a plain OpenCV fit on a flat board are always among the candidates. A smaller model is taken
only where it predicts as well, a bent board only where it predicts better, and then the richest shape that does.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from raytwin.calib.boards import Board
from raytwin.calib.boards.shape import DEGREES
from raytwin.calib.photos.fit import Fit, ModelSpec, Sighting, fit
from raytwin.calib.photos.uncertainty import fit_uncertainty, leave_one_out
from raytwin.errors import InputError
from raytwin.scene import Record
from raytwin.scene.lens import undone

LADDER = ("none", "k1", "k1k2", "k1k2k3", "full5")
"""What `auto` chooses from, smallest first; each adds coefficients to the one before."""

RELATIVE_SLACK, SLACK_PX = 1.01, 0.002
"""As good as the best: within 1 % of its held-out error, or within this many pixels, far below a detector's noise."""

ALIKE = 1.1
"""Models that predict within this factor of the best add to sigma how far their K lies apart."""

FEW_PHOTOS = 12
"""Photos: with fewer, which lens predicts best is chance, and all five coefficients are fitted."""

STRETCHED, EXPLAINED, SURELY = 0.002, 0.8, 4.0
"""The pitch of a board in y is fitted where it is off by more than this fraction and this many standard deviations, and
fitting it lowers the rms to less than this fraction."""

LEAST_FOR_SHAPE, LEAST_FOR_ANY_SHAPE = 4, 6
"""Photos: with fewer than the first, the board is taken for flat; with fewer than the second, for flat or of
degree 2."""


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
    """`full5`, or `full5, bent 3`: the lens, and the degree of the board's heights."""
    return form.model if form.degree == 0 else f"{form.model}, bent {form.degree}"


def held_out(found: Fit) -> float:
    """The mean over the photos of the rms distance in each, pixels, in the fit without it: its pose alone is fitted to
    it.

    A mean of photos, not of squares, so that one foreign photo does not choose the model.
    """
    return float(leave_one_out(found)[1].mean())


Chosen = tuple[Fit, dict[str, ModelTrial], np.ndarray]
"""The chosen fit, the trial of every model, and `gap` (k, k), see `_gap`."""


def select_model(
    views: Sequence[Sighting], image_size: tuple[int, int], board: Board, model: str, start: Fit
) -> Chosen:
    """Choose the board's shape, then the lens; and both again with the board's pitch in y where it is surely wrong."""
    chosen = _select(views, image_size, board, model, start, False)
    try:
        free = fit(views, image_size, board, replace(chosen[0].form, stretch=True), chosen[0])
    except InputError:
        return chosen
    sigma = math.sqrt(fit_uncertainty(free).covariance[-1, -1])  # of the stretch, the last parameter
    wrong = abs(free.shared[-1]) > max(STRETCHED, SURELY * sigma)
    if not wrong or free.rms_px > EXPLAINED * chosen[0].rms_px:
        return chosen
    return _select(views, image_size, board, model, free, True)


def _select(
    views: Sequence[Sighting],
    image_size: tuple[int, int],
    board: Board,
    model: str,
    start: Fit,
    stretch: bool,
) -> Chosen:
    trials: dict[str, ModelTrial] = {}
    fits: dict[str, Fit] = {}

    def attempt(form: ModelSpec, begin: Fit) -> None:
        try:
            fits[name(form)] = fit(views, image_size, board, form, begin)
            trials[name(form)] = ModelTrial(held_out(fits[name(form)]))
        except InputError:
            trials[name(form)] = ModelTrial(math.inf, "the fit does not converge")

    richest = LADDER[-1] if model == "auto" else model
    photos = len(views)
    for degree in _degrees(photos):
        if degree == DEGREES[-1] and _as_good(trials, list(trials))[0] == richest:
            continue  # a shape that no lower degree hints at
        attempt(ModelSpec(richest, degree, stretch), next(reversed(fits.values()), start))
    if not fits:
        raise InputError("views", "photos from which a camera follows", "a fit that does not converge")
    shapes = _as_good(trials, list(trials))
    # Flat where that predicts as well. Else the richest shape that does: what a poorer one leaves out is the same in
    # every photo, so no held-out photo reveals it, yet it moves K.
    taken = fits[shapes[0] if shapes[0] == richest else shapes[-1]]
    good = [name(taken.form)]
    if model == "auto":
        degree = taken.form.degree
        for smaller in reversed(LADDER[:-1]):
            attempt(ModelSpec(smaller, degree, stretch), taken)
        good = _as_good(trials, [name(ModelSpec(m, degree)) for m in LADDER])
        if photos < FEW_PHOTOS:
            good = [name(taken.form), *(n for n in reversed(good) if n != name(taken.form))]
    folding = [n for n in good if undone(fits[n].K, fits[n].dist, image_size).fault]
    trials |= {n: ModelTrial(trials[n].held_out_px, "the lens folds back inside the frame") for n in folding}
    best = next((n for n in good if n not in folding), good[0])
    return fits[best], trials, _gap(fits, trials, fits[best], photos)


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
        others = [n for n in others if n == name(ModelSpec(LADDER[-1], taken.form.degree))]
    moved = [numbers(fits[n]) - numbers(taken) for n in others] or [np.zeros(len(taken.form.names))]
    return np.mean([np.outer(m, m) for m in moved], axis=0)


def _degrees(photos: int) -> tuple[int, ...]:
    """Which degrees of the board's heights are tried; 0 is flat."""
    if photos < LEAST_FOR_SHAPE:
        return (0,)
    return (0, *DEGREES) if photos >= LEAST_FOR_ANY_SHAPE else (0, DEGREES[0])


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
