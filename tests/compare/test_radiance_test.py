"""What is told of the noise, what is not believed, and what stays undecided."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from measure.noise_models import exact, picture, render, untold

from raytwin.compare import compare
from raytwin.compare.noise import Residual
from raytwin.compare.untold import dense, unexplained
from raytwin.errors import InputError
from raytwin.images.image import Image

TRUTH = picture(48, 64)
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


def blocks(few: float, many: float, count: int) -> np.ndarray:
    """(5, 5, 3): `many` in the first `count` blocks, `few` in the others."""
    return np.where(np.arange(25) < count, float(many), few).reshape(5, 5, 1).repeat(3, axis=2)


def test_scatter_may_be_noise_where_it_is_dense_wherever_it_is():
    """Beyond what is known, 0.1, by half; in four of five blocks of 16 pixels or more."""
    for square, carrying, pixels, noise in (
        (blocks(1, 1, 0), blocks(16, 16, 0), 16, True),
        (blocks(1, 1, 0), blocks(15, 15, 0), 15, False),  # too few pixels to tell
        (blocks(0, 1, 10), blocks(0, 64 / 5.9, 10), 64, True),  # here and there: a sixth of the values must carry it
        (blocks(0, 1, 10), blocks(0, 64 / 6.1, 10), 64, False),
        (blocks(0, 1, 13), blocks(0, 64 / 23.9, 13), 64, True),  # over most of the picture: a twenty-fourth
        (blocks(0, 1, 13), blocks(0, 64 / 24.1, 13), 64, False),
        (blocks(1, 1, 0), blocks(0, 64, 20), 64, True),
        (blocks(1, 1, 0), blocks(0, 64, 19), 64, False),
        (blocks(0, 0.1504, 25), blocks(64, 64, 0), 64, True),
        (blocks(0, 0.1496, 25), blocks(64, 64, 0), 64, False),
    ):
        shown = Residual(square, carrying, np.full((5, 5, 3), float(pixels)))
        assert dense(shown, np.full((5, 5, 3), 0.1), least=0.01) == noise, (square, carrying)


def test_scatter_is_unexplained_where_most_blocks_have_a_fifth_more_than_is_known():
    for count, factor, beyond in ((13, 1.21, True), (13, 1.19, False), (12, 9.0, False)):
        shown = Residual(blocks(0.1, 0.1 * factor, count), blocks(64, 64, 0), np.full((5, 5, 3), 64.0))
        assert unexplained(shown, np.full((5, 5, 3), 0.1)) == beyond


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
    for name, wrong in {
        "a ten-thousandth too bright": exact * 1.0001,
        "a shadow missing": np.where(np.arange(48)[:, None, None] < 9, exact / 2, exact),
        "a tenth of a pixel off": 0.9 * exact + 0.1 * np.roll(exact, 1, axis=1),
        "sparse acne": np.where(acne < 0.002, 0.9 * exact, exact),
        "dense acne": np.where(acne < 0.3, 0.9 * exact, exact),
    }.items():
        told, silent = (compare(Image(wrong.astype(np.float32), samples=n), Image(exact)) for n in (1, 0))
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
