"""Limits as idiff counts them. The verdicts in the table are those of OpenImageIO 3.2's idiff on the same pixels."""

import math

import numpy as np
import pytest

from raytwin.compare import Limits, limit_findings, measure
from raytwin.image import Image

ONES = np.ones((10, 10, 3), np.float32)
ONE_OFF = ONES.copy()
ONE_OFF[0, 0, 0] = 1.1
HALF_OFF = ONES.copy()
HALF_OFF[:5, :, 1] = 1.1
HALF_OFF[9, 9] = 3


@pytest.mark.parametrize(
    ("image", "limits", "passes"),
    [
        (ONES, {}, True),
        (ONE_OFF, {}, False),
        (ONE_OFF, {"error": 0.2}, True),
        (ONE_OFF, {"error": 0, "relative": 0.05}, False),
        (ONE_OFF, {"error": 0, "relative": 0.2}, True),
        (ONE_OFF, {"error": 0.2, "relative": 0.05}, True),
        (ONE_OFF, {"error": 0.05, "percent": 1}, True),
        (ONE_OFF, {"error": 0.05, "percent": 0.5}, False),
        (ONE_OFF, {"error": 0.05, "pixels": 1}, True),
        (HALF_OFF, {"error": 0.05, "percent": 50}, False),
        (HALF_OFF, {"error": 0.05, "percent": 51}, True),
        (HALF_OFF, {"error": 0.05, "percent": 60, "hard": 1}, False),
        (HALF_OFF, {"error": 0.05, "percent": 60, "hard": 2}, True),
        (HALF_OFF, {"error": 0.05, "pixels": 51, "hard": 1}, True),
        (HALF_OFF, {"error": 0.05, "pixels": 50}, False),
    ],
)
def test_the_limits_decide_as_idiff_does(image, limits, passes):
    found, _ = limit_findings(Image(ONES), Image(image), Limits(**limits))
    assert (not found) == passes
    assert (not limit_findings(Image(image), Image(ONES), Limits(**limits))[0]) == passes


def test_the_relative_error_is_that_of_the_two_values_mean():
    for relative, passes in ((0.0950, False), (0.0955, True)):  # 0.1 / 1.05 = 0.0952, as idiff finds
        found, _ = limit_findings(Image(1.1 * ONES), Image(ONES), Limits(error=0, relative=relative))
        assert (not found) == passes


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_what_is_not_finite_fails_where_idiff_passes_it(bad, which):
    spoilt = ONES.copy()
    spoilt[3, 4, 2] = bad
    pair = [Image(spoilt if which in (i, 2) else ONES) for i in (0, 1)]
    found, _ = limit_findings(*pair, Limits(error=10, percent=100, pixels=100))
    assert found
    assert "(x=4, y=3)" in found[0].text


def test_a_pixel_beyond_the_hard_limit_fails_where_no_other_limit_is_met():
    """idiff passes this one: it looks at its hard limit only when another is exceeded."""
    found, _ = limit_findings(Image(HALF_OFF), Image(ONES), Limits(error=10, hard=1))
    assert [f.text for f in found] == ["1 pixel of 100 err by more than 1 (allowed 0); the worst 2 at (x=9, y=9), red"]


def test_one_channel_beyond_the_hard_limit_is_enough():
    found, _ = limit_findings(Image(ONE_OFF), Image(ONES), Limits(error=10, hard=0.05))
    assert [f.text for f in found] == [
        "1 pixel of 100 err by more than 0.05 (allowed 0); the worst 0.1 at (x=0, y=0), red"
    ]


def test_the_worst_is_found_in_every_strip():
    rng = np.random.default_rng(1)
    for _ in range(20):
        a = rng.random((int(rng.integers(1, 300)), int(rng.integers(1, 20)), 3)).astype(np.float32)
        y, x, c = (int(rng.integers(n)) for n in a.shape)
        b = a.copy()
        b[y, x, c] += 5
        found, _ = limit_findings(Image(b), Image(a), Limits(error=0.1))
        assert f"at (x={x}, y={y}), {('red', 'green', 'blue')[c]}" in found[0].text
        assert f"1 pixel of {a.shape[0] * a.shape[1]}" in found[0].text


def test_metrics_are_those_of_the_finite_values_and_null_without_any():
    spoilt = ONE_OFF.copy()
    spoilt[5, 5] = np.nan
    names = ("mae", "max_abs", "flip_ldr")
    numbers = measure(spoilt, ONES, iter(names))
    assert numbers == {"mae": pytest.approx(0.1 / 297, rel=1e-5), "max_abs": pytest.approx(0.1), "flip_ldr": None}
    assert measure(np.full_like(ONES, np.nan), ONES, names) == dict.fromkeys(names)
    assert measure(ONES[:5], ONES, names) == dict.fromkeys(names)
    assert measure(ONES, ONES, ["psnr"]) == {"psnr": None}  # infinite


def test_the_worst_is_told_however_small_and_whatever_else_is_no_number():
    spoilt = ONE_OFF.copy()
    spoilt[9, 9, 2] = math.nan
    found, _ = limit_findings(Image(spoilt), Image(ONES), Limits(error=0.05, percent=1, pixels=1, hard=0.09))
    assert "1 NaN value" in found[0].text
    found, _ = limit_findings(Image(spoilt), Image(ONES), Limits(error=0.05, hard=0.05))
    assert found[-1].text.endswith("; the worst 0.1 at (x=0, y=0), red")
    found, _ = limit_findings(Image(HALF_OFF), Image(ONES), Limits(error=0.05, pixels=2, percent=1))
    assert "(allowed 1 % or 2 pixels)" in found[0].text
    assert "(allowed 1 %)" in limit_findings(Image(HALF_OFF), Image(ONES), Limits(error=0.05, percent=1))[0][0].text
