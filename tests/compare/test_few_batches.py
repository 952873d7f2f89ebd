"""An image of two or three batches against a well-known reference: its variance is hardly known; that must count."""

import numpy as np
import pytest

from raytwin.compare import compare
from raytwin.images.image import Image


@pytest.mark.parametrize("batches", [2, 3])
def test_few_batches_raise_no_false_alarm(batches):
    """40 correct images at a stated 1e-3: more than one failure has a probability of 0.1 %. Adding ν gave 9 of 150."""
    rng = np.random.default_rng(batches)
    shape = (60, 80, 3)
    truth = rng.uniform(0.1, 1, shape)
    failures = 0
    for _ in range(40):
        runs = truth * rng.exponential(1, (batches, *shape))
        variance = runs.var(axis=0, ddof=1) / batches
        test = Image(runs.mean(axis=0).astype(np.float32), variance.astype(np.float32), batches, batches=batches)
        mean = truth * rng.gamma(4096, 1 / 4096, shape)
        spread = rng.chisquare(63, shape) / 63 * truth**2 / 4096
        reference = Image(mean.astype(np.float32), spread.astype(np.float32), 4096, batches=64)
        failures += compare(test, reference).verdict == "fail"
    assert failures <= 1


def sampled(rng, truth, samples, batches):
    """A share of the sky per pixel: of so few samples most agree."""
    seen = rng.binomial(samples // batches, truth, (batches, *truth.shape)) / (samples // batches)
    variance = (seen.var(axis=0, ddof=1) / batches).astype(np.float32) if batches > 1 else None
    return Image(seen.mean(axis=0).astype(np.float32), variance, samples, None, batches)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_two_renders_of_few_samples_are_never_blamed_for_their_noise(samples):
    """30 correct pairs, of which all of 1 sample and some of 2 and 3 failed: none may, at 1e-3 with 3 %."""
    rng = np.random.default_rng(40 + samples)
    truth = np.clip(np.linspace(0.9, 1.05, 64)[None, :, None] * np.ones((48, 64, 3)), 0, 1)
    for _ in range(30):
        a, b = (sampled(rng, truth, samples, samples) for _ in range(2))
        assert compare(a, b).verdict != "fail"


def test_few_batches_hide_no_gross_fault():
    rng = np.random.default_rng(44)
    truth = np.full((48, 64, 3), 0.5)
    for samples in (2, 3):
        test, reference = sampled(rng, 0.6 * truth, samples, samples), sampled(rng, truth, 64, 16)
        assert compare(test, reference).verdict == "fail"


@pytest.mark.parametrize(("batches", "verdict"), [(2, "undecided"), (3, "undecided"), (4, "fail")])
def test_a_failure_by_few_batches_alone_is_undecided(batches, verdict):
    """Noise that its variance understates by far, but that neighbours show."""
    rng = np.random.default_rng(46)
    truth = np.full((48, 64, 3), 0.5)
    noisy = (truth + rng.normal(0, 0.1, truth.shape)).astype(np.float32)
    test = Image(noisy, np.full(truth.shape, 1e-8, np.float32), 0, None, batches)
    c = compare(test, sampled(rng, truth, 6400, 16))
    assert c.verdict == verdict
    assert (f"a variance from {batches} batches is hardly known" in c.reasons[0]) == (verdict == "undecided")
