"""The header of an EXR, read here because the library allocates by it before it looks at the data.

Layout: magic, version and flags, then for each part its attributes (name, type, size, bytes) up to an empty name;
a multi-part file ends its headers with an empty one. OpenEXR, "OpenEXR File Layout".
"""

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from raytwin.errors import InputError
from raytwin.files.limits import FREE, check_size

EXR_MAGIC = b"\x76\x2f\x31\x01"
TILED, LONG_NAMES, DEEP, MULTI_PART = 0x200, 0x400, 0x800, 0x1000
PIXEL_BYTES = {0: 4, 1: 2, 2: 4}
"""uint32, half, float."""
MOST_HEADER_BYTES = 4 << 20
"""Headers longer than this hold no picture's description."""
MOST_COORDINATE = 1 << 26
"""Windows further out than this make 32-bit sums of coordinates overflow."""
UNCOMPRESSED = 0
BLOCK_ROWS = (1, 1, 1, 16, 32, 16, 32, 32, 32)
"""Rows that are compressed together, by compression; 256 in all later ones."""


class Window(NamedTuple):
    """Pixels x0 .. x1, y0 .. y1, both ends included."""

    x0: int
    y0: int
    x1: int
    y1: int


@dataclass(frozen=True)
class ExrPart:
    """What a part claims: its channels' names, whether any is subsampled, where its data lie on the display."""

    name: str
    channels: tuple[str, ...]
    subsampled: tuple[str, ...]
    data: Window
    display: Window

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the data."""
        return self.data.x1 - self.data.x0 + 1, self.data.y1 - self.data.y0 + 1


def read_exr_header(path: str | os.PathLike) -> list[ExrPart]:
    """Every part of a sound, flat EXR; InputError for a header that lies about sizes or cannot be read."""
    length = Path(path).stat().st_size
    with Path(path).open("rb") as file:
        data = file.read(min(length, MOST_HEADER_BYTES))
    try:
        headers = _headers(data)
        parts = [_part(header, i, length) for i, header in enumerate(headers)]
    except (struct.error, ValueError, KeyError, IndexError) as error:
        raise InputError(path, "an EXR file", f"a damaged one ({_why(error)})") from None
    # All parts are decoded together, so together they must fit.
    total = sum(part.size[0] * part.size[1] * pixel for part, pixel in parts)
    for part, _ in parts:
        pixels = part.size[0] * part.size[1]
        check_size(path, *part.size, -(-total // max(pixels, 1)))
    return [part for part, _ in parts]


def _why(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"without {error.args[0]}"
    return "its header ends early" if isinstance(error, struct.error | IndexError) else str(error)


def _headers(data: bytes) -> list[dict[str, Any]]:
    """Each part's attributes by name, as bytes."""
    if data[:4] != EXR_MAGIC:
        raise ValueError("not its first bytes")
    (version,) = struct.unpack_from("<I", data, 4)
    if version & 0xFF != 2 or version & ~(0xFF | TILED | LONG_NAMES | DEEP | MULTI_PART):
        raise ValueError(f"version {version:#x}")
    if version & DEEP:
        raise ValueError("deep pixels, which have no single value")
    headers, at = [], 8
    while True:
        header: dict[str, Any] = {}
        while data[at]:
            name, at = _text(data, at)
            _, at = _text(data, at)
            (size,) = struct.unpack_from("<i", data, at)
            at += 4
            if not 0 <= size <= len(data) - at:
                raise ValueError(f"attribute {name[:40]}: {size} bytes")
            header[name] = data[at : at + size]
            at += size
        at += 1
        if header:
            headers.append(header | {"tiled": bool(version & TILED), "end": at})
        if not version & MULTI_PART or not header:
            break
    if not headers:
        raise ValueError("no part")
    return headers


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(0, at, at + 256)
    return data[at:end].decode("utf-8", "replace"), end + 1


def _part(header: dict[str, Any], index: int, length: int) -> tuple[ExrPart, int]:
    """The part, and how many bytes its pixel takes in memory."""
    data, display = (Window(*struct.unpack("<4i", header[key])) for key in ("dataWindow", "displayWindow"))
    for window in (data, display):
        if max(map(abs, window)) > MOST_COORDINATE or window.x1 < window.x0 or window.y1 < window.y0:
            raise ValueError(f"a window {tuple(window)}")
    channels = _channels(header["channels"])
    kind = header.get("type", b"").rstrip(b"\0")
    if kind.startswith(b"deep"):
        raise ValueError("deep pixels, which have no single value")
    width, height = data.x1 - data.x0 + 1, data.y1 - data.y0 + 1
    pixel = sum(PIXEL_BYTES[kind] for _, kind, _ in channels)
    tiled = kind == b"tiledimage" if kind else header["tiled"]
    (compression,) = struct.unpack("<B", header["compression"])
    if tiled:
        block = struct.unpack_from("<2I", header["tiles"])
    else:
        block = width, BLOCK_ROWS[compression] if compression < len(BLOCK_ROWS) else 256
    # One block is decoded as a whole, also where the picture is smaller.
    if 0 in block or block[0] * block[1] * pixel > max(FREE, 2 * width * height * pixel):
        raise ValueError(f"blocks of {block[0]} x {block[1]} pixels")
    chunks = -(-width // block[0]) * -(-height // block[1])
    left = length - header["end"]
    # Each block takes 8 bytes in the table of offsets and 8 at least of its own.
    if 16 * chunks > left:
        raise ValueError(f"{width} x {height} pixels in {left} bytes")
    if "chunkCount" in header and 16 * (count := struct.unpack("<i", header["chunkCount"])[0]) > left:
        raise ValueError(f"{count} chunks in {left} bytes")
    subsampled = tuple(name for name, _, sampling in channels if sampling != (1, 1))
    if compression == UNCOMPRESSED and not subsampled and width * height * pixel > left:
        raise ValueError(f"{width * height * pixel} bytes of pixels in {left}")
    name = header.get("name", b"").rstrip(b"\0").decode("utf-8", "replace")
    return ExrPart(name or str(index), tuple(name for name, _, _ in channels), subsampled, data, display), pixel


def _channels(data: bytes) -> list[tuple[str, int, tuple[int, int]]]:
    """(name, pixel type, (x, y) sampling) of each channel."""
    channels, at = [], 0
    while data[at]:
        name, at = _text(data, at)
        kind, _, across, down = struct.unpack_from("<iI2i", data, at)
        if kind not in PIXEL_BYTES:
            raise ValueError(f"channel {name[:40]}: pixel type {kind}")
        if across < 1 or down < 1:
            raise ValueError(f"channel {name[:40]}: sampling {across} x {down}")
        channels.append((name, kind, (across, down)))
        at += 16
    if not channels:
        raise ValueError("no channels")
    return channels
