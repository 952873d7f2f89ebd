"""Scatter that no variance explains: a renderer's noise is told from patterns of wrong pixels, and excuses little."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from measure.noise_models import FILTERS, exact, filtered, picture, render, untold
from measure.untold_patterns import PATTERNS, wrong

from raytwin.compare import compare
from raytwin.compare.noise import correlation, residual
from raytwin.compare.untold import MIN_REFERENCE_SHARE, borne_out
from raytwin.images.image import Image

TRUTH = picture(48, 64)
NOISY = render(np.random.default_rng(1), TRUTH, samples=4096)
REFERENCES = {"exact": exact(TRUTH), "a file": untold(exact(TRUTH)), "a render": NOISY}
Y, X = np.mgrid[: TRUTH.shape[0], : TRUTH.shape[1]]


def said(comparison, words):
    return any(words in reason for reason in comparison.reasons)


def spoilt(factor) -> Image:
    """The truth times a factor a pixel, (H, W), from somebody who says nothing of noise."""
    return Image((TRUTH * np.asarray(factor)[..., None]).astype(np.float32), samples=0)


@settings(max_examples=60)
@given(
    name=st.sampled_from(sorted(PATTERNS)),
    amplitude=st.floats(0.05, 1),
    reference=st.sampled_from(sorted(REFERENCES)),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_pattern_above_a_twentieth_passes_for_noise_that_nobody_tells(name, amplitude, reference, seed):
    """The render's own noise is 0.5 %: ten times less than the smallest pattern."""
    test = wrong(np.random.default_rng(seed), TRUTH, PATTERNS[name], amplitude)
    assert compare(test, REFERENCES[reference]).verdict != "pass"


def test_undecided_says_what_to_give():
    rng = np.random.default_rng(2)
    c = compare(spoilt(np.where(rng.random(TRUTH.shape[:2]) < 0.5, 0.0, 2.0)), exact(TRUTH))
    assert c.verdict == "undecided"
    assert said(c, "the test has no variance, and the images differ from pixel to pixel by more than")
    assert all(said(c, way) for way in ("variance=", "--samples-a", "several renders"))
    few = [untold(render(rng, picture(24, 24), samples=2, batches=2, kind="exp", sd=1.0)) for _ in range(2)]
    c = compare(*few)
    assert c.verdict == "undecided"
    assert said(c, "the samples per pixel (--samples-a) or several renders")


def test_noise_that_nobody_tells_is_judged_by_the_scatter():
    """Of 10 correct pairs each all pass, at a stated 1e-3; 3 % too much light is seen, and a wrong tile named."""
    rng = np.random.default_rng(8)
    corner = TRUTH.copy()
    corner[16:32, 16:32] *= 1.2

    def judged(sides, truth):
        a, b = render(rng, truth, samples=64), render(rng, TRUTH, samples=64)
        return compare(*(untold(i) if sides in (side, "both") else i for side, i in (("test", a), ("reference", b))))

    for sides, who in (
        ("test", "the test has"),
        ("reference", "the reference has"),
        ("both", "the test and the reference have"),
    ):
        found = [judged(sides, TRUTH) for _ in range(10)]
        assert [c.verdict for c in found] == ["pass"] * 10, sides
        assert all(said(c, f"{who} no variance: noise was estimated") for c in found), sides
        assert judged(sides, TRUTH * 1.03).verdict == "fail", sides
        c = judged(sides, corner)
        assert c.verdict == "fail", sides
        assert said(c, "the whole image is 2") or said(c, "tile at (x=16, y=16)"), sides
        assert not said(c, "noise-free"), sides


def test_the_references_own_noise_is_read_off_its_covariance_with_the_difference():
    """Of the variance of the scatter: 1/2, 1/6, 1/41. Texture has none, nor has noise elsewhere."""
    assert 1 / 41 < MIN_REFERENCE_SHARE < 1 / 6
    rng = np.random.default_rng(5)
    test = render(rng, TRUTH, samples=64).mean
    texture = (TRUTH * rng.uniform(0.5, 1.5, TRUTH.shape)).astype(np.float32)
    half = render(rng, TRUTH, samples=64).mean
    half[:, :32] = TRUTH[:, :32]
    for what, a, b, known in (
        ("half", test, render(rng, TRUTH, samples=64).mean, True),
        ("a sixth", test, render(rng, TRUTH, samples=320).mean, True),
        ("a 41st", test, render(rng, TRUTH, samples=2560).mean, False),
        ("texture", (texture * rng.normal(1, 0.1, texture.shape)).astype(np.float32), texture, False),
        ("noise in one half", test, half, False),
    ):
        assert borne_out(a, b, residual(a, b), 1e-5) == known, what


# ------------------------------------------------------------------------------------------ errors that repeat


def patterned(a, b):
    return correlation(a, b, residual(a, b).square).patterned


def test_no_variance_excuses_errors_that_repeat_along_rows_or_columns():
    """Twice the light in half of the pixels, and none in the others, beside a variance that allows it."""
    for factor in (X % 2, Y % 2, (X + Y) % 2, (X + Y) // 2 % 2, (X - Y) // 2 % 2, X // 4 % 2, (X // 3 + Y // 3) % 2):
        test = spoilt(2.0 * factor).mean
        made = compare(Image(test, np.square(TRUTH).astype(np.float32), 16), exact(TRUTH), detectable_bias=10)
        assert made.verdict == "fail", factor[:3, :9]
    assert said(made, "the errors repeat from place to place")


def test_neither_independent_noise_nor_that_of_filters_nor_a_few_errors_repeat():
    rng = np.random.default_rng(10)
    for name in FILTERS:
        assert not patterned(*(filtered(rng, TRUTH, name, samples=4, batches=2).mean for _ in range(2))), name
    draws = (
        lambda size: rng.exponential(1, size),
        lambda size: 50.0 * (rng.random(size) < 0.02),
        lambda size: rng.lognormal(0, 1.5, size),
        lambda size: rng.normal(1, 0.01, size) + 75 * (rng.random(size) < 3 / 768),
    )
    for size in ((18, 18), (24, 32), (48, 64)):
        for draw in draws * 5:
            test = np.broadcast_to(draw((*size, 1)), (*size, 3)).astype(np.float32)
            assert not patterned(test, np.full((*size, 3), test.mean(), np.float32)), size


def test_unreported_noise_of_few_samples_is_undecided_and_what_it_does_not_explain_fails():
    """Events of three kinds of pixels in half of the picture, of which one sample sees few; the other half is exact."""
    rng = np.random.default_rng(11)
    chance = np.where(np.arange(64)[:, None, None] < 32, rng.choice([0.05, 0.3, 1.0], (64, 64, 1)), 0.0)

    def render(samples, gain=1.0):
        light = rng.gamma(np.maximum(4 * rng.binomial(samples, chance, (64, 64, 3)), 1e-9), 0.25)
        return (gain * (light / samples + 1)).astype(np.float32)

    batches = np.array([render(32) for _ in range(16)])
    reference = Image(batches.mean(axis=0), batches.var(axis=0, ddof=1) / 16, 512, batches=16)
    for samples in (1, 2, 4):
        found = compare(Image(render(samples)), reference)
        assert found.verdict == "undecided", (samples, found.reasons)
        assert "states no noise" in found.reasons[0], found.reasons
        assert compare(Image(render(samples, 1.1)), reference).verdict == "fail"
        patch = Image(render(samples))
        patch.mean[40:56, 8:24] *= 1.2  # where the reference has no noise
        assert compare(patch, reference).verdict == "fail"
