"""Convert photo colours to the scene's Rec. 709, by the primaries in the photo's ICC profile.

A phone writes Display P3: taken for Rec. 709, its colours are duller than they were. Both have sRGB's curve; between
their linear values lies one matrix, M = (Rec. 709 to XYZ)^-1 (photo to XYZ), whose columns the profiles hold.
"""

import io
from collections.abc import Mapping

import numpy as np


def of_three_channels(extras: Mapping[str, bytes]) -> dict[str, bytes]:
    """A photo's `files.photo_extras` without the profile of a grey photo or of four inks: what is drawn on is RGB."""
    return {key: value for key, value in extras.items() if key != "icc_profile" or value[16:20] == b"RGB "}


def to_rec709(icc: bytes | None) -> np.ndarray:
    """(3, 3): linear Rec. 709 of a photo's linear RGB; the identity without a profile, or where it holds no primaries.

    The profile's own curve is ignored; sRGB's is assumed.
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
    """(3, 3): XYZ of red, green and blue in its columns, under D50 as all profiles have it."""
    of = profile.profile
    columns = [of.red_colorant, of.green_colorant, of.blue_colorant]
    return None if None in columns else np.array([xyz for xyz, _ in columns]).T
