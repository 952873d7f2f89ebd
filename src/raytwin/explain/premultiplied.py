"""Colours that are multiplied by alpha in one image, and straight in the other."""

import numpy as np

from raytwin.images.image import Image
from raytwin.images.stored_precision import Rounding

EXACT_WITHIN = 1e-4
"""Share of the reference's largest value by which a prediction may be off."""
FEWEST_WRONG_PIXELS, PREDICTED_FROM_SHARE = 6, 0.99
"""Wrong pixels with a partial alpha, and the share of all covered pixels that has to be predicted."""


def alpha_cause(test: Image, reference: Image, rounding: Rounding, of_reference: Rounding) -> str:
    """Which of two images without noise has straight colours, in words; empty where neither explains the other."""
    known = [(r.clipped, image.alpha) for image, r in ((reference, of_reference), (test, rounding))]
    coarse, alpha = min((one for one in known if one[1] is not None), key=lambda one: one[0], default=(False, None))
    if alpha is None or alpha.shape != test.shape[:2]:
        return ""
    half, reference_half = (0.0 if r.half is None else r.half for r in (rounding, of_reference))
    slack = EXACT_WITHIN * float(np.max(reference.mean)) + half
    wrong = (np.abs(test.mean - reference.mean) > slack).any(axis=-1)
    if (wrong & (alpha > 0) & (alpha < 1)).sum() < FEWEST_WRONG_PIXELS:
        return ""
    share = np.where(alpha > 0, alpha, 1)[..., None].astype(float)
    step = 0.5 / 255 * coarse
    for words, power in (
        ("multiplied by alpha (premultiplied), the reference's are straight: divide them by alpha", 1),
        ("straight, the reference's are multiplied by alpha (premultiplied): multiply them by alpha", -1),
    ):
        factor, least = share**power, np.maximum(share - step, step) ** power if coarse else share**power
        made = factor * reference.mean
        if rounding.clipped or of_reference.clipped:
            made = np.clip(made, 0, 1)
        near = np.abs(test.mean - made) <= slack + factor * reference_half + np.abs(factor - least) * reference.mean
        if near.all(axis=-1)[alpha > 0].mean() > PREDICTED_FROM_SHARE:
            return f"the colours are {words}"
    return ""
