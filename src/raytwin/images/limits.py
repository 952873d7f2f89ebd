"""How large a picture a header may claim, given how long its file is."""

import os

from raytwin.errors import InputError

MAX_PIXELS = 400_000_000
"""A header that claims more than this is damaged or hostile: no camera makes it."""

FREE_BYTES = 340 << 20
"""Memory that a file of any length may claim, 22 megapixels of four float32: one colour compresses to almost 0."""

MAX_EXPANSION = 250
"""Bytes in memory per byte of file, beyond that. Photos and renders stay under 120; compressed zeros reach 1032."""


def check_size(path: str | os.PathLike, width: int, height: int, pixel_bytes: int) -> None:
    """width * height <= MAX_PIXELS, and no more memory than a file of this length may ask for; else InputError.

    `pixel_bytes` counts all channels as stored; the float32 RGB made of them counts at least.
    """
    if not (width > 0 and height > 0):
        raise InputError(path, "a picture of at least one pixel", f"{width} x {height}")
    if width * height > MAX_PIXELS:
        raise InputError(path, f"at most {MAX_PIXELS / 1e6:g} megapixels", f"{width} x {height}")
    length = os.stat(path).st_size  # noqa: PTH116 (path may be a str)
    claimed = width * height * max(pixel_bytes, 12)
    if claimed > max(FREE_BYTES, MAX_EXPANSION * length):
        raise InputError(
            path, f"a file of at least {claimed // MAX_EXPANSION} bytes for {width} x {height} pixels", f"{length}"
        )
