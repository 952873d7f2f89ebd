"""Causes that one formula gives, pixel by pixel, without a search: of depths, of colours under alpha, of values.

One curve through all values, as of gamma and tone mapping, is an effect, not a mistake: it is told where no cause
explains the image exactly. A curve that rises holds wherever no value is below that of a darker one, beyond what
formats and float32 round off. Thirty-two levels in order by chance have a probability of 1 / 32!.
"""

from collections.abc import Callable

import numpy as np

from raytwin.explain.catalogue import FAULTS
from raytwin.explain.pixel_sample import FLOAT32_DIGITS, MATCH_WITHIN, SubmittedImage
from raytwin.explain.predict import NO_MISTAKE, Array, written
from raytwin.images.image import BACKGROUND, Image, Surface
from raytwin.images.stored_precision import Rounding
from raytwin.scene import Scene

FEWEST_PIXELS_TO_AGREE = 10
"""Pixels that have to show the ratio."""
RATIO_WITHIN = 1e-4
"""Relative: how far the ratio may be from the formula, at 99.9 % of the pixels."""
VARIES_BY = 1e-3
"""Relative: how much the formula has to differ from 1."""
ALONG_AXIS = "depths are measured along the camera's axis, z: t along the unit ray is z · √(x² + y² + 1)"
EXACT_WITHIN = 1e-4
"""Share of the reference's largest value by which a prediction may be off."""
FEWEST_WRONG_PIXELS, PREDICTED_FROM_SHARE = 6, 0.99
"""Wrong pixels with a partial alpha, and the share of all covered pixels that has to be predicted."""
FEWEST_LEVELS = 32
"""Distinct wrong values of either image, below which nothing is told."""
MAX_VALUES = 500_000
"""Values that are compared: of larger images, every k-th."""
MAX_SHARE_OFF_CURVE = 1e-3
"""Share of the values that may lie off a curve."""
POWERS = ((1 / 2, "1/2"), (1 / 2.2, "1/2.2"), (1 / 2.4, "1/2.4"))


def depth_cause(test: Surface | None, reference: Surface | None, scene: Scene) -> str:
    """What makes all depths wrong by one formula of the pixel's place (x, y, 1); empty where nothing does."""
    if test is None or reference is None or test.ids.shape != reference.ids.shape:
        return ""
    v, u = np.nonzero((test.ids == reference.ids) & (test.ids != BACKGROUND) & (reference.depth > 0))
    if len(u) < FEWEST_PIXELS_TO_AGREE:
        return ""
    K, dist = np.array(scene.camera.K), np.array(scene.camera.coefficients, float)
    stretch = 1 / written(NO_MISTAKE)["through"](K, dist, u.astype(float), v.astype(float))[:, 2]
    ratio = test.depth[v, u].astype(float) / reference.depth[v, u]
    other = next(fault.sentence for fault in FAULTS if fault.name == "t-of-other-rays")
    unit = float(np.median(ratio))
    whole = f"all depths are {unit:.4g} times what they should be: t is in metres, along the unit ray"
    for formula, words in (
        (stretch, f"depth / reference = √(x² + y² + 1): {other}"),
        (1 / stretch, ALONG_AXIS),
        (np.full_like(ratio, unit), whole),
    ):
        off = np.abs(ratio / formula - 1)
        if np.abs(formula - 1).max() > VARIES_BY and np.quantile(off, 0.999) < RATIO_WITHIN:
            return words
    return ""


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


def curve_cause(view: SubmittedImage) -> str:
    """The sentence on an image without noise; empty where no curve holds."""
    assert view.correct is not None
    step = -(-view.shown.size // MAX_VALUES)
    bounds = view.bounds or (view.correct, view.correct)
    half = np.zeros(view.shown.shape) if view.half is None else view.half
    values = (view.shown, view.correct, *bounds, half)
    shown, reference, low, high, half = (np.ravel(x)[::step].astype(float) for x in values)
    scale = float(np.max(np.abs(shown), initial=0.0)) or 1.0
    slack = half + FLOAT32_DIGITS * scale
    wrong = (shown < low - slack) | (shown > high + slack)
    width = 2 * float(np.median(slack))
    if min(np.unique(reference[wrong]).size, np.unique(np.rint(shown[wrong] / width)).size) < FEWEST_LEVELS:
        return ""
    if not _rises(shown, slack, low, high):
        return ""
    stored = (lambda x: np.clip(x, 0, 1)) if view.clipped else (lambda x: x)

    def holds(curve: Callable[[Array], Array]) -> bool:
        with np.errstate(all="ignore"):
            ends = stored(curve(np.maximum(low, 0))), stored(curve(np.maximum(high, 0)))
        off = np.maximum(ends[0] - shown, shown - ends[1]) - half
        return bool((off > MATCH_WITHIN * scale).mean() <= MAX_SHARE_OFF_CURVE)

    sentence = "each value follows from the reference's by one curve"
    saturated = view.clipped & ((shown >= 1) | (reference >= 1))
    used = (reference > 0.01 * np.quantile(reference, 0.99)) & (shown > 0) & ~saturated
    if np.unique(reference[used]).size >= FEWEST_LEVELS:
        exponent, shift = np.polyfit(np.log(reference[used]), np.log(shown[used]), 1).tolist()
        factor = float(np.exp(shift))
        if holds(lambda x: factor * x**exponent):
            if abs(exponent - 1) < 2e-3:  # a plain factor
                return ""
            named = next((f" = {name}" for value, name in POWERS if abs(exponent / value - 1) < 2e-3), "")
            times = f", times {factor:.4g}" if abs(factor - 1) > 2e-3 else ""
            return f"{sentence}: the power {exponent:.4g}{named}{times}"
    return f"{sentence}, as a view transform makes it: compare linear radiance"


def _rises(shown: Array, slack: Array, low: Array, high: Array) -> bool:
    """Whether no value is below that of one that is surely darker or equal in the reference."""
    order = np.argsort(high)
    largest = np.maximum.accumulate((shown - slack)[order])
    darker = np.searchsorted(high[order], low, side="right")
    return bool((np.append(-np.inf, largest)[darker] > shown + slack).mean() <= MAX_SHARE_OFF_CURVE)
