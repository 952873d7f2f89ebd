"""Read any image: its first bytes say which format it is."""

import os
from pathlib import Path

from raytwin.errors import InputError
from raytwin.files.exr import EXR_MAGIC, exr_layer, read_exr, stack, write_exr
from raytwin.files.pfm import pfm_bytes, read_pfm
from raytwin.files.photo_files import from_bytes, read_photo, to_bytes, write_picture
from raytwin.files.safe_write import check_file, replacing
from raytwin.image import Image

MAGIC = {
    EXR_MAGIC: "EXR", b"PF": "PFM", b"Pf": "PFM", b"\x89PNG": "PNG", b"\xff\xd8": "JPEG", b"#?": "HDR",
}  # fmt: skip
BIT_DEPTH = 24
"""Byte of a PNG that holds its bits per channel."""


def read_image(path: str | os.PathLike, part: str | None = None, layer: str | None = None) -> Image:
    """Read an EXR, PFM, PNG or JPEG, whatever its name, as an Image.

    `part` (name or number) and `layer` (`diffuse` for `diffuse.R`..., or a single channel) choose within an EXR.
    By default it is the first part with colours, with the variance and surface that `write_exr` wrote. Grey becomes
    three equal channels, alpha is dropped, and PNG and JPEG are taken to be sRGB. An EXR's pixels are those of its
    data window. Raises InputError for a file at `path` that is none of these, or damaged; a Radiance HDR and a PNG of
    16 bits are refused with the command that converts them.
    """
    path = check_file(path, "an image file")
    try:
        with path.open("rb") as file:
            start = file.read(BIT_DEPTH + 1)
        kind = next((kind for magic, kind in MAGIC.items() if start.startswith(magic)), None)
        if kind is None:
            raise InputError(path, "an image: EXR, PFM, PNG or JPEG", "a file of another kind")
        _check_readable(path, kind, start)
        if kind != "EXR" and (part is not None or layer is not None):
            raise InputError(path, "an EXR, which has parts and layers", kind)
        if kind == "EXR":
            if part is None and layer is None:
                return read_exr(path)[0]
            return exr_layer(path, part, layer)
        pixels = read_pfm(path) if kind == "PFM" else from_bytes(read_photo(path))
    except OSError as error:
        raise InputError(path, "an image file", error.strerror or error) from None
    return Image(pixels if pixels.ndim == 3 else stack([pixels] * 3), samples=0)


def _check_readable(path: Path, kind: str, start: bytes) -> None:
    """Refuse a Radiance HDR and a PNG of 16 bits, with the command that converts them."""
    if kind == "HDR":
        raise InputError(path, "an EXR", "a Radiance HDR (convert it: oiiotool a.hdr -o a.exr)")
    if kind == "PNG" and start[BIT_DEPTH:] > b"\x08":
        convert = "oiiotool a.png --colorconvert sRGB linear -d float -o a.exr"
        raise InputError(path, "a PNG of 8 bits per channel", f"16 (convert it: {convert})")


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
