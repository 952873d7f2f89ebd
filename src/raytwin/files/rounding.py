"""What a format rounds off: half a step between two values that it can hold, at every value of an image."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from raytwin.files.images import kind_of
from raytwin.files.photo_files import srgb_decode, srgb_encode


class Rounding(NamedTuple):
    """`half` (H, W, 3): half a step, radiance, or None; `clipped`: no more than 1 can be stored."""

    half: np.ndarray | None = None
    clipped: bool = False
    note: str = ""


def rounding_of(path: Path, mean: np.ndarray) -> Rounding:
    """Return what an image file's format rounds off; `mean` is the radiance (H, W, 3) read from it."""
    with path.open("rb") as file:
        kind = kind_of(file.read(4))
    if kind not in ("EXR", "PFM", None):
        return eight_bits(mean)
    with np.errstate(over="ignore", invalid="ignore"):
        is_half = np.array_equal(mean.astype(np.float16).astype(np.float32), mean, equal_nan=True)
    return half_floats(mean) if is_half else Rounding()


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
