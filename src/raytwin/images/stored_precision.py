"""What a format rounds off: half a step between two values that it can hold, at every value of an image."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from raytwin.images.image import Image
from raytwin.images.photo_files import srgb_decode, srgb_encode

DITHERED = "8 bits, dithered"
"""The format of an image whose values were rounded to either of the two nearest codes of sRGB."""


class Rounding(NamedTuple):
    """`half` (H, W, 3): half a step, radiance, or None; `clipped`: no more than 1 can be stored."""

    half: np.ndarray | None = None
    clipped: bool = False
    note: str = ""

    def shown(self, image: Image) -> Image:
        """Return another image as this format could have shown it."""
        return replace(image, mean=np.clip(image.mean, 0, 1)) if self.clipped else image


def rounding_of(image: Image) -> Rounding:
    """Return what the format of the image's file has rounded off."""
    if image.format not in ("", "EXR", "PFM"):
        return eight_bits(image.mean, image.format == DITHERED)
    with np.errstate(over="ignore", invalid="ignore"):
        is_half = image.format and np.array_equal(
            image.mean.astype(np.float16).astype(np.float32), image.mean, equal_nan=True
        )
    return half_floats(image.mean) if is_half else Rounding()


def eight_bits(mean: np.ndarray, dithered: bool = False) -> Rounding:
    """Return what sRGB in 256 codes rounds off; `dithered`: to either of the two nearest codes."""
    step = "a step" if dithered else "half a step"
    return Rounding(half_code(mean) * (1 + dithered), True, f"8 bits per channel: held to {step}, and to white")


def half_code(mean: np.ndarray) -> np.ndarray:
    """Half of the step above each value, of sRGB in 256 codes: decode(c + 1/2) - decode(c)."""
    code = np.arange(256) / 255
    table = ((srgb_decode(code + 0.5 / 255) - srgb_decode(code)) * 1.0001).astype(np.float32)
    return table[np.rint(srgb_encode(mean) * 255).astype(np.intp)]


def half_floats(mean: np.ndarray) -> Rounding:
    """Eleven digits, relative to each value; 2^-25 below the smallest normal number."""
    with np.errstate(invalid="ignore"):
        half = np.maximum(np.abs(mean), np.float32(2.0**-14)) * np.float32(2.0**-11)
    return Rounding(half, False, "half floats: held to half a step")
