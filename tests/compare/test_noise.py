"""What the noise is: surveys, caps, inflation and what may have been missed, against plain loops and closed forms."""

import numpy as np
import pytest
from measure.noise_models import filtered

from raytwin.compare import noise
from raytwin.compare.blocks import SIDE, block_sums, slide, strips
from raytwin.images.image import Image


def flat(v, mean=0.5, samples=16, batches=16):
    return Image(np.full_like(v, mean), v, samples, None, batches)


def test_an_image_has_the_noise_of_as_many_samples_as_it_was_given():
    """The scatter's own error is 2 % at 48 x 64 pixels, so that 10 % is five of it."""
    rng = np.random.default_rng(4)
    truth = rng.uniform(0.1, 1, (48, 64, 1)).astype(np.float32)
    sigma = 0.5 * truth  # of one sample

    def equivalent_samples(test, reference):
        return noise.equivalent_samples(reference, noise.residual(test.mean, reference.mean))

    def image(n):
        mean = truth + sigma / np.sqrt(n) * rng.normal(size=(48, 64, 3))
        return Image(mean.astype(np.float32), np.broadcast_to(sigma**2 / n, (48, 64, 3)), samples=n)

    reference = image(1024)
    for n in (1, 16, 256):
        plain = Image(image(n).mean + np.float32(0.01))  # which tells nothing of its own, and is too bright
        assert equivalent_samples(plain, reference) == pytest.approx(n, rel=0.1)
    exact = Image(truth.repeat(3, 2))
    assert equivalent_samples(exact, reference) is None
    assert equivalent_samples(image(4), exact) is None


def test_strips_are_whole_blocks_high_and_lower_in_wide_images():
    for width, rows in ((1, 64), (1000, 64), (1001, 56), (4032, 8), (10**6, 8)):
        found = list(strips((203, width, 3)))
        assert found[0] == (0, rows, SIDE)
        assert found[-1] == (200, 203, 3)
        assert [a for a, _, _ in found[1:]] == [b for _, b, _ in found[:-1]]
        assert all((b - a) % n == 0 and b - a <= rows for a, b, n in found)


