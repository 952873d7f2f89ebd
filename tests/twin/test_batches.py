"""Mean, variance and third moment from the means of equal batches."""

import numpy as np

from raytwin import twin


def test_mean_variance_and_third_moment_are_those_of_all_samples():
    """60 000 pixels of 16 exponential samples in 8 batches: their mean's variance is 1/16, its third moment 2/256.

    Each within 4 standard errors over the pixels.
    """
    twin.activate()
    from drjit.llvm import Float64

    from raytwin.twin.twin_light import moments

    samples = np.random.default_rng(1).standard_exponential((60_000, 8, 2))
    means = Float64(samples.mean(axis=2).ravel())
    mean, variance, third = (part.numpy() for part in moments(means, 8))
    np.testing.assert_allclose(mean, samples.mean(axis=(1, 2)), rtol=1e-12)
    for found, expected in ((variance, 1 / 16), (third, 2 / 256)):
        assert abs(found.mean() - expected) < 4 * found.std() / 60_000**0.5
    assert not any(np.any(part.numpy()) for part in moments(means, 1)[1:])
