"""Choose the lens model, and whether the board is bent, by the error in photos that the fit has not seen; and say how
uncertain the camera is.
"""

from collections.abc import Mapping

import numpy as np

from raytwin.photos.boards import Board
from raytwin.photos.camera.fit import LENS, MODELS, Fit, ModelSpec, Views, fit

RELATIVE_SLACK, SLACK_PX = 1.01, 0.002
"""As good as the best: within 1 % of its held-out error, or within this many pixels."""

EQUALLY_GOOD = 1.1
"""If the richest lens's error is within this factor of the best, the distance of its K from the chosen one's adds to
sigma."""


def select_model(
    views: Views, image_size: tuple[int, int], board: Board, model: str, start: Fit
) -> tuple[Fit, dict[str, float], np.ndarray]:
    """Choose whether the board is bent, by the richest lens, then the smallest lens that predicts as well.

    Returns the fit, each model's held-out error (pixels), and `gap` (9,): how far the richest lens's numbers lie from
    the fit's. The fit's own covariance assumes that the coefficients it leaves out are 0: without p1 and p2 the centre
    may lie ten standard deviations off and predict as well.
    """
    fits: dict[ModelSpec, Fit] = {}
    errors: dict[ModelSpec, float] = {}

    def attempt(form: ModelSpec, begin: Fit) -> None:
        fits[form] = fit(views, image_size, board, form, begin)
        # A mean of photos, not of squares, so that one foreign photo does not choose the model.
        errors[form] = float(fits[form].leave_one_out()[1].mean())

    lenses = [*MODELS][::-1] if model == "auto" else [model]
    for bent in (False, True):
        attempt(ModelSpec(lenses[0], bent), start)
    richest = _as_good(errors)[0]
    for lens in lenses[1:]:
        attempt(ModelSpec(lens, richest.bent), fits[richest])
    best = _as_good({form: error for form, error in errors.items() if form.bent == richest.bent})[-1]
    gap = (fits[richest].shared - fits[best].shared)[:LENS]
    counts = errors[richest] <= EQUALLY_GOOD * min(errors.values())
    return fits[best], {str(form): error for form, error in errors.items()}, gap * counts


def _as_good(errors: Mapping[ModelSpec, float]) -> list[ModelSpec]:
    best = min(errors.values())
    return [form for form, error in errors.items() if error <= max(RELATIVE_SLACK * best, best + SLACK_PX)]


def covariance(found: Fit, moves: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """(m, m): that of `Fit.shared`, from how the photos disagree, and how the models do (`gap`).

    Blur, a focus that moved and the like pull all tags of a photo the same way. So the photo is the unit. Where photos
    err alike, the covariance is s² H^-1; where they disagree, the jackknife is honest:

        C = S s² H^-1 S,  S_k² = max(1, V_k / (s² H^-1)_kk),  V_k = (n - 1) / n Σ d_ik²,

    d_i: how far the numbers move without photo i of n (`moves`). V of few photos may be small by chance, so the larger
    one counts.
    """
    alike = max(found.variance, 1e-300) * found.inverse
    variance, jackknife = np.diag(alike), (1 - 1 / len(moves)) * (moves**2).sum(axis=0)
    wider = np.maximum(jackknife / np.where(variance > 0, variance, np.inf), 1)
    made = alike * np.sqrt(np.outer(wider, wider))
    made[:LENS, :LENS] += np.outer(gap, gap)
    return made
