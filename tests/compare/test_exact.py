"""The verdict does not change when both images are multiplied by a power of two."""

import math
from dataclasses import replace

import numpy as np
import pytest
from measure.noise_models import picture, quantised, render

from raytwin.compare import compare
from raytwin.compare.exact import Bound, scale_of, unit_of
from raytwin.images.image import Image
from raytwin.images.stored_precision import half_code

TRUTH = picture(24, 32)


def pairs():
    """Pairs that pass, fail, and are undecided, with noise and without; made once."""
    rng = np.random.default_rng(11)
    exact = TRUTH.astype(np.float32)
    wrong = exact.copy()
    wrong[5:9, 7:9] *= np.float32(1.0002)
    a, b = render(rng, TRUTH), render(rng, TRUTH, samples=1024)
    bits = quantised(a)
    made = {
        "rounding": (Image(exact * np.float32(1 + 3e-6)), Image(exact)),
        "a little wrong": (Image(wrong), Image(exact)),
        "shifted": (Image(np.roll(exact, 1, axis=1)), Image(exact)),
        "negative": (Image(exact - np.float32(0.4)), Image(exact)),
        "noise": (a, b),
        "noise, 3 % off": (replace(a, mean=a.mean * np.float32(1.03)), b),
        "near the tolerance": (render(rng, TRUTH, sd=2e-5), render(rng, TRUTH, sd=2e-5)),
        "nothing told": (replace(a, variance=None, samples=0), replace(b, variance=None, samples=0)),
        "fireflies": (render(rng, TRUTH, p=1e-3, size=30.0), b),
        "8 bits": (bits, b),
    }
    return {name: (*pair, half_code(bits.mean) if name == "8 bits" else None) for name, pair in made.items()}


PAIRS = pairs()


def times(image, k):
    variance = None if image.variance is None else np.ldexp(image.variance, 2 * k)
    return replace(image, mean=np.ldexp(image.mean, k), variance=variance)


def numbers(c):
    s = c.statistics
    return s.z_mean, s.z_tile_worst, s.pixel_fail_fraction, s.minimum_detectable_bias, c.geometry.shift_px


@pytest.mark.parametrize("power", [-30, 7, 30])
def test_the_verdict_stays_when_both_images_are_multiplied_by_a_power_of_two(power):
    for name, (a, b, step) in PAIRS.items():
        before = compare(a, b, half_steps=(step, None))
        half = None if step is None else np.ldexp(step, power)
        after = compare(times(a, power), times(b, power), half_steps=(half, None))
        assert after.verdict == before.verdict, name
        assert len(after.reasons) == len(before.reasons), name
        for x, y in zip(numbers(after), numbers(before), strict=True):
            assert x == (y if y is None else pytest.approx(y, rel=1e-4)), name


def test_the_pairs_have_every_verdict():
    found = {name: compare(a, b, half_steps=(step, None)).verdict for name, (a, b, step) in PAIRS.items()}
    assert set(found.values()) == {"pass", "fail", "undecided"}
    assert found["near the tolerance"] == found["8 bits"] == found["rounding"] == "pass"


def test_errors_are_told_in_the_images_own_units():
    a, b, _ = PAIRS["a little wrong"]
    small, large = (compare(times(a, k), times(b, k)).reasons for k in (-20, 20))
    worst = float(np.abs(a.mean - b.mean).max())
    assert f"the worst {worst * 2.0**-20:.3g} at" in small[0]
    assert f"the worst {worst * 2.0**20:.3g} at" in large[0]


def test_the_scale_is_what_is_lit_best_whatever_share_is_background():
    for rows in (1, 20, 40):
        r = np.zeros((40, 50, 3), np.float32)
        r[:rows] = np.float32(0.8)
        r[0, 0, 0] = 1e6  # a highlight
        assert scale_of(Image(r)) == pytest.approx(0.8)
    black = Image(np.zeros_like(r))
    assert scale_of(black, Image(r)) == pytest.approx(0.8)
    assert scale_of(black, black) == 1
    values = np.arange(-200, 1000, dtype=np.float32).reshape(20, 20, 3)
    assert scale_of(Image(values)) == pytest.approx(1 + 0.99 * 998, abs=1)


@pytest.mark.parametrize("scale", [1e-30, 0.5, 0.7, 1.0, 3.0, 1e30])
def test_the_unit_is_the_power_of_two_below(scale):
    unit = unit_of(scale)
    assert math.frexp(unit)[0] == 0.5
    assert unit <= scale < 2 * unit


def test_a_bound_is_a_share_of_the_scale_or_of_a_brighter_value():
    bound = Bound(1e-5, 0.5)
    assert bound.least == 5e-6
    assert bound.of(np.array([0.0, 0.4, -2.0, 100.0])) == pytest.approx([5e-6, 5e-6, 2e-5, 1e-3])
    r = np.full((20, 20, 3), 0.5, np.float32)
    r[3, 3] = 1e5
    t = r.copy()
    t[3, 3] += np.float32(0.1)  # rounding of a lamp, not an error of a thousand times the tolerance
    assert compare(Image(t), Image(r)).passed
    t[3, 3] += np.float32(1000)
    assert not compare(Image(t), Image(r)).passed
