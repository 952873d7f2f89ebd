"""OpenImageIO reads the same files: where it differs from us, the test says so.

It is no reader of ours: it turns a PFM upside down, and takes a JPEG that ends early for a whole one.
"""

import numpy as np
import OpenImageIO as oiio
import pytest
from hostile import sound_files

from raytwin.images.image_formats import read_image

SOUND = {name: data for name, data in sound_files().items() if not name.startswith(("layers", "parts"))}


def read_by_oiio(path, name: str) -> np.ndarray:
    """(H, W, 3) float32, linear, row 0 on top, as this project means it."""
    opened = oiio.ImageInput.open(str(path))
    pixels = opened.read_image(oiio.FLOAT)[..., :3]
    opened.close()
    kind = name.rpartition(".")[2]
    if kind == "pfm":
        pixels = pixels[::-1]
    elif kind != "exr":
        pixels = np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)
    return np.broadcast_to(pixels, (*pixels.shape[:2], 3))


@pytest.mark.parametrize("name", sorted(SOUND))
def test_openimageio_reads_the_same_pixels(tmp_path, name):
    (tmp_path / name).write_bytes(SOUND[name])
    ours, theirs = read_image(tmp_path / name).mean, read_by_oiio(tmp_path / name, name)
    assert (ours.dtype, ours.shape) == (np.float32, (21, 33, 3))
    assert np.abs(ours - theirs).max() <= (0 if name.endswith(("exr", "pfm")) else 1e-6)
