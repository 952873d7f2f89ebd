"""Read any image: its first bytes say which format it is. EXR and PFM are linear, pictures of 8 bits are sRGB."""

import os
from dataclasses import replace
from pathlib import Path

from raytwin.errors import InputError
from raytwin.images.exr import EXR_MAGIC, read_exr, split_layer, stack, write_exr
from raytwin.images.image import Image
from raytwin.images.pfm import pfm_bytes, read_pfm
from raytwin.images.photo_files import from_bytes, read_picture, to_bytes, write_picture
from raytwin.safe_write import check_file, replacing

MAGIC = {
    EXR_MAGIC: "EXR", b"PF": "PFM", b"Pf": "PFM", b"#?": "HDR", b"\x89PNG": "PNG", b"\xff\xd8": "JPEG", b"BM": "BMP",
    **{b"P%d" % k: "PPM" for k in range(1, 7)}, b"II*\0": "TIFF", b"MM\0*": "TIFF", b"RIFF": "WebP",
}  # fmt: skip
KINDS = "EXR, PFM, PNG, JPEG, PPM, TIFF, BMP or WebP"


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
    return Image(pixels if pixels.ndim == 3 else stack([pixels] * 3), samples=0, alpha=alpha, format=kind)


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
