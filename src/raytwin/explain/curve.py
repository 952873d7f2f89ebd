"""Whether each value follows from the reference's by one curve, as gamma and tone mapping do.

An effect, not a mistake: it is told where no cause explains the image exactly. A curve that rises holds wherever no
value is below that of a darker one, beyond what formats and float32 round off. Thirty-two levels in order by chance
have a probability of 1 / 32!.
"""

from collections.abc import Callable

import numpy as np

from raytwin.explain.pixel_sample import FLOAT32_DIGITS, MATCH_WITHIN, SubmittedImage

Array = np.ndarray
FEWEST_LEVELS = 32
"""Distinct wrong values of either image, below which nothing is told."""
MAX_VALUES = 500_000
"""Values that are compared: of larger images, every k-th."""
MAX_SHARE_OFF_CURVE = 1e-3
"""Share of the values that may lie off a curve."""
POWERS = ((1 / 2, "1/2"), (1 / 2.2, "1/2.2"), (1 / 2.4, "1/2.4"))


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
