import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytwin.compare import chance as S
from raytwin.compare import compare
from raytwin.compare.blocks import SIDE, block_sums, dilate, slide, strips
from raytwin.compare.noise import degrees_of_freedom
from raytwin.image import Image
from raytwin.scene import Tolerance

H, W = 40, 56
Y, X = np.mgrid[:H, :W]
TRUTH = (0.3 + 0.5 * (np.hypot(X - 25, Y - 18) < 13) + 0.2 * Y / H)[..., None] * np.array([1, 0.8, 0.6])


def render(rng, truth=TRUTH, samples=16, batches=16, kind="gauss", sd=0.3, p=0.0, size=0.0):
    """Independent batches of `samples` in all: relative noise `sd`, and an event `size` with probability p a sample."""
    m = samples // batches
    shape = (batches, *truth.shape)
    noise = rng.normal(scale=1 / math.sqrt(m), size=shape) if kind == "gauss" else rng.gamma(m, 1 / m, shape) - 1
    x = truth + sd * truth * noise + rng.poisson(p * m, (*shape[:3], 1)) * (size / m)
    mean, variance = x.mean(axis=0), x.var(axis=0, ddof=1) / batches
    if p == 0:
        mean = np.maximum(mean, 0)
    return Image(mean.astype(np.float32), variance.astype(np.float32), samples, None, batches)


def exact(truth=TRUTH):
    return Image(truth.astype(np.float32))


# ------------------------------------------------------------------------------------------------------ mathematics


@pytest.mark.parametrize("dof", [1, 3, 15, 30.5, math.inf])
@pytest.mark.parametrize("p", [0.5, 1e-3, 1e-6, 1e-10])
def test_student_s_tail_agrees_with_50_digits_where_it_matters(p, dof):
    z = float(S.quantile(p, dof))
    with mpmath.workdps(50):
        if math.isinf(dof):
            tail = mpmath.erfc(mpmath.mpf(z) / mpmath.sqrt(2))
        else:
            n, t = mpmath.mpf(dof), mpmath.mpf(z)
            tail = mpmath.betainc(n / 2, mpmath.mpf(1) / 2, 0, n / (n + t * t), regularized=True)
        assert float(tail) == pytest.approx(p, rel=1e-6)
    assert float(S.two_sided(z, dof)) == pytest.approx(p, rel=1e-6)


@given(st.floats(1e-6, 0.5), st.integers(1, 10**8))
def test_sidak_s_levels_multiply_back_to_the_rate(rate, tests):
    assert -math.expm1(tests * math.log1p(-S.sidak(rate, tests))) == pytest.approx(rate, rel=1e-9)


@pytest.mark.parametrize("batches", [(16, None), (None, 16)])
def test_degrees_of_freedom_are_the_batches_less_one_and_without_them_the_samples(batches):
    image = Image(TRUTH, TRUTH, batches[1] or 64, None, batches[0])
    assert degrees_of_freedom(image) == 15
    assert degrees_of_freedom(Image(TRUTH, TRUTH)) == math.inf


