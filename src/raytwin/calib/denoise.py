"""Non-local means on radiance: each pixel becomes the mean of pixels whose surroundings look like its own.

Buades, Coll and Morel, "A Non-Local Algorithm for Image Denoising", CVPR 2005; the filter itself is OpenCV's.
"""

import numpy as np

from raytwin.errors import missing_package
from raytwin.image import Image

PATCH, REACH = 5, 21
"""Pixels: the side of the surroundings that are compared, and of the window in which they are looked for."""
STRENGTH = 3.0
"""The filter's h in standard deviations of the noise. Tried on path-traced scenes: 1 leaves 80 % of the error, 3 half
of it; larger ones begin to smear shadows."""
LEVELS = 65535
"""The largest code of the 16 bits that OpenCV denoises."""
SECOND = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]]) / 6
"""Immerkær's filter (1996): white noise keeps its standard deviation, and of a plane nothing is left."""


def denoise(image: Image) -> np.ndarray:
    """Radiance (H, W, 3) float32, less noisy than `image.mean`; NaN and infinities stay where they are.

    OpenCV's filter wants whole numbers and noise of one size: the square root of radiance goes through it, in 16 bits
    up to the image's maximum, since Monte Carlo noise grows with the square root of what it estimates. The
    noise is that of the image's variance, or, without one, of its second differences.
    """
    try:
        import cv2  # not above: nothing else of a table of renderers needs it
    except ModuleNotFoundError as error:
        raise missing_package("denoise", error) from None

    wrong = ~np.isfinite(image.mean)
    radiance = np.maximum(np.where(wrong, 0, image.mean), 0)
    peak = float(radiance.max(initial=0))
    if peak == 0:
        return image.mean.copy()
    root = np.sqrt(radiance / peak)
    noise = _noise(root, None if image.variance is None else image.variance / peak**2)
    # OpenCV takes h in the image's own units, and with 16 bits only the norm of absolute differences.
    levels = np.rint(root * LEVELS).astype(np.uint16)
    h = max(STRENGTH * noise * LEVELS, 1.0)
    found = cv2.fastNlMeansDenoising(levels, [h], None, PATCH, REACH, cv2.NORM_L1).astype(np.float32) / LEVELS
    return np.where(wrong, image.mean, found**2 * np.float32(peak)).astype(np.float32)


def _noise(root: np.ndarray, variance: np.ndarray | None) -> float:
    """Root mean square of the noise of `root` (H, W, 3), the square root of radiance of this `variance`."""
    if variance is None:
        import cv2

        return float(np.sqrt(np.mean([np.square(cv2.filter2D(root[..., c], -1, SECOND)) for c in range(3)])))
    # d(sqrt x) = dx / (2 sqrt x); where x is nearly 0 that fails, and the root of the variance bounds it.
    known = np.where(np.isfinite(variance), variance, 0)
    squares = known / np.maximum(4 * root * root, np.sqrt(known) + 1e-12)
    return float(np.sqrt(squares.mean()))
