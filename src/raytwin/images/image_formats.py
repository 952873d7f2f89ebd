"""Read any image: its first bytes say which format it is. EXR and PFM are linear, pictures of 8 bits are sRGB."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from raytwin.errors import InputError
from raytwin.images.exr import EXR_MAGIC, read_exr, split_layer, write_exr
from raytwin.images.image import Image
from raytwin.images.limits import check_size
from raytwin.images.photo_files import from_bytes, read_picture, to_bytes, write_picture
from raytwin.safe_write import check_file, replacing

MAGIC = {
    EXR_MAGIC: "EXR", b"PF": "PFM", b"Pf": "PFM", b"#?": "HDR", b"\x89PNG": "PNG", b"\xff\xd8": "JPEG", b"BM": "BMP",
    **{b"P%d" % k: "PPM" for k in range(1, 7)}, b"II*\0": "TIFF", b"MM\0*": "TIFF", b"RIFF": "WebP",
}  # fmt: skip
KINDS = "EXR, PFM, PNG, JPEG, PPM, TIFF, BMP or WebP"

PFM_HEADER = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)[ \t\r]*\n")
LONGEST_PFM_HEADER = 256
"""Bytes: three lines are far shorter."""


def read_image(path: str | os.PathLike, layer: str | None = None) -> Image:
    """Read an EXR, PFM, PNG, JPEG, PPM, TIFF, BMP or WebP, whatever its name, as an Image.

    `layer` (`diffuse` for `diffuse.R`..., a single channel, or a part's name) chooses within an EXR, as does the path
    itself: `render.exr:diffuse`. By default it is the first part with colours, with the variance and surface that
    `write_exr` wrote, or Blender's layer Combined. Grey becomes three equal channels, and pictures of 8 bits are taken
    to be sRGB. An EXR's pixels are those of its data window. Raises InputError for a file at `path`
    that is none of these, or damaged; a Radiance HDR and a picture of 16 bits are refused with the command that
    converts them.
    """
    path, named = split_layer(path)
    path, layer = check_file(path, "an image file"), named or layer
    try:
        with path.open("rb") as file:
            kind = kind_of(file.read(4))
        if kind is None:
            raise InputError(path, f"an image: {KINDS}", "a file of another kind")
        if kind == "HDR":
            raise InputError(path, "an EXR", "a Radiance HDR (convert it: oiiotool a.hdr -o a.exr)")
        if kind != "EXR" and layer is not None:
            raise InputError(path, "an EXR, which has layers", kind)
        if kind == "EXR":
            return replace(read_exr(path, layer)[0], format=kind)
        if kind == "PFM":
            pixels, alpha = read_pfm(path), None
        else:
            codes, alpha = read_picture(path)
            pixels = from_bytes(codes)
    except OSError as error:
        raise InputError(path, "an image file", error.strerror or error) from None
    return Image(pixels, samples=0, alpha=alpha, format=kind)


def kind_of(start: bytes) -> str | None:
    """Return the format that a file of these first 4 bytes has; None for another one."""
    return next((kind for magic, kind in MAGIC.items() if start.startswith(magic)), None)


def write_image(path: str | os.PathLike, image: Image) -> None:
    """Write an image to `path` by its ending: EXR with everything, PFM the mean, PNG or JPEG the mean as 8-bit sRGB.

    Raises InputError for another ending. Nothing is left half-written.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".exr":
        write_exr(path, image)
    elif suffix == ".pfm":
        with replacing(path) as temporary:
            temporary.write_bytes(pfm_bytes(image.mean))
    else:
        write_picture(path, to_bytes(image.mean))


def read_pfm(path: str | os.PathLike) -> np.ndarray:
    """(H, W, 3) float32, row 0 on top, after Debevec's description: `PF` (colour) or `Pf` (grey), width and height, a
    scale whose sign is the byte order, rows from the bottom up."""
    with Path(path).open("rb") as file:
        found = PFM_HEADER.match(file.read(LONGEST_PFM_HEADER))
        if not found:
            raise InputError(path, "a PFM's header: PF or Pf, width, height, scale", "a damaged one")
        width, height = int(found[2]), int(found[3])
        channels = 3 if found[1] == b"PF" else 1
        check_size(path, width, height, 4 * channels)
        scale = float(found[4])
        if abs(scale) != 1:
            raise InputError(path, "a PFM of scale 1 or -1, which tells the byte order", scale)
        count, left = width * height * channels, os.fstat(file.fileno()).st_size - found.end()
        if 4 * count != left:
            raise InputError(path, f"{4 * count} bytes of pixels for {width} x {height}", left)
        file.seek(found.end())
        pixels = np.fromfile(file, "<f4" if scale < 0 else ">f4", count)
    pixels = np.repeat(pixels.reshape(height, width, channels)[::-1], 3 // channels, axis=-1)
    return np.ascontiguousarray(pixels, np.float32)


def pfm_bytes(pixels: np.ndarray) -> bytes:
    """(H, W, 3) as a little-endian PFM."""
    height, width = pixels.shape[:2]
    return f"PF\n{width} {height}\n-1.0\n".encode() + np.ascontiguousarray(pixels[::-1], "<f4").tobytes()
