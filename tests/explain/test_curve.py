"""One curve through all values is told with its exponent or name, and nothing else is taken for one."""

import numpy as np
import pytest

from raytwin.explain.diagnosis import explain
from raytwin.images.image import Image
from raytwin.images.image_formats import write_image
from raytwin.study.diff_files import compare as diff

RNG = np.random.default_rng(1)
Y, X = np.mgrid[0:96, 0:128] / 96
SMOOTH = np.stack([0.02 + 0.6 * X, 0.05 + 0.6 * Y, 0.1 + 0.3 * X * Y], axis=-1)
SMOOTH[40:64, 30:60] *= 1.8
SMOOTH[4:28, 50:78] = 18
RANDOM = RNG.gamma(1, 0.4, (96, 128, 3))
ANY = "one curve, as a view transform makes it"
CURVES = {
    "without a square root": lambda v: v**0.5,
    "the power 0.5 = 1/2, times 2": lambda v: 2 * v**0.5,
    "without a power of 1/2.2": lambda v: v ** (1 / 2.2),
    "raised to the power 0.417": lambda v: v ** (1 / 2.4),
    "the power 0.7, times 2.5": lambda v: 2.5 * v**0.7,
    ANY: lambda v: v * (1 + v / 16) / (1 + v),
    "tone-mapped, x / (1 + x)": lambda v: v / (1 + v),
    "tone-mapped, 1 - exp(-x)": lambda v: 1 - np.exp(-v),
}
OTHERS = {
    "a factor": lambda v: 1.7 * v,
    "a tint": lambda v: v * [1, 0.9, 0.8],
    "a darker part": lambda v: np.where((X < 0.2)[..., None], 0.9 * v, v),
    "light from one side": lambda v: v + 0.2 * X[..., None],
    "noise": lambda v: v * (1 + 0.05 * RNG.normal(size=v.shape)),
    "other values": lambda v: RNG.permutation(v.ravel()).reshape(v.shape),
    "itself": lambda v: v,
}


@pytest.mark.nightly
@pytest.mark.parametrize("words", CURVES)
@pytest.mark.parametrize("picture", [SMOOTH, RANDOM], ids=["smooth", "random"])
def test_a_curve_is_told_with_its_exponent_or_name(words, picture):
    found = diff(CURVES[words](picture).astype(np.float32), picture.astype(np.float32))
    assert words in found.cause


def test_a_curve_is_told_of_pictures_of_8_bits(tmp_path):
    light = SMOOTH / 2
    for name, values in (("test", np.log1p(light)), ("reference", light)):
        write_image(tmp_path / f"{name}.png", Image(values.astype(np.float32)))
    assert ANY in diff(tmp_path / "test.png", tmp_path / "reference.png").cause


def test_no_curve_is_told_of_anything_else():
    for name, change in OTHERS.items():
        for picture in (SMOOTH, RANDOM):
            shown, right = (Image(x.astype(np.float32)) for x in (change(picture), picture))
            assert not any("one curve" in found.text for found in explain(shown, right)), name


def test_few_levels_are_no_curve():
    steps = np.floor(20 * X)[..., None].repeat(3, axis=-1).astype(np.float32)
    assert not any("one curve" in found.text for found in explain(Image(steps**1.5 + 0.1), Image(steps)))
