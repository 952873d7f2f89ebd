"""Mean and variance from batches of unequal sizes, in NumPy and in Dr.Jit's kernel."""

import numpy as np

from raytwin.twin.batches import Batches

SHAPES = [(1, 5), (2, 3), (4, 4), (4, 7), (16, 17), (16, 47)]


def lanes_of(batches: Batches, pixels: int) -> tuple[np.ndarray, list[list[np.ndarray]]]:
    """Lanes (pixels · lanes, 3) at random, and each pixel's batches: the lanes that count, by batch."""
    lanes = np.random.default_rng(batches.samples).normal(3, 1, (pixels, batches.number, batches.each, 3))
    sizes = [batches.each - (k >= batches.more) for k in range(batches.number)]
    return lanes.reshape(-1, 3), [[lanes[p, k, :size] for k, size in enumerate(sizes)] for p in range(pixels)]


def assert_gathered(mean, spread, pixels) -> None:
    for p, parts in enumerate(pixels):
        whole = np.concatenate(parts).mean(axis=0)
        np.testing.assert_allclose(mean[p], whole, rtol=1e-6)
        expected = sum(len(part) * np.square(part.mean(axis=0) - whole) for part in parts)
        np.testing.assert_allclose(spread[p], expected, rtol=1e-4, atol=1e-12)


def test_mean_and_spread_are_those_of_the_batches_one_by_one_here_and_in_mitsubas_arrays(compiled):
    import mitsuba as mi

    from raytwin.twin.jit import _gathered

    for number, samples in SHAPES:
        batches = Batches(number, samples)
        lanes, pixels = lanes_of(batches, 5)
        sizes = [len(part) for part in pixels[0]]
        assert (sum(sizes), max(sizes), len(sizes) * max(sizes)) == (samples, batches.each, batches.lanes)
        assert max(sizes) - min(sizes) <= 1
        assert_gathered(*batches.gathered(lanes), pixels)
        assert_gathered(*_gathered(mi.Color3f(lanes.T.astype(np.float32)), batches), pixels)


def test_the_variance_is_unbiased_also_where_batches_differ_in_size():
    """20 000 pixels of 7 normal samples (variance 1) in 4 batches: the mean estimate is 1/7 within 4 standard errors.

    One estimate's standard deviation is 1/7 √(2/3), since 3 / (1/7) of it is chi squared with 3 degrees of freedom.
    """
    batches, n = Batches(4, 7), 20_000
    lanes = np.random.default_rng(1).normal(5, 1, (n * batches.lanes, 3))
    _, spread = batches.gathered(lanes)
    error = np.sqrt(2 / 3 / (3 * n)) / 7
    assert abs(batches.variance(spread).mean() - 1 / 7) < 4 * error
    assert Batches(1, 7).variance(spread) is None
