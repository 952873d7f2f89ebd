"""OpenImageIO reads the same files and counts the same errors: where it differs from us, the test says so.

It is no dependency: it refuses the old runs of Radiance HDR, leaves EXPOSURE in, turns a PFM upside down, and takes a
JPEG that ends early for a whole one.
"""

import numpy as np
import OpenImageIO as oiio
import pytest
from hostile import sound_files
from hypothesis import given, settings
from hypothesis import strategies as st

from raytwin import files
from raytwin.compare import Limits, limit_findings
from raytwin.image import Image

SOUND = {name: data for name, data in sound_files().items() if not name.startswith(("layers", "parts"))}


def read_by_oiio(path, name: str) -> np.ndarray:
    """(H, W, 3) float32, linear, row 0 on top, as this project means it."""
    opened = oiio.ImageInput.open(str(path))
    pixels = opened.read_image(oiio.FLOAT)[..., :3]
    opened.close()
    kind = name.rpartition(".")[2]
    if kind == "pfm":
        pixels = pixels[::-1]
    elif kind == "hdr":
        pixels = pixels / 2  # its EXPOSURE
    elif kind in ("png", "jpg"):
        pixels = np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)
    return np.broadcast_to(pixels, (*pixels.shape[:2], 3))


@pytest.mark.parametrize("name", sorted(SOUND))
def test_openimageio_reads_the_same_pixels(tmp_path, name):
    (tmp_path / name).write_bytes(SOUND[name])
    ours, theirs = files.read_image(tmp_path / name).mean, read_by_oiio(tmp_path / name, name)
    assert (ours.dtype, ours.shape) == (np.float32, (21, 33, 3))
    assert np.abs(ours - theirs).max() <= (1e-6 if name.endswith(("png", "jpg")) else 0)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([1e-3, 0.1, 10.0]),
    error=st.sampled_from([0.0, 1e-3, 0.05, 0.3]),
    relative=st.sampled_from([0.0, 0.02, 0.5]),
)
def test_pixels_beyond_a_limit_are_counted_as_idiff_counts_them(seed, size, error, relative):
    rng = np.random.default_rng(seed)
    a = rng.random((9, 13, 3), np.float32)
    b = a + size * rng.standard_normal(a.shape, np.float32) * (rng.random((9, 13, 1)) < 0.4)
    counted = oiio.ImageBufAlgo.compare(oiio.ImageBuf(b), oiio.ImageBuf(a), error, error, relative, relative)
    for allowed in {max(counted.nfail - 1, 0), counted.nfail}:
        found, _ = limit_findings(Image(b), Image(a), Limits(error=error, relative=relative, pixels=allowed))
        assert bool(found) == (counted.nfail > allowed)
