"""What is told of the noise, what is not believed, and what stays undecided."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measure.noise_models import FILTERS, exact, filtered, picture, render, untold
from measure.untold_patterns import PATTERNS, wrong

from raytwin.compare import compare
from raytwin.compare.noise import MIN_REFERENCE_SHARE, borne_out, correlation, residual
from raytwin.errors import InputError
from raytwin.images.image import Image

TRUTH = picture(48, 64)
Y, X = np.mgrid[: TRUTH.shape[0], : TRUTH.shape[1]]
REFERENCE = render(np.random.default_rng(1), TRUTH, samples=4096)


def said(comparison, words):
    return any(words in reason for reason in comparison.reasons)


# --------------------------------------------------------------------------------------------- claims of variance


def test_a_variance_that_is_claimed_hides_nothing_unless_it_is_four_times_the_noise():
    """A grey image that errs by as much as it claims is undecided: so would noise that all pixels share."""
    a = render(np.random.default_rng(2), TRUTH * 1.3)
    a.variance[10, 20] = 1e8
    c = compare(a, REFERENCE)
    assert c.verdict == "fail"
    assert c.reasons[0].startswith("the whole image is 30 % too bright")
    for claim, verdict in ((1e-3, "fail"), (1.0, "undecided"), (1e4, "fail"), (1e12, "fail")):
        for grey in (0.2, 2.0):
            wrong = Image(np.full(TRUTH.shape, grey, np.float32), np.full(TRUTH.shape, claim, np.float32), 16)
            assert compare(wrong, exact(TRUTH)).verdict == verdict, (claim, grey)
    rng = np.random.default_rng(3)
    for _ in range(10):
        a = render(rng, TRUTH)
        assert compare(replace(a, variance=4 * a.variance), REFERENCE).passed


@pytest.mark.foreign
def test_noise_of_the_reference_alone_believes_no_claim_and_none_takes_all_for_exact():
    a = render(np.random.default_rng(4), TRUTH, samples=1024)
    wrong = replace(a, mean=a.mean * np.float32(1.02), variance=a.variance * np.float32(3))
    assert compare(a, REFERENCE, noise="reference").passed
    assert compare(wrong, REFERENCE, noise="reference").verdict == "fail"
    exactly, right = TRUTH.astype(np.float32), Image(TRUTH.astype(np.float32))
    free = compare(Image(exactly, a.variance), REFERENCE, noise="reference")
    assert free == msgspec.structs.replace(compare(Image(exactly), REFERENCE), seconds=free.seconds)
    for claim in (a.variance, None):
        assert compare(replace(a, variance=claim), right, noise="none").verdict == "fail"
    rounded = Image((np.round(exactly * 256) / 256).astype(np.float32))
    assert compare(rounded, right, noise="none").verdict == "fail"
    half = np.full(TRUTH.shape, 1 / 512, np.float32)
    assert compare(rounded, right, noise="none", half_steps=(half, None)).passed
    with pytest.raises(InputError, match="both, reference or none"):
        compare(a, REFERENCE, noise="mine")


def test_what_is_too_noisy_to_see_a_tenth_of_the_mean_is_undecided():
    rng = np.random.default_rng(5)
    rare = {"p": 2e-4, "size": 1000.0, "proportional": True}
    a, truth = render(rng, TRUTH, **rare), exact(TRUTH, **rare)
    c = compare(a, truth)
    assert (c.verdict, c.exit_code) == ("undecided", 2)
    assert said(c, "take more samples")
    seen = c.statistics.minimum_detectable_bias
    assert seen > 0.1
    assert compare(a, truth, detectable_bias=seen * 1.01).verdict == "pass"
    assert compare(a, truth, detectable_bias=seen * 0.99).verdict == "undecided"


# ------------------------------------------------------------------------------------------- what nobody tells


@pytest.mark.parametrize("side", ["test", "reference"])
def test_a_variance_follows_from_the_others_samples(side):
    """3 % of two seeds of 64 samples are seen, and 10 correct pairs pass: as with both variances."""
    rng, seen = np.random.default_rng(7), []

    def judged(factor=1.0):
        a, b = render(rng, TRUTH * factor, samples=64), render(rng, TRUTH, samples=256)
        told = compare(a, b)
        seen.append(told.statistics.minimum_detectable_bias)
        return compare(untold(a, 64), b) if side == "test" else compare(a, untold(b, 256))

    for _ in range(10):
        found = judged()
        assert found.passed
        assert not said(found, "has no variance")
        assert found.statistics.minimum_detectable_bias == pytest.approx(seen[-1], rel=0.1)
    assert judged(1.03).verdict == "fail"


def test_the_faults_of_an_image_without_noise_are_not_taken_for_noise_that_nobody_tells():
    exact, acne = TRUTH.astype(np.float32), np.random.default_rng(10).random(TRUTH.shape[:2])[..., None]
    for name, faulty in {
        "a ten-thousandth too bright": exact * 1.0001,
        "a shadow missing": np.where(np.arange(48)[:, None, None] < 9, exact / 2, exact),
        "a tenth of a pixel off": 0.9 * exact + 0.1 * np.roll(exact, 1, axis=1),
        "sparse acne": np.where(acne < 0.002, 0.9 * exact, exact),
        "dense acne": np.where(acne < 0.3, 0.9 * exact, exact),
    }.items():
        told, silent = (compare(Image(faulty.astype(np.float32), samples=n), Image(exact)) for n in (1, 0))
        assert told.verdict == silent.verdict == "fail", name
        assert silent.reasons == told.reasons, name


def test_the_claim_holds_for_24_pixels_at_random_places():
    """An error of the claimed size in 24 x 24 pixels anywhere is seen in 9 of 10 pairs: 18 of 30 is 1 in 40 000."""
    rng, seen = np.random.default_rng(12), 0
    size = compare(render(rng, TRUTH, samples=64), REFERENCE).statistics.minimum_detectable_tile_bias
    for _ in range(30):
        y, x = int(rng.integers(48 - 24)), int(rng.integers(64 - 24))
        truth = TRUTH.copy()
        truth[y : y + 24, x : x + 24] *= 1 + size
        seen += compare(render(rng, truth, samples=64), REFERENCE).verdict == "fail"
    assert seen >= 19


# ------------------------------------------------------------------------------------------- patterns and scatter


REFERENCES = {"exact": exact(TRUTH), "a file": untold(exact(TRUTH)), "a render": REFERENCE}


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