@given(st.integers(1, 41), st.integers(1, 41), st.integers(0, 2**32 - 1))
def test_blocks_and_neighbourhoods_are_those_of_a_plain_loop(h, w, seed):
    v = np.random.default_rng(seed).random((h, w, 3)).astype(np.float32)
    sums = np.concatenate([block_sums(v[a:b], rows) for a, b, rows in strips(h, 16)])
    for j in range(-(-h // SIDE)):
        for i in range(-(-w // SIDE)):
            block = v[j * SIDE : (j + 1) * SIDE, i * SIDE : (i + 1) * SIDE]
            assert np.allclose(sums[j, i], block.sum(axis=(0, 1)), rtol=1e-5)
    tiles = slide(sums)
    for j, i in ((0, 0), (tiles.shape[0] - 1, tiles.shape[1] - 1)):
        tile = v[SIDE * j : SIDE * (j + 2), SIDE * i : SIDE * (i + 2)]
        assert np.allclose(tiles[j, i], tile.sum(axis=(0, 1)), rtol=1e-5)
    largest = np.concatenate([dilate(v, a, b) for a, b, _ in strips(h, 16)])
    for y, x in ((0, 0), (h - 1, w - 1), (h // 2, w // 2)):
        around = v[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        assert np.array_equal(largest[y, x], around.max(axis=(0, 1)))


# ----------------------------------------------------------------------------------------------------- false alarms

NOISES = {
    "Gaussian against a reference": ({}, {"samples": 4096}),
    "Gaussian, both alike": ({"samples": 64}, {"samples": 64}),
    "Gaussian, four batches, against the truth": ({"batches": 4}, None),
    "exponential against a reference": ({"kind": "exp"}, {"kind": "exp", "samples": 4096}),
    "exponential against the truth": ({"kind": "exp", "sd": 1.0}, None),
    "exponential, four samples each": (
        {"kind": "exp", "samples": 4, "batches": 4},
        {"kind": "exp", "samples": 4, "batches": 4},
    ),
    "fireflies that the test hardly sees": ({"p": 3e-5, "size": 1e3}, {"p": 3e-5, "size": 1e3, "samples": 4096}),
    "fireflies that the test sees seldom": ({"p": 1e-4, "size": 1e2}, {"p": 1e-4, "size": 1e2, "samples": 4096}),
    "many fireflies in both": (
        {"p": 1e-3, "size": 30, "samples": 64},
        {"p": 1e-3, "size": 30, "samples": 64},
    ),
    "fireflies without other noise": (
        {"p": 1e-3, "size": 300, "sd": 0.0},
        {"p": 1e-3, "size": 300, "sd": 0.0, "samples": 4096},
    ),
}
RATE, TRIALS, MOST = 0.05, 100, 16
"""Sixteen alarms in a hundred have probability 1e-5 at the stated rate, and nearly 1 at four times it."""


def alarms(name, understated=1.0):
    rng = np.random.default_rng(sum(map(ord, name)))
    test, reference = NOISES[name]
    truth = TRUTH
    count = 0
    for _ in range(TRIALS):
        a = render(rng, truth, **test)
        b = exact(truth) if reference is None else render(rng, truth, **reference)
        a = Image(a.mean, a.variance / np.float32(understated), a.samples, None, a.batches)
        if b.variance is not None:
            b = Image(b.mean, b.variance / np.float32(understated), b.samples, None, b.batches)
        count += compare(a, b, false_alarm_rate=RATE).verdict == "fail"
    return count


@pytest.mark.parametrize("name", NOISES)
def test_noise_alone_fails_no_more_often_than_stated(name):
    assert alarms(name) <= MOST


def test_the_count_of_false_alarms_would_show_a_variance_that_is_too_small():
    assert alarms("Gaussian against a reference", understated=4.0) > MOST


def test_a_render_that_missed_every_rare_event_is_excused_by_a_reference_that_saw_them():
    rng = np.random.default_rng(19)
    rare = {"p": 1e-4, "size": 1e2, "sd": 0.0}
    missed = Image(TRUTH.astype(np.float32), np.full(TRUTH.shape, 1e-34, np.float32), 16, None, 16)
    assert compare(missed, render(rng, samples=4096, **rare)).verdict != "fail"


def test_pixels_without_noise_in_either_image_are_compared_exactly():
    rng = np.random.default_rng(7)
    a, b = render(rng), render(rng, samples=4096)
    for image in (a, b):
        image.mean[:, :20] = TRUTH[:, :20]
        image.variance[:, :20] = 0
    assert compare(a, b).passed
    a.mean[10, 5] += np.float32(1e-3)
    c = compare(a, b)
    assert not c.passed
    assert "(x=5, y=10)" in c.reasons[0]


def test_noise_below_the_tolerance_is_no_noise():
    rng = np.random.default_rng(8)
    a, b = (render(rng, sd=1e-6) for _ in range(2))
    assert compare(a, b).passed
    a.mean[10, 5] += np.float32(9e-5)
    assert compare(a, b).passed  # one pixel of few thousand beyond the tolerance, not beyond ten times it
    assert not compare(a, b, tolerance=Tolerance(p999_abs=1e-6)).passed


# ------------------------------------------------------------------------------------------------------------ power


def test_a_bias_of_one_per_cent_of_the_whole_image_fails_and_is_named():
    rng = np.random.default_rng(9)
    c = compare(render(rng, TRUTH * 1.01, samples=256), render(rng, samples=4096))
    assert not c.passed
    assert c.reasons[0].startswith("the whole image is ")
    assert "too bright" in c.reasons[0]
    assert c.statistics.z_mean > 4


def test_a_dark_image_has_a_negative_z():
    rng = np.random.default_rng(10)
    assert compare(render(rng, TRUTH * 0.95, samples=256), render(rng, samples=4096)).statistics.z_mean < -4


def test_a_tile_that_is_five_per_cent_off_fails_and_is_located():
    rng = np.random.default_rng(11)
    truth = TRUTH.copy()
    truth[16:32, 32:48] *= 1.05
    c = compare(render(rng, truth, samples=64), render(rng, samples=4096))
    assert not c.passed
    assert any("the 16 x 16 tile at (x=32, y=16) is" in r for r in c.reasons)


def test_one_wrong_pixel_fails_and_is_located():
    rng = np.random.default_rng(12)
    a = render(rng, samples=64)
    a.mean[30, 7] = 2.0
    c = compare(a, render(rng, samples=4096))
    assert not c.passed
    assert any("the pixel (x=7, y=30) is" in r for r in c.reasons)
    assert c.statistics.pixel_fail_fraction == pytest.approx(1 / (H * W))


def test_black_rows_fail_even_with_no_variance_of_their_own():
    rng = np.random.default_rng(13)
    a = render(rng)
    a.mean[20], a.variance[20] = 0, 0
    assert not compare(a, render(rng, samples=4096)).passed


def test_gamma_applied_twice_fails_with_its_name():
    rng = np.random.default_rng(14)
    c = compare(render(rng, TRUTH ** (1 / 2.2), samples=64), render(rng, samples=4096))
    assert not c.passed
    assert "gamma" in c.reasons[-1]


def test_one_firefly_does_not_hide_a_wrong_tile():
    rng = np.random.default_rng(15)
    truth = TRUTH.copy()
    truth[16:32, 32:48] *= 1.1
    a = render(rng, truth, samples=64)
    a.mean[3, 3] += 5
    a.variance[3, 3] = 25
    c = compare(a, render(rng, samples=4096))
    assert any("tile at (x=32, y=16)" in r for r in c.reasons)


def test_a_shift_of_a_tenth_of_a_pixel_fails_before_any_tile_tells():
    rng = np.random.default_rng(16)

    def disc(dx):
        y, x = np.mgrid[:96, :128]
        return (0.2 + 0.6 * np.clip(30.5 - np.hypot(x - 60 - dx, y - 45), 0, 1))[..., None] * np.ones(3)

    reference = render(rng, disc(0), samples=1024, sd=0.25)
    c = compare(render(rng, disc(0.1), sd=0.25), reference)
    assert len(c.reasons) == 1
    assert c.reasons[0].startswith("the test image is shifted by (+0.1")
    assert compare(render(rng, disc(0), sd=0.25), reference).passed


def test_a_pass_says_what_it_could_have_seen_and_more_samples_see_more():
    rng = np.random.default_rng(17)
    reference = render(rng, samples=4096)
    few, many = (compare(render(rng, samples=n), reference) for n in (16, 256))
    for c in (few, many):
        assert c.passed
        bias = c.statistics.minimum_detectable_bias
        assert f"{100 * bias:.2g} % of the whole image's mean" in c.reasons[0]
        assert "of 24 x 24 pixels anywhere" in c.reasons[0]
    ratio = few.statistics.minimum_detectable_bias / many.statistics.minimum_detectable_bias
    assert ratio == pytest.approx(4, rel=0.15)


def test_a_bias_of_the_minimum_detectable_size_is_found_nine_times_in_ten_and_a_third_of_it_seldom():
    rng = np.random.default_rng(18)
    reference = exact()
    bias = compare(render(rng), reference, false_alarm_rate=0.01).statistics.minimum_detectable_bias

    def found(size):
        return sum(
            not compare(render(rng, TRUTH * (1 + size)), reference, false_alarm_rate=0.01).passed for _ in range(50)
        )

    assert found(bias) >= 40
    assert found(bias / 3) <= 20
