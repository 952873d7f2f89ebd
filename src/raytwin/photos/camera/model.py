"""Choose the lens model, and whether the board is flat, by how well they predict photos that the fit has not seen.

The five coefficients of a plain OpenCV fit on a flat board are always among the candidates. A smaller model is taken
only where it predicts as well, a bent board only where it predicts better.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from raytwin.errors import InputError
from raytwin.photos.boards import Board
from raytwin.photos.camera.fit import MODELS, Fit, ModelSpec, Sighting, fit
from raytwin.photos.camera.uncertainty import leave_one_out
from raytwin.scene.lens import undone

RELATIVE_SLACK, SLACK_PX = 1.01, 0.002
"""As good as the best: within 1 % of its held-out error, or within this many pixels, far below a detector's noise."""

EQUALLY_GOOD = 1.1
"""Models that predict within this factor of the best add to sigma how far their K lies apart."""

FEW_PHOTOS = 12
"""Photos: with fewer, which lens predicts best is chance, and all five coefficients are fitted."""

FEWEST_FOR_A_BEND = 4
"""Photos: with fewer, the board is taken for flat."""


def select_model(
    views: Sequence[Sighting], image_size: tuple[int, int], board: Board, model: str, start: Fit
) -> tuple[Fit, dict[str, float], np.ndarray]:
    """Choose whether the board is bent, then the lens: the fit, each model's held-out error, and `gap` (see `_gap`).

    The error is in pixels, infinite where no fit converges.
    """
    fits: dict[str, Fit] = {}
    errors: dict[str, float] = {}
    folded: set[str] = set()  # the lens folds back inside the frame

    def attempt(form: ModelSpec, begin: Fit) -> None:
        try:
            found = fits[str(form)] = fit(views, image_size, board, form, begin)
        except InputError:
            errors[str(form)] = math.inf
            return
        # A mean of photos, not of squares, so that one foreign photo does not choose the model.
        errors[str(form)] = float(leave_one_out(found)[1].mean())
        if undone(found.K, found.dist, image_size).fault:
            folded.add(str(form))

    lenses = [*MODELS][::-1] if model == "auto" else [model]
    for bent in (False, True)[: 1 + (len(views) >= FEWEST_FOR_A_BEND)]:
        attempt(ModelSpec(lenses[0], bent), start)
    if not fits:
        raise InputError("views", "photos from which a camera follows", "a fit that does not converge")
    taken = _as_good(errors)[0]
    for lens in lenses[1:]:
        attempt(ModelSpec(lens, fits[taken].form.bent), fits[taken])
    good = _as_good({n: errors[n] for n in fits if fits[n].form.bent == fits[taken].form.bent})
    good = [taken, *good] if len(views) < FEW_PHOTOS else good[::-1]
    best = next((n for n in good if n not in folded), good[0])
    return fits[best], errors, _gap(fits, errors, fits[best])


def _as_good(errors: Mapping[str, float]) -> list[str]:
    """Those that predict as well as the best of them."""
    best = min(errors.values())
    return [n for n, error in errors.items() if error <= max(RELATIVE_SLACK * best, best + SLACK_PX)]


def _gap(fits: Mapping[str, Fit], errors: Mapping[str, float], taken: Fit) -> np.ndarray:
    """(k, k): the mean square of how far K and distortion move between the models that predict alike.

    Each model's own covariance assumes that the coefficients it leaves out are 0. With few photos, which do not show
    which model is correct, all models count; with more, only the richest lens: without p1 and p2 the centre may lie ten
    standard deviations off and predict as well.
    """
    limit, richest = EQUALLY_GOOD * min(errors.values()), ModelSpec([*MODELS][-1], taken.form.bent)
    alike = [found for n, found in fits.items() if errors[n] <= limit]
    if len(taken.R) >= FEW_PHOTOS:
        alike = [f for f in alike if f.form == richest]
    moved = [(f.lens - taken.lens)[: len(taken.form.names)] for f in alike or [taken]]
    return np.mean([np.outer(m, m) for m in moved], axis=0)
