"""Read any image: its first bytes say which format it is."""

import os
from pathlib import Path

from raytwin.errors import InputError
from raytwin.files.exr import EXR_MAGIC, exr_layer, read_exr, stack, write_exr
from raytwin.files.hdr import read_hdr
from raytwin.files.pfm import pfm_bytes, read_pfm
from raytwin.files.photo_files import from_bytes, read_deep_png, read_photo, to_bytes, write_picture
from raytwin.files.safe_write import check_file, replacing
from raytwin.image import Image

MAGIC = {
    EXR_MAGIC: "EXR", b"PF": "PFM", b"Pf": "PFM", b"#?": "HDR", b"\x89PNG": "PNG", b"\xff\xd8": "JPEG",
}  # fmt: skip


def read_image(path: str | os.PathLike, part: str | None = None, layer: str | None = None) -> Image:
    """Read an EXR, PFM, Radiance HDR, PNG (8 and 16 bit) or JPEG, whatever its name, as an Image.

    `part` (name or number) and `layer` (`diffuse` for `diffuse.R`..., or a single channel) choose within an EXR.
    By default it is the first part with colours, with the variance and surface that `write_exr` wrote. Grey becomes
    three equal channels, alpha is dropped, and PNG and JPEG are taken to be sRGB. An EXR's pixels are those of its
    data window. Raises InputError for a file at `path` that is none of these, or damaged.
    """
    path = check_file(path, "an image file")
    try:
        with path.open("rb") as file:
            start = file.read(8)
        kind = next((kind for magic, kind in MAGIC.items() if start.startswith(magic)), None)
        if kind is None:
            raise InputError(path, "an image: EXR, PFM, HDR, PNG or JPEG", "a file of another kind")
        if kind != "EXR" and (part is not None or layer is not None):
            raise InputError(path, "an EXR, which has parts and layers", kind)
        if kind == "EXR":
            if part is None and layer is None:
                return read_exr(path)[0]
            return exr_layer(path, part, layer)
        if kind in ("PFM", "HDR"):
            pixels = (read_pfm if kind == "PFM" else read_hdr)(path)
        else:
            deep = read_deep_png(path) if kind == "PNG" else None
            pixels = from_bytes(read_photo(path)) if deep is None else deep
    except OSError as error:
        raise InputError(path, "an image file", error.strerror or error) from None
    return Image(pixels if pixels.ndim == 3 else stack([pixels] * 3), samples=0)


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
