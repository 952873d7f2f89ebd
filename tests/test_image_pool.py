"""Renders of one picture pooled as they come, against all their batches at once."""

import numpy as np
import pytest

from raytwin.images.image import Image
from raytwin.images.image_pool import ImagePool

SHAPE = (6, 7, 3)


def pool_of(*images: Image) -> ImagePool:
    pool = ImagePool()
    for image in images:
        pool.add(image)
    return pool


def test_stints_of_equal_batches_have_the_mean_and_variance_of_all_batches():
    batches = np.random.default_rng(1).exponential(size=(5, 8, *SHAPE))
    pool = pool_of(*(Image(b.mean(0), b.var(0, ddof=1) / 8, 16, None, 8) for b in batches))
    every = batches.reshape(40, *SHAPE)
    np.testing.assert_allclose(pool.image.mean, every.mean(0), rtol=1e-6)
    np.testing.assert_allclose(pool.image.variance, every.var(0, ddof=1) / 40, rtol=1e-6)
    assert (pool.image.samples, pool.image.batches) == (80, 40)


def test_images_of_unequal_samples_weigh_by_them_and_their_variance_is_unbiased():
    """Σ n (m - M)² / ((k - 1) N) over k single images: 40 000 pixels of variance 1 a sample, so ± 0.7 % (one sigma)."""
    rng, counts = np.random.default_rng(2), (1, 4, 2, 16, 9)
    renders = [rng.normal(size=(200, 200, 1)) / np.sqrt(n) * np.ones(3) for n in counts]
    pool = pool_of(*(Image(x, samples=n) for x, n in zip(renders, counts, strict=True)))
    np.testing.assert_allclose(pool.image.mean, np.average(renders, axis=0, weights=counts), atol=1e-6)
    assert pool.image.variance.mean() == pytest.approx(1 / sum(counts), rel=0.035)
    assert (pool.image.samples, pool.image.batches) == (32, 5)


def test_equal_renders_are_free_of_noise_if_they_say_so_and_what_is_not_finite_stays():
    one = Image(np.ones(SHAPE), samples=1)
    assert not pool_of(one).noise_free
    assert pool_of(one).image.variance is None
    assert pool_of(one, one).noise_free
    assert not pool_of(one, one, Image(np.full(SHAPE, 1 + 1e-7), samples=0)).noise_free
    broken = Image(np.where(np.arange(126).reshape(SHAPE) == 50, np.nan, 1.0), samples=4)
    pool = pool_of(Image(np.ones(SHAPE), samples=0), broken)
    assert np.isnan(pool.image.mean).sum() == 1
    assert pool.image.samples == 0  # of one they are not known


def test_a_repeated_render_counts_once_where_renders_differ_in_many_values_and_each_time_where_in_few():
    rng = np.random.default_rng(3)
    a, b = (Image(rng.random(SHAPE), samples=0) for _ in range(2))
    assert pool_of(a, a).image.variance is None
    for pool in (pool_of(a, a, b, a), pool_of(a, b, b, b), pool_of(a, b, a, b)):
        assert (pool.images, len(pool.repeats)) == (2, 2)
        np.testing.assert_array_equal(pool.image.mean, pool_of(a, b).image.mean)
    few = Image(a.mean.copy(), samples=0)
    few.mean[0, 0] = 1
    for renders in ((a, a, few), (a, few, few), (few, a, a, a)):
        pool = pool_of(*renders)
        assert (pool.images, pool.repeats) == (len(renders), [])
        np.testing.assert_allclose(pool.image.mean, np.mean([r.mean for r in renders], axis=0), rtol=1e-6)


@pytest.mark.parametrize("own", [False, True])
def test_the_third_moment_of_the_mean_is_that_of_its_samples(own):
    """An exponential sample has the third moment 2, so the mean of 12 has 2 / 144; 4 standard errors of 20 000 pixels.

    As single batches, and as renders that bring the third moment of their own four.
    """
    rng, pool = np.random.default_rng(5), ImagePool()
    x = rng.standard_exponential((12, 100, 200, 1)) * np.ones(3)
    renders = [Image(one.astype(np.float32), samples=1, batches=1) for one in x]
    for part in [pool_of(*renders[k : k + 4]).image for k in (0, 4, 8)] if own else renders:
        pool.add(part)
    third = pool.image.third[..., 0] * 144
    assert abs(third.mean() - 2) < 4 * third.std() / np.sqrt(third.size)
    if not own:
        assert third == pytest.approx(12 * ((x - x.mean(0)) ** 3).sum(0)[..., 0] / 110, rel=1e-3, abs=1e-3)
    assert pool_of(*renders[:2]).image.third is None  # two batches tell none
