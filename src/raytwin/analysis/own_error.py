"""What of a subject's error is a mistake of its own: more than rounding or the variance of its samples can explain."""

from typing import NamedTuple

import numpy as np

from raytwin.diagnose.light_decomposition import fitted_error
from raytwin.diagnose.pixel_sample import Sampled, View
from raytwin.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

OWN = "the subject's own error"
ROUNDING = 1e-5
"""Share of the image's scale: without sampling, a larger error is not rounding."""
BLOCK = 8
"""Pixels across: the samples' noise is judged by the scatter within such blocks."""
FIRM = 4.0
"""Standard errors of a block's mean, beyond which it is no noise."""


class OwnError(NamedTuple):
    """(h, w, 3) `whole`; `named`: what it is, and how much of it that explains, where the fitted split finds it."""

    whole: np.ndarray
    named: tuple[tuple[str, np.ndarray], ...] = ()


def own_error(scene: Scene, seen: Image, right: np.ndarray, rung: str, sampled: Sampled) -> OwnError:
    """The subject's own error beside `right`, its rung; `sampled`: its light's parts that chance finds."""
    off, words, picture = seen.mean - right, "", np.zeros_like(right)
    if scene.objects and not scene.glossy and not scene.environment:
        slack = None if seen.variance is None else 3 * np.sqrt(np.maximum(seen.variance, 0, dtype=float))
        words, fitted = fitted_error(View(scene, seen.mean, right, rung, half=slack, sampled=sampled))
        picture = fitted.astype(off.dtype)
    if RUNGS[rung].noisy:
        whole = picture + _beyond_scatter(off - picture)
    else:
        positive = right[right > 0]
        scale = float(np.quantile(positive, 0.99)) if positive.size else 1.0
        whole = np.where(np.abs(off).max(axis=-1, keepdims=True) > ROUNDING * scale, off, 0)
        picture = picture * (whole != 0)
    return OwnError(whole, ((words, picture),) if words else ())


def _beyond_scatter(off: np.ndarray) -> np.ndarray:
    """Means of blocks, where they exceed what the scatter within the block lets them be; elsewhere 0."""
    made = np.zeros_like(off)
    height, width = off.shape[:2]
    for y in range(0, height, BLOCK):
        for x in range(0, width, BLOCK):
            part = off[y : y + BLOCK, x : x + BLOCK]
            size = part.shape[0] * part.shape[1]
            mean = part.mean(axis=(0, 1))
            error = part.std(axis=(0, 1)) / np.sqrt(max(size - 1, 1))
            made[y : y + BLOCK, x : x + BLOCK] = np.where(np.abs(mean) > FIRM * error, mean, 0)
    return made
