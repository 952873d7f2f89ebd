"""Non-local means, by which the paper (section 1.2) smooths what its speculation guessed."""

import numpy as np

from raytwin.array_types import Float32

STRENGTH = 10 / 255
"""Share of the brightest value: differences of patches up to about this size are smoothed away, as in the paper."""


def non_local_means(radiance: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w 3"]:
    """Average each pixel with those of 21 x 21 about it whose patches of 7 x 7 look alike (OpenCV's, in 16 bits).

    Buades, Coll and Morel, "A non-local algorithm for image denoising", CVPR 2005.
    """
    import cv2

    white = float(radiance.max()) or 1.0
    coded = np.rint(np.clip(radiance / white, 0, 1) * 65535).astype(np.uint16)
    smooth = cv2.fastNlMeansDenoising(coded, [STRENGTH * 65535], None, 7, 21, cv2.NORM_L1)
    return smooth.astype(np.float32) * np.float32(white / 65535)
