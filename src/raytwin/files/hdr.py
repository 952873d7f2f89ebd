"""Radiance HDR: value = mantissa 2^(exponent - 136), three mantissas and one exponent a pixel, mostly run-length coded.

Source: Ward, "Real Pixels", Graphics Gems II, and Radiance's color.c. Values are those of most readers: the
mantissa itself, not Ward's mantissa + 1/2. EXPOSURE is divided out, as the format asks. The repeats of files from
before 1991 and turned pictures, which no program writes today, are refused.
"""

import os
import re
from pathlib import Path

import numpy as np

from raytwin.errors import InputError
from raytwin.files.limits import check_size

RESOLUTION = re.compile(rb"-Y (\d{1,9}) \+X (\d{1,9})\n")
LONGEST_HEADER = 65536
"""Bytes: no header of a known writer comes near it."""


def read_hdr(path: str | os.PathLike) -> np.ndarray:
    """(H, W, 3) float32, row 0 on top."""
    data = Path(path).read_bytes()
    head_end = data.find(b"\n\n", 0, LONGEST_HEADER)
    size = RESOLUTION.match(data, head_end + 2) if data[:2] == b"#?" and head_end >= 0 else None
    if not size:
        raise InputError(path, "a Radiance HDR's header ending with -Y height +X width", "a damaged one")
    lines = data[:head_end].split(b"\n")[1:]
    known = [value for key, _, value in (line.partition(b"=") for line in lines) if key.strip() == b"FORMAT"]
    if known and known[-1].strip() != b"32-bit_rle_rgbe":
        raise InputError(path, "FORMAT=32-bit_rle_rgbe", known[-1].strip().decode("latin-1")[:40])
    height, width = int(size[1]), int(size[2])
    check_size(path, width, height, 12)
    body = data[size.end() :]
    try:
        rgbe = _adaptive(body, width, height) if _is_adaptive(body, width) else _flat(body, width * height)
    except (IndexError, ValueError) as error:
        raise InputError(path, "a whole Radiance HDR", f"a damaged one ({error})") from None
    rgbe = rgbe.reshape(height, width, 4)
    unit = np.ldexp(np.float32(1), np.arange(256) - 136).astype(np.float32)
    unit[0] = 0  # exponent 0 is black
    with np.errstate(over="ignore", invalid="ignore"):
        return rgbe[..., :3] * (unit / np.float32(_exposure(path, lines)))[rgbe[..., 3]][..., None]


def _exposure(path: str | os.PathLike, lines: list[bytes]) -> float:
    product = 1.0
    for line in lines:
        key, _, value = line.partition(b"=")
        if key.strip() == b"EXPOSURE":
            try:
                product *= float(value)
            except ValueError:
                product = np.nan
    if not 1e-30 < product < 1e30:
        raise InputError(path, "EXPOSURE, a number > 0", product)
    return product


def _is_adaptive(body: bytes, width: int) -> bool:
    """Each row begins with 2, 2 and its width; only rows of 8 to 32767 pixels can."""
    return 8 <= width < 32768 and body[:2] == b"\2\2" and body[2:4] == width.to_bytes(2, "big")


def _adaptive(body: bytes, width: int, height: int) -> np.ndarray:
    """Row by row, all R, all G, all B, all E, each as runs (128 + n, value) and stretches (n, n values)."""
    if len(body) < height * (4 + 8 * -(-width // 127)):  # runs of 127 at best
        raise ValueError(f"{width} x {height} pixels in {len(body)} bytes")
    start = b"\2\2" + width.to_bytes(2, "big")
    out = np.empty((height, 4, width), np.uint8)
    at, row_bytes = 0, 4 * width
    for y in range(height):
        if body[at : at + 4] != start:
            raise ValueError(f"row {y} does not begin as one")
        at += 4
        row = bytearray()
        filled, edge = 0, width
        while filled < row_bytes:
            count = body[at]
            if count > 128:
                count -= 128
                row += body[at + 1 : at + 2] * count
                at += 2
            else:
                row += body[at + 1 : at + 1 + count]
                at += 1 + count
            filled += count
            # A run that crosses into the next channel is damage, and so is one without end.
            if count == 0 or filled > edge:
                raise ValueError(f"row {y} is too long")
            if filled == edge:
                edge += width
        if len(row) != row_bytes:
            raise ValueError(f"row {y} ends early")
        out[y] = np.frombuffer(row, np.uint8).reshape(4, width)
    return np.ascontiguousarray(out.transpose(0, 2, 1))


def _flat(body: bytes, count: int) -> np.ndarray:
    """Pixels as they are."""
    pixels = np.frombuffer(body[: len(body) // 4 * 4], np.uint8).reshape(-1, 4)[:count]
    if len(pixels) < count or (pixels[:, :3] == 1).all(axis=1).any():
        raise ValueError(f"{len(pixels)} of {count} pixels, or the repeats of an old file")
    return pixels
