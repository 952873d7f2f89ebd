"""Every kind of sky keeps one contract: its density integrates to 1, its samples have it, and give its irradiance."""

from math import pi

import numpy as np
import pytest

from raytwin.scene import Environment, Sky
from raytwin.tracer.lights import SKIES

# A map of L = 1 + z/2: harmonics of the first order alone, which its cheap irradiance has in full.
ROWS = 1 + np.cos((np.arange(64) + 0.5) / 64 * pi) / 2
SLOPE = Environment((8, 64), np.repeat(ROWS, 8 * 3).astype("<f4").tobytes())
SCENES = {Sky: Sky((0.5, 0.25, 1.0)), Environment: SLOPE}


def test_there_is_a_row_for_every_sky():
    assert set(SKIES) == set(SCENES)


@pytest.mark.parametrize("kind", SKIES)
def test_samples_have_the_density_they_say_and_it_integrates_to_one(kind, rng):
    light = SKIES[kind](SCENES[kind])
    d, p = light.sample(*rng.random((2, 4000)))
    np.testing.assert_allclose(sum(c * c for c in d), 1, atol=1e-12)
    np.testing.assert_allclose(np.broadcast_to(light.density(d), 4000), p, rtol=1e-9)
    z, turn = (np.arange(2000) + 0.5) / 1000 - 1, 2 * pi * (np.arange(64) + 0.5) / 64
    level = np.sqrt(1 - z * z)
    even = [np.outer(level, np.cos(turn)).ravel(), np.outer(level, np.sin(turn)).ravel(), np.repeat(z, 64)]
    assert np.mean(light.density(tuple(even))) * 4 * pi == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize(("kind", "normal"), [(Sky, (0.48, 0.64, 0.6)), (Environment, (0.6, 0.0, -0.8))])
def test_the_irradiance_is_the_mean_over_the_samples(kind, normal, rng):
    """E/π = mean of L max(0, n·ω) / (π p), to 5 standard errors: one correct light in two million fails a channel."""
    light = SKIES[kind](SCENES[kind])
    d, p = light.sample(*rng.random((2, 200_000)))
    cosine = np.maximum(sum(n * c for n, c in zip(normal, d, strict=True)), 0)
    for c, expected in enumerate(light.diffuse_irradiance(normal)):
        values = np.broadcast_to(light.radiance(d)[c], cosine.shape) * cosine / p / pi
        assert values.mean() == pytest.approx(float(expected), abs=5 * values.std() / 200_000**0.5 + 2e-4)
