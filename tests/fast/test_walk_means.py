"""What a walk's mean and variance are made of, sample by sample, on few pixels: by the plain tracer's own paths."""

import numpy as np
import pytest
from engines import pixel_draws, plain_paths, sample_indices
from scene_of import scene_of

from raytwin import fast
from raytwin.fast.sampling import BATCHES
from raytwin.scene import Camera, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.tracer import trace_paths

DOWN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
LIGHTS = (Sky((0.3, 0.2, 0.1)), Sun((0.3, 0.2, 1.0), (2.0, 1.0, 3.0)))


def seen_from_above(*things, width: int = 13, height: int = 11, dist=()) -> Scene:
    """A pixel is 2 cm of the plane z = 0, whose origin the middle one sees."""
    K = ((50.0, 0.0, (width - 1) / 2), (0.0, 50.0, (height - 1) / 2), (0.0, 0.0, 1.0))
    return scene_of("above", Camera((width, height), K, DOWN, (0.0, 0.0, 1.0), dist), things, LIGHTS)


RED, GREEN = (0.8, 0.2, 0.1), (0.1, 0.7, 0.3)
TWO = seen_from_above(
    Sphere((0.02, 0.01, 0.05), 0.05, RED), Rectangle((0.0, 0.0, 0.0), (0.09, 0, 0), (0, 0.07, 0), GREEN)
)


@pytest.mark.parametrize("samples", [1, 2, 3, 16, 19, 37])
def test_the_mean_is_that_of_all_samples_and_the_variance_that_of_the_batches_means(samples):
    """k samples in each of B batches, means m about M: Σ k (m - M)² / ((B - 1) N)."""
    found = fast.walk(TWO, "path", "numpy64", samples=samples, seed=4, depth=4)
    every = sample_indices(samples)
    draws = pixel_draws(TWO.camera.image_size, samples, seed=4)
    single = [trace_paths(TWO, [draw], 4).mean.astype(float) for draw in draws]
    mean = np.mean(single, axis=0)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-6)
    assert (found.samples, found.batches) == (samples, min(samples, BATCHES))
    if samples == 1:
        assert found.variance is None
        return
    batch = np.array([b for b, _ in every])
    parts = [np.array(single)[batch == b] for b in range(found.batches)]
    scatter = sum(len(part) * np.square(part.mean(axis=0) - mean) for part in parts)
    np.testing.assert_allclose(found.variance, scatter / ((found.batches - 1) * samples), rtol=1e-4, atol=1e-12)
    assert found.variance.max() > 1e-5


@pytest.mark.parametrize("dist", [(), (-0.3, 0.1)])
@pytest.mark.parametrize(
    ("x", "y"), [(-0.13, 0.0), (0.13, 0.0), (0.0, -0.11), (0.0, 0.11), (0.125, -0.108), (-0.2, 0.0)]
)
def test_no_part_of_a_pixels_area_loses_what_stands_at_the_frames_edge(x, y, dist):
    """Spheres that straddle an edge or lie beyond it, so that only a sample off the pixel's centre meets them."""
    for radius in (0.004, 0.011, 0.03):
        scene = seen_from_above(Sphere((x, y, 0.0), radius, RED), dist=dist)
        found, plain = fast.walk(scene, "path", "numpy64", samples=9, depth=2), plain_paths(scene, 2, 9)
        np.testing.assert_allclose(found.mean, plain.mean, rtol=1e-6)


def test_the_area_shrinks_to_the_centre_and_the_parts_are_those_of_the_same_samples():
    whole = fast.walk(TWO, "path", "numpy64", samples=5, depth=5)
    parts = fast.light_parts(TWO, "numpy64", samples=5, depth=5, bounces=2)
    assert list(parts) == ["open", "shadow", "occlusion", "bounce 1", "bounce 2+"]
    np.testing.assert_allclose(sum(p.mean.astype(float) for p in parts.values()), whole.mean, rtol=1e-5, atol=1e-7)
    assert all((p.samples, p.batches) == (5, 5) for p in parts.values())
    point = fast.light_parts(TWO, "numpy64", samples=3, side=0.0)
    exact = fast.trace(TWO, "shadow", "numpy64")
    np.testing.assert_allclose(point["open"].mean + point["shadow"].mean, exact.mean, rtol=1e-5, atol=1e-7)
    assert point["open"].variance.max() < 1e-12
    centre = fast.walk(TWO, "path", "numpy64", sampling="center", samples=5, depth=5)
    lost = exact.surface.ids < 0
    np.testing.assert_array_equal(centre.mean[lost], exact.mean[lost])
    np.testing.assert_array_equal(centre.surface.ids, exact.surface.ids)
    assert fast.walk(TWO, samples=1, surface=False).surface is None


def test_the_sky_at_the_centres_of_few_objects_has_a_closed_form_and_so_no_noise():
    found = fast.walk(TWO, "sky", "numpy64", sampling="center", samples=2, seed=3)
    assert found.variance.max() < 1e-12
    further = fast.walk(TWO, "path", "numpy64", sampling="center", samples=2, seed=3, depth=3)
    assert further.variance.max() > 1e-6
