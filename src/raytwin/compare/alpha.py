"""Alpha, the share of a pixel that is covered: compared where both images have it."""

import math

import numpy as np

from raytwin.compare.blocks import SIDE, Pixels
from raytwin.compare.finding import Finding, Place, at, plural
from raytwin.images.image import Image
from raytwin.judging import Judging

EIGHT_BITS = 0.5001 / 255
"""What rounding to 8 bits may change."""
ALLOWED_SHARE = 1e-3
"""Share of the pixels that may differ by more than is allowed, as of radiance."""


def alpha_findings(
    test: Image, reference: Image, judging: Judging, half_steps: tuple[Pixels | None, Pixels | None]
) -> tuple[list[Finding], tuple[str, ...]]:
    """Return what differs, and a note where only one image has an alpha that is not 1 everywhere.

    Of images with noise the means of blocks are compared: alpha lies in [0, 1], and so Hoeffding's inequality bounds
    the difference of two means at the rate, whatever the scene.
    """
    mine, theirs = test.alpha, reference.alpha
    if mine is None or theirs is None:
        alone = theirs if mine is None else mine
        if alone is None or (alone == 1).all():
            return [], ()
        return [], (f"alpha was not compared: only the {'reference' if mine is None else 'test image'} has it",)
    if mine.shape != theirs.shape:
        return [Finding("silhouettes", f"the alpha has the shape {mine.shape}, the reference's {theirs.shape}")], ()
    allowed = judging.bounds.p999_abs + EIGHT_BITS * sum(half is not None for half in half_steps)
    size = 1
    if test.variance is not None or reference.variance is not None:
        size = min(SIDE, *mine.shape)
        mine, theirs = _means(mine, size), _means(theirs, size)
        each = sum(1 / max(image.samples, 1) for image in (test, reference)) / size**2
        allowed += math.sqrt(math.log(2 * mine.size / judging.false_alarm_rate) * each / 2)
    with np.errstate(invalid="ignore"):
        off = ~(np.abs(mine.astype(float) - theirs) <= allowed)
    if off.sum() <= ALLOWED_SHARE * off.size:
        return [], ()
    y, x = np.argwhere(off)[0].tolist()
    of = plural(int(off.sum()), "pixel" if size == 1 else f"block of {size} x {size} pixels")
    first = f"the first at {at(size * x, size * y)}: {mine[y, x]:.3g}, and {theirs[y, x]:.3g} in the reference"
    return [Finding("silhouettes", f"alpha differs in {of}, {first}", Place(size * x, size * y, size, size))], ()


def _means(alpha: np.ndarray, size: int) -> np.ndarray:
    h, w = (n // size for n in alpha.shape)
    return np.asarray(alpha[: h * size, : w * size].reshape(h, size, w, size).mean(axis=(1, 3), dtype=float))
