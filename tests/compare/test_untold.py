"""Scatter that no variance explains: a renderer's noise is told from patterns of wrong pixels, and excuses little."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measure.noise_models import FILTERS, exact, filtered, picture, render, untold
from scipy.ndimage import uniform_filter

from raytwin.compare import compare
from raytwin.compare.noise import residual
from raytwin.compare.patterns import patterned
from raytwin.compare.untold import LEVEL, borne_out
from raytwin.images.image import Image

TRUTH = picture(48, 64)
LEAST = 1e-5
NOISY = render(np.random.default_rng(1), TRUTH, samples=4096)


def said(comparison, words):
    return any(words in reason for reason in comparison.reasons)


def wrong(factor) -> Image:
    """The truth times a factor a pixel, (H, W) or (H, W, 3), from somebody who says nothing of noise."""
    factor = np.asarray(factor)
    return Image((TRUTH * (factor if factor.ndim == 3 else factor[..., None])).astype(np.float32), samples=0)


def halves(rng) -> np.ndarray:
    return np.where(rng.random(TRUTH.shape[:2]) < 0.5, 0.0, 2.0)


Y, X = np.mgrid[: TRUTH.shape[0], : TRUTH.shape[1]]
PATTERNS = {
    "every second column black, the others doubled": 2.0 * (X % 2),
    "every second row black, the others doubled": 2.0 * (Y % 2),
    "a checkerboard": 0.5 + (X + Y) % 2,
    "half of the pixels black, the others doubled": halves(np.random.default_rng(2)),
    "a third of the pixels times 0.5 to 1.5": 1 + np.where(X * 7 % 3 == Y % 3, 0.5 * np.sin(X * X + 3 * Y), 0.0),
}


@pytest.mark.parametrize("reference", [exact(TRUTH), untold(exact(TRUTH)), NOISY], ids=["exact", "a file", "a render"])
@pytest.mark.parametrize("name", PATTERNS)
def test_an_image_of_wrong_pixels_that_says_nothing_of_noise_never_passes(name, reference):
    assert compare(wrong(PATTERNS[name]), reference).verdict in ("fail", "undecided")


def test_undecided_says_what_to_give():
    c = compare(wrong(PATTERNS["half of the pixels black, the others doubled"]), exact(TRUTH))
    assert c.verdict == "undecided"
    assert said(c, "the test has no variance, and the images differ from pixel to pixel by more than")
    assert all(said(c, way) for way in ("variance=", "--samples-a", "several renders"))


DRAWS = {
    "two values": lambda rng, shape: np.where(rng.random(shape) < 0.5, -1.0, 1.0),
    "even": lambda rng, shape: rng.uniform(-1, 1, shape),
    "Gaussian": lambda rng, shape: rng.normal(size=shape),
    "a few": lambda rng, shape: np.where(rng.random(shape) < 0.3, 1.0, 0.0),
}


@settings(max_examples=40)
@given(
    amplitude=st.floats(0.05, 1),
    draw=st.sampled_from(sorted(DRAWS)),
    channels=st.sampled_from([1, 3]),
    side=st.integers(1, 4),
    reference=st.sampled_from(["exact", "a file", "a render"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_random_pattern_above_a_twentieth_passes(amplitude, draw, channels, side, reference, seed):
    """The render's own noise is 0.5 %: ten times less than the smallest pattern."""
    rng = np.random.default_rng(seed)
    h, w = TRUTH.shape[:2]
    values = DRAWS[draw](rng, (-(-h // side), -(-w // side), channels))
    factor = 1 + amplitude * np.repeat(np.repeat(values, side, axis=0), side, axis=1)[:h, :w]
    of = {"exact": exact(TRUTH), "a file": untold(exact(TRUTH)), "a render": NOISY}[reference]
    assert compare(wrong(np.maximum(factor, 0)), of).verdict != "pass"


def test_two_noisy_files_without_variance_alarm_never_and_their_faults_are_seen():
    """30 correct pairs at a stated 1e-3: one alarm has a probability of 3 %. Of 12 pairs 3 % apart all are seen."""
    rng = np.random.default_rng(3)

    def verdict(factor=1.0):
        a, b = (untold(render(rng, TRUTH * f, samples=64, kind="exp")) for f in (factor, 1.0))
        return compare(a, b).verdict

    assert [verdict() for _ in range(30)].count("pass") == 30
    assert [verdict(1.03) for _ in range(12)].count("fail") == 12


def test_the_tile_is_named_where_two_files_scatter_alike():
    """Not how many of the "noise-free" values are off: they have noise, which the reference shows too."""
    rng = np.random.default_rng(4)
    truth = TRUTH.copy()
    truth[16:32, 16:32] *= 1.2
    a, b = (untold(render(rng, t, samples=64)) for t in (truth, TRUTH))
    c = compare(a, b)
    assert c.verdict == "fail"
    assert said(c, "tile at (x=16, y=16)")
    assert not said(c, "noise-free")


@pytest.mark.parametrize(("samples", "known"), [(64, True), (320, True), (2560, False)])
def test_the_references_own_noise_is_read_off_its_covariance_with_the_difference(samples, known):
    """Shares of the scatter's variance: 1/2, 1/6, 1/41; LEVEL is 1/16."""
    assert 1 / 41 < LEVEL < 1 / 6
    rng = np.random.default_rng(5)
    test, reference = render(rng, TRUTH, samples=64), render(rng, TRUTH, samples=samples)
    shown = residual(test.mean, reference.mean, carrying=True)
    assert borne_out(test.mean, reference.mean, shown, LEAST) == known


def test_a_textured_reference_without_noise_bears_nothing_out():
    rng = np.random.default_rng(6)
    texture = (TRUTH * rng.uniform(0.5, 1.5, TRUTH.shape)).astype(np.float32)
    test = (texture * rng.normal(1, 0.1, texture.shape)).astype(np.float32)
    assert not borne_out(test, texture, residual(test, texture), LEAST)


def test_noise_in_a_part_of_the_reference_bears_out_none_elsewhere():
    rng = np.random.default_rng(7)
    test, reference = (render(rng, TRUTH, samples=64).mean for _ in range(2))
    reference[:, :32] = TRUTH[:, :32]
    assert not borne_out(test, reference, residual(test, reference), LEAST)


@pytest.mark.parametrize("name", list(FILTERS))
def test_no_filters_noise_repeats(name):
    rng = np.random.default_rng(9)
    small = picture(40, 56)
    a, b = (filtered(rng, small, name, samples=4, batches=2).mean for _ in range(2))
    assert not patterned(a, b, residual(a, b).square)


@pytest.mark.parametrize("factor", [X % 2, Y % 2, (X + Y) % 2, (X + Y) % 3, (X - Y) % 3, X % 7, Y // 4 % 2])
def test_patterns_along_rows_columns_and_diagonals_repeat(factor):
    test = wrong(1 + 0.1 * factor).mean
    base = TRUTH.astype(np.float32)
    assert patterned(test, base, residual(test, base).square)


TOLD = {
    "the error's square": lambda error: np.square(error),
    "its neighbourhood's": lambda error: uniform_filter(np.square(error), (5, 5, 1)),
    "four times as much": lambda error: 4 * uniform_filter(np.square(error), (8, 8, 1)),
    "the same everywhere": lambda error: np.full(error.shape, np.square(error).mean()),
}
PERIODIC = {
    "columns": lambda period: X % period < period / 2,
    "rows": lambda period: Y % period < period / 2,
    "rising diagonals": lambda period: (X + Y) % period < period / 2,
    "falling diagonals": lambda period: (X - Y) % period < period / 2,
    "checkers": lambda period: (X // period + Y // period) % 2 == 0,
    "dots": lambda period: (X % period < 1) & (Y % period < 1),
    "columns at random": lambda period: np.random.default_rng(period).random(X.shape[1])[X] < 0.5,
}


@settings(max_examples=60, deadline=None)
@given(
    amplitude=st.floats(0.02, 1),
    pattern=st.sampled_from(sorted(PERIODIC)),
    period=st.integers(2, 8),
    told=st.sampled_from(sorted(TOLD)),
    samples=st.sampled_from([0, 64]),
)
def test_no_variance_excuses_a_pattern(amplitude, pattern, period, told, samples):
    chosen = PERIODIC[pattern](period).astype(float)
    factor = 1 + amplitude * (chosen - chosen.mean()) / max(chosen.mean(), 1 - chosen.mean())
    test = wrong(factor).mean
    variance = TOLD[told](test - TRUTH).astype(np.float32)
    assert compare(Image(test, variance, samples), exact(TRUTH), detectable_bias=10).verdict != "pass"


def test_every_second_column_black_fails_whatever_variance_its_file_states():
    test = wrong(2.0 * (X % 2)).mean
    made = compare(Image(test, np.square(TRUTH).astype(np.float32), 16), exact(TRUTH), detectable_bias=10)
    assert made.verdict == "fail"
    assert said(made, "the errors repeat from place to place")


@pytest.mark.parametrize("size", [(8, 8), (16, 16), (24, 32), (48, 64)])
@pytest.mark.parametrize("channels", [1, 3])
def test_independent_noise_of_any_distribution_does_not_repeat(size, channels):
    """None of 320; of the correlations of Gaussian errors one in 10^8 is 6 standard deviations from 0."""
    rng = np.random.default_rng(10)
    draws = (
        lambda: rng.exponential(1, (*size, channels)),
        lambda: rng.normal(1, 0.3, (*size, channels)),
        lambda: 50.0 * (rng.random((*size, channels)) < 0.02),
        lambda: rng.lognormal(0, 1.5, (*size, channels)),
    )
    for draw in draws * 10:
        test = np.broadcast_to(draw(), (*size, 3)).astype(np.float32)
        reference = np.full((*size, 3), test.mean(), np.float32)
        assert not patterned(test, reference, residual(test, reference).square)


@pytest.mark.parametrize("shape", [(41, 57), (9, 16), (25, 33)])
def test_a_last_row_or_column_alone_is_compared_like_any(shape):
    rng = np.random.default_rng(12)
    a, b = (untold(render(rng, picture(*shape), samples=16)) for _ in range(2))
    assert compare(a, b).verdict in ("pass", "undecided")
