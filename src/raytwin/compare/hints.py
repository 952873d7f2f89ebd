"""False causes that are cheap to try: which simple change of the reference explains the test image?

A hint is a row of HINTS: a sentence, and the reference as it would look. One more mistake is one more row.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from raytwin.compare.finding import HINT, Finding

EXPLAINED = 0.75
"""Share of the squared error that a hint must explain to be given."""


class Hint(NamedTuple):
    """`arranged` moves pixels (views only), `valued` changes their values."""

    text: str
    arranged: Callable[[np.ndarray], np.ndarray] = lambda r: r
    valued: Callable[[np.ndarray], np.ndarray] = lambda r: r


HINTS = (
    Hint("the test image is mirrored left to right", lambda r: r[:, ::-1]),
    Hint("the test image is upside down", lambda r: r[::-1]),
    Hint("the test image is turned by 180 degrees", lambda r: r[::-1, ::-1]),
    Hint("the test image is transposed: rows are columns", lambda r: r.swapaxes(0, 1)),
    Hint("red and blue are swapped in the test image", lambda r: r[..., ::-1]),
    Hint("the test image is encoded for display, r^(1/2.2): gamma is applied once too often",
         valued=lambda r: np.power(np.maximum(r, 0), 1 / 2.2)),
    Hint("the test image is decoded once too often, r^2.2",
         valued=lambda r: np.power(np.maximum(r, 0), 2.2)),
    Hint("the test image is clipped at 1", valued=lambda r: np.minimum(r, 1)),
)  # fmt: skip

FACTORS = (
    (1 / math.pi, "1/pi: divided by pi once too often"),
    (math.pi, "pi: the 1/pi of the Lambertian BRDF is missing"),
    (2.0, "2: counted twice, or a density of half the domain"),
    (0.5, "1/2"),
    (2 * math.pi, "2 pi: the hemisphere's density is missing"),
    (1 / (2 * math.pi), "1/(2 pi)"),
    (4.0, "4"),
    (0.25, "1/4"),
)  # fmt: skip


def find_hints(test: np.ndarray, reference: np.ndarray) -> list[Finding]:
    """At most one sentence: the change of the reference that explains most of the squared error, if any does."""
    step = max(1, math.isqrt(test.shape[0] * test.shape[1] // 100_000))
    t = test[::step, ::step].astype(np.float64)
    r = reference[::step, ::step].astype(np.float64)
    d = t - r
    before = float(np.square(d).sum())
    if not (before > 0 and math.isfinite(before)):
        return []
    tried: list[tuple[float, str]] = []
    for hint in HINTS:
        moved = hint.arranged(reference)
        if moved.shape == reference.shape:
            guess = hint.valued(moved[::step, ::step].astype(np.float64))
            tried.append((float(np.square(t - guess).sum()), hint.text))
    if energy := float(np.square(r).sum()):
        factor = float((t * r).sum()) / energy
        named = next((f" = {name}" for f, name in FACTORS if abs(factor / f - 1) < 0.02), "")
        tried.append(
            (float(np.square(t - factor * r).sum()), f"the test image is {factor:.4g} times the reference{named}")
        )
    offset = d.mean(axis=(0, 1))
    text = "the test image is the reference plus a constant: " + ", ".join(f"{x:+.3g}" for x in offset)
    tried.append((float(np.square(d - offset).sum()), text))
    after, text = min(tried)
    share = 1 - after / before
    return (
        [Finding(HINT, f"hint: {text} (explains {100 * share:.1f} % of the squared error)")]
        if share > EXPLAINED
        else []
    )
