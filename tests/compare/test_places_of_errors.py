"""Where and by how much values are off is said in the image's own rows and units, however tall or bright it is."""

import re

import numpy as np
import pytest

from raytwin.compare import compare
from raytwin.compare.noise import _fireflies
from raytwin.image import Image


def test_the_worst_value_of_a_tall_image_is_said_to_be_in_its_own_row_and_the_share_in_percent():
    right = np.random.default_rng(1).uniform(0.2, 0.8, (8192, 8, 3)).astype(np.float32)
    wrong = right.copy()
    wrong[8000:8100] += 0.01
    wrong[8050, 3, 1] += 0.1
    said = " ".join(compare(Image(wrong), Image(right)).reasons)
    assert "x=3, y=8050" in said
    share = re.search(r"([\d.]+) %", said)
    assert share is not None
    assert float(share[1]) == pytest.approx(100 * 100 / 8192, rel=0.01)


@pytest.mark.parametrize("unit", [1e-20, 1.0, 1e20])
def test_the_quantile_of_the_error_is_in_the_images_own_unit(unit):
    right = np.random.default_rng(2).uniform(0.2, 0.8, (40, 50, 3))
    wrong = right + np.random.default_rng(3).uniform(0, 0.01, right.shape)
    wrong, right = ((unit * x).astype(np.float32) for x in (wrong, right))
    said = " ".join(compare(Image(wrong), Image(right)).reasons)
    found = re.search(r"99.9 % quantile of the error: (\S+) absolute", said)
    assert found is not None, said
    expected = np.quantile(np.abs(wrong.astype(float) - right), 0.999)
    assert float(found[1]) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("turns", range(4))
def test_a_noisy_run_along_any_border_is_no_firefly(turns):
    """Its neighbours along the border are as noisy: an edge, not a rare event."""
    v = np.full((9, 9, 3), 1e-6, np.float32)
    v[0, 3:6, 1] = 1.0
    v = np.rot90(v, turns).copy()
    y, x, c = np.nonzero(v > 0.5)
    middle = np.rot90(np.arange(81).reshape(9, 9), turns).ravel().tolist().index(4)
    found = _fireflies(np.zeros_like(v), v, y, x, c)
    assert (middle // 9, middle % 9) not in set(zip(found[0].tolist(), found[1].tolist(), strict=True))
