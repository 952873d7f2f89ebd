"""Non-local means: less noise, and nothing else lost."""

import functools

import numpy as np
import pytest

from raytwin import twin
from raytwin.calib.denoise import denoise
from raytwin.files import read_scene
from raytwin.image import Image


@pytest.fixture(scope="module")
def rendered(scenes):
    """The scene at so many samples, path traced over the pixel's area."""
    scene = read_scene(scenes / "overlap").scene
    scene = scene.with_camera(scene.camera.resized(120, 90))

    @functools.cache
    def render(samples: int, seed: int = 0) -> Image:
        return twin.render(scene, "path", sampling="area", samples=samples, seed=seed, cache=False)

    return render


def rms(a: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(a))))


@pytest.mark.parametrize("samples", [1, 4, 16])
def test_a_render_of_few_samples_comes_closer_to_the_truth(rendered, samples):
    truth, noisy = rendered(1024, seed=9).mean, rendered(samples)
    assert (noisy.variance is None) == (samples == 1)
    assert rms(denoise(noisy) - truth) < 0.7 * rms(noisy.mean - truth)


def test_the_brightness_stays(rendered):
    noisy = rendered(16)
    assert denoise(noisy).mean() == pytest.approx(noisy.mean.mean(), rel=5e-3)


def test_an_image_without_noise_stays_what_it_is(rendered):
    flat = np.full((20, 30, 3), 0.3, np.float32)
    np.testing.assert_allclose(denoise(Image(flat)), flat, rtol=1e-4)
    np.testing.assert_array_equal(denoise(Image(np.zeros_like(flat))), 0 * flat)
    edge = np.zeros((40, 40, 3), np.float32)
    edge[:, 20:] = 0.8
    np.testing.assert_allclose(denoise(Image(edge, np.zeros_like(edge))), edge, atol=1e-4)


def test_radiance_above_one_survives():
    rng = np.random.default_rng(3)
    sun = np.full((48, 48, 3), 0.5, np.float32)
    sun[16:32, 16:32] = 40.0
    noisy = Image((sun * rng.normal(1, 0.02, sun.shape)).astype(np.float32), np.square(0.02 * sun))
    found = denoise(noisy)
    assert found.dtype == np.float32
    assert rms(found - sun) < 0.7 * rms(noisy.mean - sun)
    assert found[24, 24] == pytest.approx(40, rel=0.03)


def test_nan_and_infinity_are_neither_hidden_nor_spread():
    image = np.full((32, 32, 3), 0.4, np.float32)
    image[5, 7, 1], image[20, 3] = np.nan, np.inf
    found = denoise(Image(image))
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(image))
    np.testing.assert_allclose(found[np.isfinite(found)], 0.4, rtol=0.02)
