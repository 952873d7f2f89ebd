"""Alpha: read and kept, not compared, and told where straight colours meet premultiplied ones."""

import numpy as np
import OpenEXR
from PIL import Image as Pillow

from raytwin.images.exr import write_exr
from raytwin.images.image import Image
from raytwin.images.image_formats import read_image
from raytwin.images.image_pool import ImagePool
from raytwin.images.photo_files import to_bytes
from raytwin.study.diff_files import compare as diff

RNG = np.random.default_rng(5)
RGB = RNG.random((32, 40, 3)).astype(np.float32)
OPAQUE = np.ones((32, 40), np.float32)
SOFT = np.linspace(0, 1, 32 * 40, dtype=np.float32).reshape(32, 40)


def rgba(alpha, rgb=RGB):
    return np.dstack([rgb, alpha])


def codes(alpha, rgb):
    """8 bits of sRGB, and of alpha."""
    return Pillow.fromarray(np.dstack([to_bytes(rgb), np.rint(255 * alpha).astype(np.uint8)]))


def test_a_verdict_says_that_alpha_was_not_compared_unless_all_is_opaque():
    for pair in ((rgba(SOFT), rgba(OPAQUE)), (rgba(SOFT), RGB), (RGB, rgba(SOFT))):
        assert "alpha was not compared" in diff(*pair).reasons
    for pair in ((rgba(OPAQUE), RGB), (RGB, RGB)):
        assert not any("alpha" in reason for reason in diff(*pair).reasons)


def test_files_pools_and_layers_keep_their_alpha(tmp_path):
    write_exr(tmp_path / "soft.exr", Image(RGB, alpha=SOFT))
    np.testing.assert_array_equal(read_image(tmp_path / "soft.exr").alpha, SOFT)
    for kind in ("png", "tiff"):
        codes(SOFT, RGB).save(tmp_path / f"soft.{kind}")
        np.testing.assert_allclose(read_image(tmp_path / f"soft.{kind}").alpha, SOFT, atol=0.5001 / 255)
    pool = ImagePool()
    for k in range(4):
        pool.add(Image(RGB + k, samples=0, alpha=np.full((32, 40), k / 3, np.float32)))
    np.testing.assert_allclose(pool.image.alpha, 0.5)
    pool.add(Image(RGB + 5, samples=0))
    assert pool.image.alpha is None
    planes = {f"View.Combined.{c}": np.ascontiguousarray(rgba(SOFT)[..., k]) for k, c in enumerate("RGBA")}
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(tmp_path / "x.exr"))
    np.testing.assert_array_equal(read_image(tmp_path / "x.exr").alpha, SOFT)


def test_straight_and_premultiplied_colours_are_told(tmp_path):
    premultiplied, straight = RGB * SOFT[..., None], "the colours are straight, the reference's are multiplied by alpha"
    multiplied = "the colours are multiplied by alpha"
    assert diff(rgba(SOFT), rgba(SOFT, premultiplied)).cause.startswith(straight)
    assert diff(rgba(SOFT, premultiplied), rgba(SOFT)).cause.startswith(multiplied)
    assert "alpha" not in diff(rgba(SOFT, 0.5 * RGB), rgba(SOFT)).cause
    codes(SOFT, RGB).save(tmp_path / "x.png")
    write_exr(tmp_path / "x.exr", Image(premultiplied, alpha=SOFT))
    assert diff(tmp_path / "x.png", tmp_path / "x.exr").cause.startswith("the colours are straight")
    write_exr(tmp_path / "x.exr", Image(premultiplied))
    assert diff(tmp_path / "x.exr", tmp_path / "x.png").cause.startswith(multiplied)
