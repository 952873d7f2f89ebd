"""Convert photo colours to the scene's Rec. 709: M = (Rec. 709 to XYZ)^-1 (photo to XYZ), from the ICC profiles.

A phone writes Display P3. Read as Rec. 709 its colours would be too dull. Both have sRGB's curve.
"""

import io
from collections.abc import Mapping

import numpy as np


def of_three_channels(extras: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return what `photo_extras` read, without the profile of a grey photo or of four inks: the drawn photo is RGB."""
    return {key: value for key, value in extras.items() if key != "icc_profile" or value[16:20] == b"RGB "}


def to_rec709(icc: bytes | None) -> np.ndarray:
    """Return the matrix (3, 3) from a photo's linear RGB to Rec. 709; the identity where no profile tells primaries.

    The profile's own curve is ignored, and sRGB's assumed.
    """
    if icc is None:
        return np.eye(3)
    from PIL import ImageCms

    try:
        photo = _primaries(ImageCms.ImageCmsProfile(io.BytesIO(icc)))
    except (OSError, ImageCms.PyCMSError):
        return np.eye(3)
    srgb = _primaries(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")))
    if photo is None or srgb is None or np.abs(photo - srgb).max() < 1e-3:
        return np.eye(3)
    return np.linalg.inv(srgb) @ photo


def _primaries(profile) -> np.ndarray | None:
    """Return the XYZ of red, green and blue under D50, the columns of (3, 3)."""
    of = profile.profile
    columns = [of.red_colorant, of.green_colorant, of.blue_colorant]
    return None if None in columns else np.array([xyz for xyz, _ in columns]).T
