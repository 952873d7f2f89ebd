"""Errors as colours: blue where the test is too dark, white where it agrees, red where it is too bright."""

import numpy as np

from raytwin.array_types import Float32
from raytwin.compare.blocks import strips
from raytwin.errors import InputError
from raytwin.images.image import Image

# Linear Rec. 709, from white at 0 to the end at `scale`, dark enough that the ends differ by lightness and hue.
_NEGATIVE = np.array([[1.0, 1.0, 1.0], [0.25, 0.55, 0.95], [0.01, 0.06, 0.45]], np.float32)
_POSITIVE = np.array([[1.0, 1.0, 1.0], [0.95, 0.42, 0.22], [0.42, 0.005, 0.02]], np.float32)
_INVALID = np.array([0.0, 0.6, 0.0], np.float32)


def signed_error(test: Image, reference: Image) -> Float32[np.ndarray, "h w"]:
    """(H, W): t - r in the channel that errs most; NaN where it has none."""
    out = np.empty(test.mean.shape[:2], np.float32)
    for y0, y1, _ in strips(out.shape):  # strips fit in the cache
        with np.errstate(invalid="ignore", over="ignore"):
            error = np.asarray(test.mean[y0:y1], np.float32) - np.asarray(reference.mean[y0:y1], np.float32)
        worst = out[y0:y1]
        worst[:] = error[..., 0]
        for c in (1, 2):
            # The first of equals; NaN is worse than any number.
            other = error[..., c]
            np.copyto(worst, other, where=~((np.abs(other) <= np.abs(worst)) | np.isnan(worst)))
    return out


def error_scale(test: Image, reference: Image) -> float:
    """The error at the palette's ends: the 99.9 % quantile of |error|, rounded up to 1, 2 or 5 times a power of ten."""
    error = np.abs(signed_error(test, reference))
    error = error[np.isfinite(error)]
    quantile = float(np.quantile(error, 0.999, method="inverted_cdf")) if error.size else 0.0
    if not quantile > 0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(quantile))
    return float(decade * next(step for step in (1, 2, 5, 10) if step * decade >= quantile * (1 - 1e-3)))


def error_map(test: Image, reference: Image, scale: float | None = None) -> Float32[np.ndarray, "h w 3"]:
    """Colours (H, W, 3) float32, linear Rec. 709: blue at -scale, white at 0, red at +scale, green where not finite.

    `scale` defaults to `error_scale(test, reference)`.
    """
    error = signed_error(test, reference)
    scale = error_scale(test, reference) if scale is None else scale
    if not (np.isfinite(scale) and scale > 0):
        raise InputError("error map: scale", "a finite number > 0", scale)
    with np.errstate(invalid="ignore", over="ignore"):
        x = np.clip(np.nan_to_num(error / np.float32(np.clip(scale, 1e-30, 1e38))), -1, 1)
    steps = np.linspace(0, 1, len(_POSITIVE))
    colours = np.empty((*error.shape, 3), np.float32)
    for c in range(3):
        colours[..., c] = np.where(x < 0, np.interp(-x, steps, _NEGATIVE[:, c]), np.interp(x, steps, _POSITIVE[:, c]))
    colours[~np.isfinite(error)] = _INVALID
    return colours
