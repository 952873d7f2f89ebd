"""Negative radiance: noise may bring it, and nothing else may."""

import numpy as np
import pytest
from measure.noise_models import exact, picture, render, untold

from raytwin.compare import compare
from raytwin.images.image import Image

TRUTH = picture(48, 64)
REFERENCE = render(np.random.default_rng(1), TRUTH, samples=4096)


def gaussian(rng, sd, batches=16) -> Image:
    """Noise that goes below 0 as far as above."""
    made = TRUTH + rng.normal(0, sd * np.sqrt(batches), (batches, *TRUTH.shape))
    variance = (made.var(axis=0, ddof=1) / batches).astype(np.float32)
    return Image(made.mean(axis=0).astype(np.float32), variance, batches, None, batches)


def fails_as_negative(c) -> bool:
    return c.verdict == "fail" and any("negative value" in reason for reason in c.reasons)


@pytest.mark.parametrize("told", [True, False])
def test_negative_values_that_noise_bears_out_are_no_failure(told):
    """Of 20 very noisy renders, each with hundreds of negative values, none fails: all did."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        test, reference = gaussian(rng, 0.3), gaussian(rng, 0.3)
        assert (test.mean < 0).sum() > 100
        pair = (test, reference) if told else (untold(test), untold(reference))
        assert compare(*pair).verdict != "fail"


@pytest.mark.parametrize("reference", [REFERENCE, exact(TRUTH)], ids=["noisy", "exact"])
@pytest.mark.parametrize("samples", [16, 1, 0])
def test_a_negative_value_beyond_noise_stays_a_failure(reference, samples):
    test = render(np.random.default_rng(3), TRUTH, samples=4096)
    if samples < 2:
        test = Image(TRUTH.astype(np.float32), samples=samples)
    test.mean[10, 20] = -1
    assert fails_as_negative(compare(test, reference))


def test_where_the_test_has_no_noise_no_negative_value_is_excused():
    test = gaussian(np.random.default_rng(4), 0.3)
    assert fails_as_negative(compare(test, exact(TRUTH), noise="none"))
    assert fails_as_negative(compare(test, exact(TRUTH), noise="reference"))


def test_negative_values_of_an_image_that_states_no_noise_are_undecided_and_say_why():
    """The reference has them, too: nothing else fails."""
    truth = TRUTH.astype(np.float32)
    truth[10, 20] = -0.1
    c = compare(Image(truth.copy(), samples=0), Image(truth, samples=0))
    assert c.verdict == "undecided"
    assert "a filter with negative lobes" in c.reasons[0]
