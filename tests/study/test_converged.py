"""The converged reference: errors far below its noise are measured; what it converges to is known in closed form."""

from math import inf

import numpy as np
import pytest
import truths

from raytwin import twin
from raytwin.compare import compare
from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene
from raytwin.study.converged import converged, unbiased_error

AMPLE = 1 << 30


@pytest.fixture(scope="module")
def corner() -> Scene:
    return truths.corner(32)


@pytest.mark.parametrize(("rung", "depth", "bounces"), [("sky", None, 0), ("path", 3, 1), ("path", None, inf)])
def test_it_converges_to_the_closed_form_to_within_its_floor(corner, rung, depth, bounces):
    found = converged(corner, rung, samples=1024, depth=depth)
    exact = np.full_like(found.image.mean, truths.in_wedge(90, 0.5, 0.5, bounces))
    assert found.image.samples == 1024
    # Depth 8 leaves out (a F)^7 of the light, and the planes end.
    assert found.error(exact).least < 3e-4
    assert found.floor() < 0.004
    assert found.error(exact + 0.02).value == pytest.approx(0.02, rel=0.1)


def test_a_formula_has_no_noise_and_its_floor_is_rounding(corner):
    found = converged(corner, "shadow", "center")
    assert (found.name, found.image.samples) == ("shadow-center", 1)
    assert 0 < found.floor() < 1e-7
    assert found.error(found.image.mean).value == 0
    assert found.error(found.image.mean + 0.25).value == pytest.approx(0.25)


@pytest.mark.nightly
def test_it_ends_at_the_floor_asked_for_or_when_the_time_is_up(corner):
    fine, coarse = converged(corner, samples=AMPLE, enough=0.01), converged(corner, samples=2)
    assert fine.floor() <= 0.01 < coarse.floor()
    ticks = iter(range(1000))
    assert converged(corner, samples=AMPLE, seconds=0.0, clock=lambda: float(next(ticks))).image.samples == 2
    assert converged(corner, samples=AMPLE, enough=0.01).image.mean.tobytes() == fine.image.mean.tobytes()


def test_a_metric_that_is_no_mean_of_squares_has_a_floor(corner):
    found = converged(corner, samples=64)
    assert 0 < found.floor("mae") < found.floor("p999_abs") <= found.floor("max_abs")


@pytest.mark.parametrize("metric", ["rmse", "relmse"])
def test_an_error_far_below_the_noise_of_a_pixel_is_measured_and_its_interval_holds(metric, rng):
    """200 references with ten times the error's noise: the mean is correct to 4 standard errors, and the interval of
    two, which a correlation of channels and heavy tails make wider, misses in fewer than 1 in 20 (by chance 1e-4)."""
    error, noise, shape = 0.01, 0.1, (48, 64, 3)
    whole = np.full(shape, 0.5, np.float32)
    exact = error if metric == "rmse" else error**2 / 0.26
    found = []
    for _ in range(200):
        one, other = (error + noise * rng.standard_normal(shape).astype(np.float32) for _ in range(2))
        found.append(unbiased_error(metric, one, other, whole))
    assert all(e.least <= e.value <= e.most for e in found)
    assert sum(not e.least <= exact <= e.most for e in found) < 10
    squares = np.array([e.value**2 if metric == "rmse" else e.value for e in found])
    assert (squares > 0).sum() > 100
    assert np.median(squares) == pytest.approx(
        exact**2 if metric == "rmse" else exact, abs=4 * 1.25 * squares.std() / 14
    )


@pytest.mark.nightly
def test_a_render_has_the_noise_of_its_own_samples(scenes):
    """Of real noise, whose scatter is known to some 5 % at this size: 20 % are four of it."""
    scene = read_scene(scenes / "overlap")
    scene = scene.with_camera(scene.camera.resized(160, 120))
    reference = twin.render(scene, "path", sampling="area", samples=1024, seed=99)
    for samples in (1, 16, 256):
        image = twin.render(scene, "path", sampling="area", samples=samples, seed=3)
        found = compare(image, reference).statistics.noise_of_samples
        assert found == pytest.approx(samples, rel=0.2), samples
