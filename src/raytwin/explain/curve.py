"""Whether each value follows from the reference's by one curve, as gamma and view transforms make it.

An effect, not a mistake: it is told where no cause explains the image exactly. A curve that rises holds wherever no
value is below that of a darker one, beyond what formats and float32 round off. Thirty-two levels in order by chance
have a probability of 1 / 32!.
"""

from collections.abc import Callable

import numpy as np

from raytwin.explain.pixel_sample import CLOSE, DIGITS, SubmittedImage
from raytwin.images.photo_files import srgb_encode

Array = np.ndarray
FEWEST_LEVELS = 32
"""Distinct wrong values of either image, below which nothing is told."""
MAX_VALUES = 500_000
"""Values looked at."""
OFF = 1e-3
"""Share of the values that may lie off a curve."""
POWERS = ((1 / 2, "1/2"), (1 / 2.2, "1/2.2"), (1 / 2.4, "1/2.4"))


def _aces(x: Array) -> Array:
    """Narkowicz 2015."""
    return np.asarray(np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1))


def _hable(x: Array) -> Array:
    """Hable 2010, exposure 2 and white 11.2."""

    def curve(x: Array | float) -> Array:
        return np.asarray((x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3)

    return np.asarray(curve(2 * x) / curve(11.2))


TRANSFORMS: dict[str, Callable[[Array], Array]] = {
    "Reinhard's x / (1 + x)": lambda x: x / (1 + x),
    "1 - exp(-x)": lambda x: 1 - np.exp(-x),
    "ACES": _aces,
    "ACES of 0.6 x": lambda x: _aces(0.6 * x),
    "Hable's": _hable,
    "log(1 + x)": np.log1p,
}
ENCODINGS: dict[str, Callable[[Array], Array]] = {
    "": lambda x: x,
    ", encoded as sRGB": srgb_encode,
    ", raised to the power 1/2.2": lambda x: np.maximum(x, 0) ** (1 / 2.2),
}


def curve_cause(view: SubmittedImage) -> str:
    """The sentence on an image without noise; empty where no curve holds."""
    assert view.right is not None
    step = -(-view.shown.size // MAX_VALUES)
    bounds = view.bounds or (view.right, view.right)
    half = np.zeros(view.shown.shape) if view.half is None else view.half
    s, r, low, high, half = (np.ravel(x)[::step].astype(float) for x in (view.shown, view.right, *bounds, half))
    scale = float(np.max(np.abs(s), initial=0.0)) or 1.0
    slack = half + DIGITS * scale
    wrong = (s < low - slack) | (s > high + slack)
    width = 2 * float(np.median(slack))
    if min(np.unique(r[wrong]).size, np.unique(np.rint(s[wrong] / width)).size) < FEWEST_LEVELS:
        return ""
    if not _rises(s, slack, low, high):
        return ""
    stored = (lambda x: np.clip(x, 0, 1)) if view.clipped else (lambda x: x)

    def holds(curve: Callable[[Array], Array]) -> bool:
        with np.errstate(all="ignore"):
            ends = stored(curve(np.maximum(low, 0))), stored(curve(np.maximum(high, 0)))
        off = np.maximum(ends[0] - s, s - ends[1]) - half
        return bool((off > CLOSE * scale).mean() <= OFF)

    said = "each value follows from the reference's by one curve"
    inner = (r > 0.01 * np.quantile(r, 0.99)) & (s > 0) & ~(view.clipped & ((s >= 1) | (r >= 1)))
    if np.unique(r[inner]).size >= FEWEST_LEVELS:
        exponent, shift = np.polyfit(np.log(r[inner]), np.log(s[inner]), 1).tolist()
        factor = float(np.exp(shift))
        if holds(lambda x: factor * x**exponent):
            if abs(exponent - 1) < 2e-3:  # a plain factor
                return ""
            named = next((f" = {name}" for value, name in POWERS if abs(exponent / value - 1) < 2e-3), "")
            times = f", times {factor:.4g}" if abs(factor - 1) > 2e-3 else ""
            return f"{said}: the power {exponent:.4g}{named}{times}"
    for name, transform in TRANSFORMS.items():
        for then, encode in ENCODINGS.items():
            if holds(lambda x: encode(transform(x))):  # noqa: B023 (called at once)
                return f"{said}: the view transform {name}{then}"
    return f"{said}, as a view transform makes it: compare linear radiance"


def _rises(s: Array, slack: Array, low: Array, high: Array) -> bool:
    """Whether no value is below that of one that is surely darker or equal in the reference."""
    order = np.argsort(high)
    largest = np.maximum.accumulate((s - slack)[order])
    darker = np.searchsorted(high[order], low, side="right")
    return bool((np.append(-np.inf, largest)[darker] > s + slack).mean() <= OFF)
