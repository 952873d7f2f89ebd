"""What of a subject's error is a mistake of its own: more than rounding or the variance of its samples can explain."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from raytwin.diagnose.light_decomposition import fitted_error
from raytwin.diagnose.pixel_sample import Sampled, SubmittedImage
from raytwin.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

OWN = "the subject's own error"
ROUNDING = 1e-5
"""Share of the image's scale: without sampling, a larger error is not rounding."""
BLOCK = 8
"""Pixels across: the samples' noise is judged by the scatter within such blocks."""
FIRM, FIRMER = 4.0, 6.0
"""Standard errors of a block's mean, beyond which it is no noise; of a smaller block's, by estimated variances."""


class OwnError(NamedTuple):
    """(h, w, 3) `whole`; `named`: what it is, and how much of it that explains, where the fitted split finds it."""

    whole: np.ndarray
    named: tuple[tuple[str, np.ndarray], ...] = ()


def own_error(scene: Scene, seen: Image, right: Image, rung: str, sampled: Sampled) -> OwnError:
    """The subject's own error beside its rung, `right`; `sampled`: the light's parts that chance finds."""
    off, words, picture = seen.mean - right.mean, "", np.zeros_like(right.mean)
    if scene.objects and not scene.glossy and not scene.environment:
        slack = None if seen.variance is None else 3 * np.sqrt(np.maximum(seen.variance, 0, dtype=float))
        words, fitted = fitted_error(SubmittedImage(scene, seen.mean, right.mean, rung, half=slack, sampled=sampled))
        picture = fitted.astype(off.dtype)
    if RUNGS[rung].noisy:
        variances: tuple[np.ndarray, ...] = ()
        if seen.variance is not None and right.variance is not None:
            one = np.maximum(seen.variance * seen.samples, right.variance * right.samples)  # of one sample
            variances = (one / seen.samples, one / right.samples)
        whole = picture + _beyond_noise(off - picture, variances)
    else:
        positive = right.mean[right.mean > 0]
        scale = float(np.quantile(positive, 0.99)) if positive.size else 1.0
        whole = np.where(np.abs(off).max(axis=-1, keepdims=True) > ROUNDING * scale, off, 0)
        picture = picture * (whole != 0)
    return OwnError(whole, ((words, picture),) if words else ())


def _beyond_noise(off: np.ndarray, variances: Sequence[np.ndarray]) -> np.ndarray:
    """Means of blocks, where they exceed what the noise lets them be, then of what is left of smaller ones; else 0.

    The noise of a block's mean is known by the scatter within it; where there are `variances`, whose sum is that of
    `off`, smaller blocks follow, down to single pixels: a pixel's variance is its own or its block's, if that is more.
    """
    made = np.zeros_like(off)
    noise = sum(np.maximum(_means(x, BLOCK), x) for x in variances)
    for size in (BLOCK, BLOCK // 2, BLOCK // 4, 1) if len(variances) else (BLOCK,):
        mean = _means(off - made, size)
        scatter = (_means(np.square(off - made), size) - np.square(mean)) / max(size**2 - 1, 1)
        limit = FIRM**2 * scatter if size == BLOCK else FIRMER**2 * _means(noise, size) / size**2
        made += np.where(np.square(mean) > limit, mean, 0)
    return made


def _means(x: np.ndarray, size: int) -> np.ndarray:
    """(h, w, 3): at each pixel the mean of its block, `size` pixels across, less at the right and the bottom."""
    rows, columns = (np.arange(0, n, size) for n in x.shape[:2])
    sums = np.add.reduceat(np.add.reduceat(x, rows, axis=0), columns, axis=1)
    tall, wide = (np.diff([*starts, n]) for starts, n in zip((rows, columns), x.shape[:2], strict=True))
    means = sums / (tall[:, None] * wide)[..., None]
    return np.repeat(np.repeat(means, tall, axis=0), wide, axis=1)
