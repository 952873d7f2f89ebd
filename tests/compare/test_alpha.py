"""Alpha: compared where both images have it, and told where straight colours meet premultiplied ones."""

import numpy as np
import OpenEXR
import pytest
from PIL import Image as Pillow

from raytwin.compare import compare
from raytwin.compare.alpha import alpha_findings
from raytwin.images.exr import write_exr
from raytwin.images.image import Image
from raytwin.images.image_formats import read_image
from raytwin.images.image_input import as_image
from raytwin.images.image_pool import ImagePool
from raytwin.images.photo_files import from_bytes, to_bytes
from raytwin.judging import Judging
from raytwin.study.diff_files import compare as diff

RNG = np.random.default_rng(5)
RGB = RNG.random((32, 40, 3)).astype(np.float32)
OPAQUE, CLEAR = np.ones((32, 40), np.float32), np.zeros((32, 40), np.float32)
SOFT = np.linspace(0, 1, 32 * 40, dtype=np.float32).reshape(32, 40)


def rgba(alpha, rgb=RGB):
    return np.dstack([rgb, alpha])


def codes(alpha, rgb):
    """8 bits of sRGB, and of alpha."""
    return Pillow.fromarray(np.dstack([to_bytes(rgb), np.rint(255 * alpha).astype(np.uint8)]))


def test_an_alpha_fails_beside_another_passes_beside_itself_and_is_told_where_it_is_alone():
    found = diff(rgba(CLEAR), rgba(OPAQUE))
    assert found.verdict == "fail"
    assert found.reasons[0] == ("alpha differs in 1280 pixels, the first at (x=0, y=0): 0, and 1 in the reference")
    for other, verdict in ((SOFT, "pass"), (SOFT + np.float32(1e-6), "pass"), (0.9 * SOFT, "fail")):
        assert diff(rgba(other), rgba(SOFT)).verdict == verdict
    for one, other, whose in ((rgba(SOFT), RGB, "test image"), (RGB, rgba(SOFT), "reference")):
        found = diff(one, other)
        assert found.verdict == "pass"
        assert f"alpha was not compared: only the {whose} has it" in found.reasons
    assert not any("alpha" in reason for reason in diff(rgba(OPAQUE), RGB).reasons)
    image, wrong = Image(RGB, alpha=SOFT), Image(RGB)
    object.__setattr__(wrong, "alpha", SOFT[1:])
    (finding,), _ = alpha_findings(wrong, image, Judging(), (None, None))
    assert finding.text == "the alpha has the shape (31, 40), the reference's (32, 40)"


@pytest.mark.parametrize("kind", ["png", "exr", "tiff"])
def test_files_keep_their_alpha_and_eight_bits_are_held_to_half_a_code(tmp_path, kind):
    grey = 0.5 * OPAQUE[..., None] * np.ones(3, np.float32)
    for name, alpha in (("clear", CLEAR), ("opaque", OPAQUE), ("soft", SOFT)):
        path = tmp_path / f"{name}.{kind}"
        if kind == "exr":
            write_exr(path, Image(grey, alpha=alpha))
            np.testing.assert_array_equal(read_image(path).alpha, alpha)
        else:
            codes(alpha, grey).save(path)
    for name in ("clear", "soft"):
        assert diff(tmp_path / f"{name}.{kind}", tmp_path / f"opaque.{kind}").verdict == "fail"
    shown = grey if kind == "exr" else from_bytes(to_bytes(grey))
    assert diff(tmp_path / f"soft.{kind}", rgba(SOFT, shown)).verdict == "pass"


def test_noisy_alphas_pass_and_a_transparent_one_fails():
    def noisy(alpha):
        noise = RNG.normal(0, 0.01, RGB.shape).astype(np.float32)
        covered = RNG.binomial(16, alpha).astype(np.float32) / 16
        return Image(RGB + 1 + noise, np.full(RGB.shape, 1e-4, np.float32), 16, alpha=covered)

    for _ in range(20):
        assert compare(noisy(SOFT), noisy(SOFT)).verdict == "pass"
    assert compare(noisy(CLEAR), noisy(SOFT)).verdict == "fail"


def test_renders_and_pools_have_the_mean_alpha_and_a_layer_its_own(tmp_path):
    pool = ImagePool()
    for k in range(4):
        pool.add(Image(RGB + k, samples=0, alpha=np.full((32, 40), k / 3, np.float32)))
    np.testing.assert_allclose(pool.image.alpha, 0.5)
    pool.add(Image(RGB + 5, samples=0))
    assert pool.image.alpha is None
    renders = np.stack([rgba(SOFT, RGB + RNG.normal(0, 0.1, RGB.shape)) for _ in range(4)])
    np.testing.assert_allclose(as_image(renders).image.alpha, SOFT, atol=1e-6)
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
