"""The verdict in words: no number that says nothing."""

import re

import numpy as np
import pytest
from measure.noise_models import picture, render

from raytwin.compare import compare
from raytwin.compare.exact import NoiseFree
from raytwin.compare.messages import _amount, agreement
from raytwin.images.image import Image

TRUTH = picture(48, 64)


def test_an_error_is_told_relative_to_what_should_be_there():
    """Where nothing should be, in units of radiance: four of the comparison's."""
    for error, area, text in (
        (0.01, 0.5, "2 % too bright"),
        (-0.25, 0.5, "50 % too dark"),
        (4.5, 0.5, "900 % too bright"),
        (31.5, 0.5, "64 times too bright"),
        (0.25, 0.0, "1 too bright"),
        (0.25, 1e-11, "1 too bright"),  # not 2.5e+10 times
        (-0.5, 0.0, "2 too dark"),
    ):
        assert _amount(error, area, 4.0) == text


def test_a_gross_fault_is_told_without_absurd_numbers():
    rng = np.random.default_rng(1)
    c = compare(render(rng, 2 * TRUTH, samples=1024), render(rng, TRUTH, samples=4096))
    text = " ".join(c.reasons)
    assert c.reasons[0].startswith("the whole image is 100 % too bright in ")
    assert not re.search(r"e-\d{2,3}\b|e\+\d", text)
    assert re.search(r"; (\d+) of \1 tiles are beyond noise", text)
    assert re.search(r"; so are \d+ other pixels", text)


def test_a_pass_with_an_excused_pixel_says_so():
    r = np.full((120, 100, 3), 0.5, np.float32)
    t = r.copy()
    t[7, 9, 1] += np.float32(0.2)
    c = compare(Image(t), Image(r))
    assert c.passed
    assert "1 pixel errs by more, the worst by 0.2 at (x=9, y=7)" in c.reasons[0]
    assert agreement(1e-7, 1e-5, NoiseFree(error=9e-5)).text.endswith("all to 9e-05")
    several = agreement(1e-7, 1e-5, NoiseFree(outliers=3, error=0.5, x=4, y=5)).text
    assert "3 pixels err by more, the worst by 0.5 at (x=4, y=5)" in several


@pytest.mark.parametrize(("part", "words"), [(0.05, "its pixels share"), (0.0, "")])
def test_a_tile_is_said_to_fail_unless_its_pixels_share_random_numbers(part, words):
    """Correct renders whose tiles of 8 x 8 share this part of their variance: they fail, and the reason names it."""
    rng = np.random.default_rng(3)

    def rendered() -> Image:
        common = np.kron(rng.standard_normal((12, 16, 1)), np.ones((8, 8, 1)))
        own = rng.standard_normal((96, 128, 3))
        mean = 0.5 + 0.1 * (np.sqrt(part) * common + np.sqrt(1 - part) * own)
        return Image(mean.astype(np.float32), np.full(mean.shape, 0.01, np.float32), 64, batches=64)

    found = [compare(rendered(), rendered()) for _ in range(3)]
    tiles = [f.text for c in found for f in c.findings if f.kind == "tile"]
    assert bool(tiles) == bool(words)
    assert all(words in text for text in tiles)
