"""Mean, variance and third moment from batches of unequal sizes."""

import numpy as np

from raytwin import twin
from raytwin.twin.rendering import pooled


def of_dr_jit(parts, kinds):
    """`pooled` of NumPy's arrays (pixels, batches)."""
    twin.activate()
    from drjit.llvm import Float64

    return (x.numpy() for x in pooled([Float64(part.ravel()) for part in parts], kinds))


def test_mean_variance_and_third_moment_are_those_of_the_batches_one_by_one():
    for number, samples in ((2, 3), (4, 4), (4, 7), (16, 17), (16, 47)):
        rng, (each, more) = np.random.default_rng(samples), divmod(samples, number)
        batches = [rng.normal(3, 1, (5, each + (k < more))) for k in range(number)]
        sizes = sorted({b.shape[1] for b in batches})
        parts = [np.stack([b.mean(axis=1) for b in batches if b.shape[1] == size], axis=1) for size in sizes]
        mean, variance, third = of_dr_jit(parts, [(k, part.shape[1]) for k, part in zip(sizes, parts, strict=True)])
        whole = np.concatenate(batches, axis=1).mean(axis=1)
        spread = sum(b.shape[1] * np.square(b.mean(axis=1) - whole) for b in batches)
        np.testing.assert_allclose(mean, whole, rtol=1e-12)
        np.testing.assert_allclose(variance, spread / ((number - 1) * samples), rtol=1e-9)
        if number > 2:
            cubes = sum(b.shape[1] ** 2 * (b.mean(axis=1) - whole) ** 3 for b in batches)
            expected = number * cubes / ((number - 1) * (number - 2) * samples**2)
            np.testing.assert_allclose(third, expected, rtol=1e-7, atol=1e-16)


def test_the_variance_is_unbiased_also_where_batches_differ_in_size():
    """60 000 pixels of 7 normal samples (variance 1) in 4 batches: the mean estimate is 1/7 within 4 standard errors.

    One estimate's standard deviation is 1/7 √(2/3), since 3 / (1/7) of it is chi squared with 3 degrees of freedom.
    """
    n, rng = 60_000, np.random.default_rng(1)
    parts = [rng.normal(5, 1, (n, number, size)).mean(axis=2) for number, size in ((3, 2), (1, 1))]
    _, variance, _ = of_dr_jit(parts, [(2, 3), (1, 1)])
    assert abs(variance.mean() - 1 / 7) < 4 * np.sqrt(2 / 3 / n) / 7
