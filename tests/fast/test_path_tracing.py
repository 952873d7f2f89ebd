"""Light that is followed: against the plain tracer, closed forms and the twin; the same on every engine.

A sampled mean may err by 4 of its standard errors, each of which 16 batches tell to a fifth: a correct tracer fails in
1 of 1000 tests of new seeds. The seeds here are fixed.
"""

import itertools
from math import sqrt

import msgspec
import numpy as np
import pytest
from engines import TRIED, to_numpy
from scene_of import changed, scene_of
from truths import (
    CLOSED,
    WHITE,
    Shown,
    agrees,
    grey,
    shown,
    view_of,
)

from raytwin import fast as fast_package
from raytwin.fast import ENGINES, frame
from raytwin.fast.engine import from_numpy
from raytwin.fast.sampling import sobol_pair
from raytwin.scene import Rectangle, Scene, Sky, Sphere, Sun

MANY = {"drjit32": 1 << 20, "numpy32": 1 << 13}


def mean_of(scene: Scene, engine: str, depth: int) -> Shown:
    samples = MANY[engine] // (scene.camera.width * scene.camera.height)
    return shown(fast_package.walk(scene, "path", engine, samples=samples, seed=3, depth=depth))


@pytest.fixture
def fast(packages) -> str:
    """One engine, the fastest here: that all follow the same paths is a test of its own."""
    return "drjit32" if "llvm" in packages else "numpy32"


def assert_agrees(found: Shown, expected: float, bias: float = 0.0) -> None:
    assert agrees(found, expected, bias), (found, expected)


def test_the_same_numbers_come_on_every_engine(engine):
    like, pixel = np.zeros(5000), np.arange(5000)
    lifted, how = from_numpy(ENGINES[engine], like), ENGINES[engine]
    places_, pixels = (from_numpy(how, a, whole=True) for a in (pixel % 7, pixel))
    expected = sobol_pair(like, pixel, 3, pixel % 7, 5, 2)
    for found, numbers in zip(sobol_pair(lifted, pixels, 3, places_, 5, 2), expected, strict=True):
        np.testing.assert_array_equal(to_numpy(found, (5000,)), numbers)


def test_what_is_counted_by_any_key_is_uniform_and_its_pairs_are_independent():
    """Chi-square of 8 x 8 cells: 63 +- 11.2; 4.5 of these fail one correct hash in 10 000."""
    n = 1 << 10
    for key in ("pixel", "batch", "seed", "bounce"):
        keys = {"pixel": 11, "batch": 2, "index": 0, "seed": 5, "bounce": 1}
        pairs = np.array([sobol_pair(np.zeros(1), **(keys | {key: k})) for k in range(n)]).reshape(-1, 2)
        cells = np.histogram2d(*pairs.T, bins=8, range=[[0, 1], [0, 1]])[0]
        assert ((cells - n / 64) ** 2 / (n / 64)).sum() == pytest.approx(63, abs=4.5 * sqrt(2 * 63)), key


def test_a_batchs_first_places_have_one_in_each_cell_of_their_area_whatever_its_shape():
    for bounce, k in itertools.product((0, 1, 7, 40), range(7)):
        a, b = sobol_pair(np.zeros(64), 7, 1, np.arange(64), 0, bounce)
        cells = np.histogram2d(a, b, bins=(1 << k, 64 >> k), range=[[0, 1], [0, 1]])[0]
        np.testing.assert_array_equal(cells, 1, err_msg=f"bounce {bounce}, {1 << k} columns")


def test_the_mean_of_a_smooth_integrand_errs_by_far_less_than_by_chance():
    """x y² over 256 places, by chance of variance 7/180/256 = 1.5e-4; and at 4096 places, where a lattice stalls."""
    for places_, most in ((256, 1e-7), (4096, 1e-10)):
        pixel, place = (a.ravel() for a in np.mgrid[:16, :places_])
        a, b = sobol_pair(np.zeros(place.shape), pixel, 0, place, 3, 1)
        assert np.square((a * b * b).reshape(16, -1).mean(axis=1) - 1 / 6).mean() < most


def test_tiles_of_any_size_give_the_same_image(overlap, engine, monkeypatch):
    side = (16, 40)[TRIED.index(engine) // 2 % 2]
    small = overlap.with_camera(overlap.camera.resized(60, 50))
    first = fast_package.walk(small, "path", engine, samples=2, depth=3)
    for name in ("TILE_NUMPY", "TILE_DRJIT"):
        monkeypatch.setattr(frame, name, side)
    again = fast_package.walk(small, "path", engine, samples=2, depth=3)
    np.testing.assert_array_equal(first.mean, again.mean)
    np.testing.assert_array_equal(first.variance, again.variance)


@pytest.mark.parametrize("name", CLOSED)
def test_the_light_is_what_the_closed_form_says(fast, name):
    row = CLOSED[name]
    assert_agrees(mean_of(row.scene, fast, row.depth), row.expected, row.bias)


@pytest.mark.parametrize("depth", [2, 1024])
def test_a_white_scene_in_a_white_sky_is_never_brighter_than_it_and_as_bright_in_the_end(fast, depth):
    things = (Sphere((0, 0, 1), 1.0, grey(1)), Sphere((1.5, 1, 0.5), 0.5, grey(1)), Rectangle(
        (0, 0, 0), (5, 0, 0), (0, 5, 0), grey(1)))  # fmt: skip
    scene = scene_of("furnace", view_of((0.8, 0.0, 0.0), (3.0, 0.2, 0.4), 1e-3), things, (Sky((0.7, 0.7, 0.7)),))
    found = mean_of(scene, fast, depth)
    assert found.mean < 0.7 + 4 * found.error + 1e-5
    if depth == 1024:  # after 62 bounces 1.5e-4 of the light is still on its way where ball and floor touch
        assert_agrees(found, 0.7, 1e-5)
    else:
        assert found.mean < 0.69


def test_inside_a_white_sphere_light_is_followed_from_wall_to_wall(fast):
    """The eye inside a closed ball of albedo a under a sun and sky outside: no light comes in."""
    scene = scene_of(
        "inside", view_of((0.9, 0, 0), (0, 0, 0), 0.2), (Sphere((0, 0, 0), 0.9, grey(0.9)),), (*WHITE, Sun((0, 0, 1)))
    )
    np.testing.assert_array_equal(fast_package.walk(scene, "path", fast, samples=16).mean, 0)
    shiny = msgspec.structs.replace(scene.objects[0], albedo=(0.5,) * 3, specular=(0.4,) * 3, exponent=100.0)
    within = changed(scene, objects=(shiny,))  # a way's rounding errors must not grow by each bounce
    np.testing.assert_array_equal(fast_package.walk(within, "path", fast, samples=16, depth=100).mean, 0)
