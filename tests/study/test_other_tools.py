"""Other tools' tests against closed forms."""

import numpy as np
from measure.other_tools import (
    sees_z_test,
    tile_sums,
    tiles_of_renders,
    welch_p,
)
from scipy.stats import ttest_ind

from raytwin.images.image import Image

SHAPE = (24, 32, 3)


def renders(rng: np.random.Generator, n: int, mean: float = 1.0, sd: float = 0.3) -> list[Image]:
    return [Image(rng.normal(mean, sd, SHAPE).astype(np.float32), samples=1) for _ in range(n)]


def test_welchs_p_values_are_scipys():
    rng = np.random.default_rng(0)
    a, b = renders(rng, 7), renders(rng, 5, sd=0.9)
    expected = ttest_ind(tile_sums(a), tile_sums(b), equal_var=False).pvalue
    np.testing.assert_allclose(welch_p(tiles_of_renders(a), tiles_of_renders(b)), expected, rtol=1e-9)
    assert expected.shape == (12, 3)


def test_mitsubas_test_passes_what_it_is_known_to_pass():
    """Up to a quarter per cent of the pixels may be black; one more fails."""
    rng = np.random.default_rng(0)
    variance = np.full((64, 64, 3), 1e-4, np.float32)
    reference = Image(np.ones((64, 64, 3), np.float32), variance, samples=1000)
    mean = (1 + 1e-3 * rng.standard_normal((64, 64, 3))).astype(np.float32)
    mean.reshape(-1, 3)[:10] = 0
    assert not sees_z_test(Image(mean, variance, 1000), reference)
    mean.reshape(-1, 3)[:12] = 0
    assert sees_z_test(Image(mean, variance, 1000), reference)