@pytest.mark.parametrize(("h", "w"), [(1, 1), (8, 8), (3, 17), (33, 9), (24, 40)])
def test_blocks_tiles_and_residuals_are_those_of_a_plain_loop(h, w):
    """Of residuals the unbiased variance of each block."""
    a, b = np.random.default_rng(h).random((2, h, w, 3)).astype(np.float32)
    tiles = slide(np.concatenate([block_sums(a[i:j], rows) for i, j, rows in strips(a.shape, 16)]))
    for j, i in ((0, 0), (tiles.shape[0] - 1, tiles.shape[1] - 1)):
        tile = a[SIDE * j : SIDE * (j + 2), SIDE * i : SIDE * (i + 2)]
        assert np.allclose(tiles[j, i], tile.sum(axis=(0, 1)), rtol=1e-5)
    shown = noise.residual(a, b)
    scatter = noise.estimated(a, b)
    for j in range(-(-h // SIDE)):
        for i in range(-(-w // SIDE)):
            rows, columns = slice(j * SIDE, (j + 1) * SIDE), slice(i * SIDE, (i + 1) * SIDE)
            d = (a[rows, columns].astype(float) - b[rows, columns]).reshape(-1, 3)
            assert np.array_equal(shown.pixels[j, i], [len(d)] * 3)
            if len(d) == 1:
                assert np.isinf(shown.square[j, i]).all()
                continue
            assert np.allclose(shown.square[j, i], d.var(axis=0, ddof=1), rtol=1e-4, atol=1e-9)
            e = np.square(d - d.mean(axis=0))
            assert np.allclose(shown.carrying[j, i], e.sum(axis=0) ** 2 / np.square(e).sum(axis=0), rtol=1e-3)
            assert np.allclose(scatter[rows, columns].mean(axis=(0, 1)), d.var(axis=0, ddof=1), rtol=1e-4, atol=1e-9)
            assert np.allclose(noise.block_means(a)[j, i], a[rows, columns].mean(axis=(0, 1)), rtol=1e-5)


# -------------------------------------------------------------------------------------------------- two variances


def test_the_ratio_of_variances_is_the_samples_but_no_less_than_the_median():
    """A render and one that is practically free of noise tell nothing of each other."""
    v = np.ones((32, 32, 3), np.float32)
    for samples, ratio in (((16, 64), 4.0), ((0, 64), 1.0), ((2, 4), 2.0), ((1, 64), 1.0), ((64, 16), 1.0)):
        a, b = (flat(v, samples=n) for n in samples)
        assert noise.variance_ratio(a, b) == ratio, samples
    assert noise.variance_ratio(a, Image(v, samples=64)) is None
    for ratio, kept in ((0.9e6, True), (1.1e6, False), (1.1e-6, True), (0.9e-6, False)):
        found = noise.variance_ratio(flat(v * np.float32(ratio), samples=0), flat(v, samples=0))
        assert found == (pytest.approx(ratio, rel=1e-5) if kept else None), ratio
    mine, theirs = np.array([1.0, 8.0, 0.0]), np.array([1.0, 1.0, 1.0])
    assert list(noise.larger_variance(mine, theirs, None)) == [2, 9, 1]
    assert list(noise.larger_variance(mine, theirs, 4.0)) == [5, 10, 5]


def test_a_claim_is_capped_at_four_times_what_its_neighbourhood_scatters():
    rng = np.random.default_rng(4)
    a, b = np.zeros((40, 40, 3), np.float32), rng.normal(0, 0.1, (40, 40, 3)).astype(np.float32)
    shown = noise.residual(a, b)
    v = np.full((40, 40, 3), 0.01, np.float32)
    assert noise.capped(v, shown) is v
    v[:16] = 100.0
    bounded = noise.capped(v, shown)
    assert np.array_equal(bounded[16:], v[16:])
    means = noise.block_means(bounded)
    assert means[0, 0] == pytest.approx(4 * shown.square[:2, :2].max(axis=(0, 1)), rel=1e-5)
    assert means[1, 2] == pytest.approx(4 * shown.square[:3, 1:4].max(axis=(0, 1)), rel=1e-5)
    assert v[0, 0, 0] == 100  # the input stays


# ---------------------------------------------------------------------------------------------------- correlation


def inflation_of(a, b):
    v = sum(noise.block_means(i.variance) for i in (a, b) if i.variance is not None)
    return noise.correlation(a.mean, b.mean, v.astype(np.float32)).inflation


def test_a_filters_inflation_is_its_own_whatever_the_brightness_the_frame_and_a_wrong_corner():
    """Four seeds. A uniform error of 2 σ changes nothing, nor does a corner whose error is ten times its noise.

    1 / Σ of the squared weights, per axis: a box's is 1, a tent's 3/2, a Gaussian's 2 sqrt(pi) of its deviation.
    """
    truth, inside = np.full((72, 96, 3), 0.5), np.zeros((72, 96, 1), np.float32)
    exact = Image(truth.astype(np.float32))
    inside[20:52, 24:72] = 1
    for name, expected in (("box", 1.0), ("tent", 1.5**2), ("Mitsuba's Gaussian", np.pi)):
        found: dict[str, list[float]] = {"as it is": [], "too bright": [], "framed": [], "a corner": []}
        for seed in range(4):
            a = filtered(np.random.default_rng(seed), truth, name, samples=8, batches=8)
            sd = np.float32(np.sqrt(a.variance.mean()))
            corner = a.mean.copy()
            corner[4:20, 4:20] += 10 * sd
            for what, image in {
                "as it is": a,
                "too bright": Image(a.mean + 2 * sd, a.variance),
                "framed": Image(0.5 + inside * (a.mean - np.float32(0.5)), inside * a.variance),
                "a corner": Image(corner, a.variance),
            }.items():
                found[what].append(inflation_of(image, exact))
        for what, inflations in found.items():
            assert np.mean(inflations) == pytest.approx(expected, rel=0.25), (name, what)


@pytest.mark.parametrize(("side", "told"), [(17, False), (18, True)])
def test_pictures_below_twice_the_farthest_lag_are_taken_for_independent(side, told):
    """Noise that 2 x 2 pixels share."""
    shared = np.random.default_rng(9).normal(0, 0.1, (9, 9, 3)).repeat(2, 0).repeat(2, 1)[:side, :side]
    a, b = (Image((0.5 + x).astype(np.float32), np.full(x.shape, 0.005, np.float32)) for x in (shared, 0 * shared))
    assert (inflation_of(a, b) > 1.5) == told
