"""PFM: `PF` (colour) or `Pf` (grey), width and height, a scale whose sign is the byte order, rows from the bottom up.

Source: Debevec's description of the format; negative scale: little endian. A scale other than 1 multiplies.
"""

import os
import re
from pathlib import Path

import numpy as np

from raytwin.errors import InputError
from raytwin.images.limits import check_size

HEADER = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)[ \t\r]*\n")
LONGEST_HEADER = 256
"""Bytes: three lines are far shorter."""


def read_pfm(path: str | os.PathLike) -> np.ndarray:
    """(H, W, 3) or (H, W) float32, row 0 on top."""
    with Path(path).open("rb") as file:
        found = HEADER.match(file.read(LONGEST_HEADER))
        if not found:
            raise InputError(path, "a PFM's header: PF or Pf, width, height, scale", "a damaged one")
        width, height = int(found[2]), int(found[3])
        channels = 3 if found[1] == b"PF" else 1
        check_size(path, width, height, 4 * channels)
        scale = float(found[4])
        if scale == 0 or not np.isfinite(scale):
            raise InputError(path, "a PFM's scale other than 0, its sign the byte order", scale)
        count, left = width * height * channels, os.fstat(file.fileno()).st_size - found.end()
        if 4 * count != left:
            raise InputError(path, f"{4 * count} bytes of pixels for {width} x {height}", left)
        file.seek(found.end())
        pixels = np.fromfile(file, "<f4" if scale < 0 else ">f4", count)
    pixels = pixels.reshape((height, width, 3) if channels == 3 else (height, width))[::-1]
    pixels = np.ascontiguousarray(pixels, np.float32)
    if abs(scale) != 1:
        with np.errstate(over="ignore", invalid="ignore"):
            pixels = pixels * np.float32(min(abs(scale), float(np.finfo(np.float32).max)))
    return pixels


def pfm_bytes(pixels: np.ndarray) -> bytes:
    """(H, W, 3) or (H, W) as a little-endian PFM."""
    height, width = pixels.shape[:2]
    head = f"{'PF' if pixels.ndim == 3 else 'Pf'}\n{width} {height}\n-1.0\n"
    return head.encode() + np.ascontiguousarray(pixels[::-1], "<f4").tobytes()
