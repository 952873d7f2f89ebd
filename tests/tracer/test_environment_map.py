"""A sky that is a map: its convention, the density of what is drawn from it, and its cheap model."""

from math import pi

import numpy as np
import pytest
from engines import to_numpy
from scene_of import changed, scene_of
from truths import camera_above

from raytwin import fast
from raytwin.fast import ENGINES
from raytwin.fast.engine import from_numpy, to_engine
from raytwin.scene import Environment, Rectangle, Scene
from raytwin.tracer.lights.environment_map import environment_map

TURNED = ((0.6, 0.8, 0.0), (-0.8, 0.6, 0.0), (0.0, 0.0, 1.0))
LEVEL = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def a_map(radiance: np.ndarray, axes=LEVEL) -> Environment:
    h, w, _ = radiance.shape
    return Environment((w, h), np.ascontiguousarray(radiance, "<f4").tobytes(), axes)


@pytest.fixture
def spotted(rng) -> Environment:
    """Bright spots on a dark ground, every channel another, turned by 53 degrees."""
    return a_map(4 * rng.random((8, 16, 3)) ** 6, TURNED)


def directions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Every direction (3, n) and its share of the sphere: Gauss's rule along z, even steps about it."""
    z, weights = np.polynomial.legendre.leggauss(count)
    turn = (np.arange(2 * count) + 0.5) * pi / count
    level = np.sqrt(1 - z * z)[:, None]
    d = np.stack([level * np.sin(turn), level * np.cos(turn), z[:, None] + 0 * turn])
    return d.reshape(3, -1), np.repeat(weights / (4 * count), 2 * count)


def about(n, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (3, k) over the hemisphere about the unit n, and their shares of its irradiance, whose sum is 1."""
    z, weights = np.polynomial.legendre.leggauss(count)
    z, turn = (z + 1) / 2, (np.arange(4 * count) + 0.5) * pi / (2 * count)
    side = np.cross(n, (0.0, 0.6, 0.8))
    side /= np.linalg.norm(side)
    level = np.sqrt(1 - z * z)[:, None, None]
    flat = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.cross(n, side)
    return (level * flat + z[:, None, None] * n).reshape(-1, 3).T, np.repeat(weights * z / (4 * count), 4 * count)


def test_the_middle_of_the_map_is_y_its_right_is_x_and_its_top_is_z():
    radiance = np.zeros((4, 8, 3))
    radiance[0], radiance[-1] = 7, 9
    radiance[1:3, :, 0] = np.arange(8)
    look = environment_map(a_map(radiance)).radiance
    s = np.sqrt(0.5)
    assert look((0.0, 0.0, 1.0)) == (7, 7, 7)
    assert look((0.0, 0.0, -1.0)) == (9, 9, 9)
    # Columns 3 and 4 lie beside the middle, 5 and 6 beside its right hand, 0 and 7 beside what is behind.
    for d, expected in (((0, 1, 0), 3.5), ((1, 0, 0), 5.5), ((-1, 0, 0), 1.5), ((0, -1, 0), 3.5), ((s, s, 0), 4.5)):
        assert look(tuple(map(float, d)))[0] == pytest.approx(expected, abs=1e-12)
    turned = environment_map(a_map(radiance, ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))).radiance
    assert turned((0.0, 1.0, 0.0))[0] == pytest.approx(5.5)  # to the right of the middle, which is at -x


def test_directions_are_drawn_alike_on_every_engine(spotted, engine, rng):
    how, numbers = ENGINES[engine], np.floor(rng.random((2, 500)) * 2**24) / 2**24
    expected = environment_map(spotted).sample(*numbers)
    d, p = to_engine(environment_map(spotted), how).sample(*(from_numpy(how, n) for n in numbers))
    close = 1e-12 if how.bits == 64 else 1e-5
    np.testing.assert_allclose([to_numpy(c, (500,)) for c in d], expected[0], rtol=0, atol=close)
    np.testing.assert_allclose(to_numpy(p, (500,)), expected[1], rtol=close)


def test_a_map_that_is_black_draws_evenly_and_an_empty_row_is_never_drawn(rng):
    assert environment_map(a_map(np.zeros((4, 8, 3)))).density((0.0, 0.6, 0.8)) == pytest.approx(1 / (4 * pi))
    radiance = np.zeros((8, 16, 3))
    radiance[5, 3] = 1
    (_, _, z), p = environment_map(a_map(radiance)).sample(*rng.random((2, 1000)))
    assert z.max() < np.cos(4 * pi / 8) + 1e-9
    assert z.min() > np.cos(7 * pi / 8) - 1e-9
    assert p.min() > 0


def test_harmonics_of_any_map_are_its_moments_by_quadrature(spotted):
    d, share = directions(128)
    x, y, z = np.array(TURNED) @ d
    basis = np.stack([1 + 0 * x, x, y, z, x * y, y * z, x * z, x * x - y * y, 3 * z * z - 1])
    transfer = np.array([1] + [2 / 3] * 3 + [1 / 4] * 5)
    light = np.stack(environment_map(spotted).radiance(tuple(d)))
    moments = (light * share) @ basis.T / ((basis**2 * share).sum(axis=1)) * transfer
    np.testing.assert_allclose(environment_map(spotted).harmonics, moments, rtol=0, atol=4e-5)


def test_the_cheap_model_is_never_negative_under_a_single_lamp():
    radiance = np.zeros((32, 64, 3))
    radiance[0] = 1000
    lamp = environment_map(a_map(radiance))
    assert lamp.diffuse_irradiance((0.6, 0.0, -0.8)) == (0, 0, 0)
    assert min(lamp.diffuse_irradiance((0.0, 0.6, 0.8))) > 0


# ---------------------------------------------------------------------------------------------- in a scene


def lit_by(scene: Scene, sky) -> Scene:
    return changed(scene, lights=(scene.sun, sky))


def test_the_light_of_a_map_on_an_open_sheet_is_its_irradiance_by_quadrature(spotted):
    """One sheet, no noise but the walks': 4.5 standard errors; and the same numbers in the plain tracer."""
    sheet = Rectangle((0.0, 0.0, 0.0), (9.0, 0.0, 0.0), (0.0, 9.0, 0.0), (0.5, 0.6, 0.7))
    scene = scene_of("sheet", camera_above(1.0, 8, 10.0), (sheet,), (spotted,))
    image = fast.walk(scene, "sky", "numpy64", samples=256)
    d, share = about(np.array((0.0, 0.0, 1.0)), 128)
    light = np.stack(environment_map(spotted).radiance(tuple(d))) @ share * (0.5, 0.6, 0.7)
    error = np.sqrt(image.variance.sum(axis=(0, 1))) / 64
    assert (abs(image.mean.mean(axis=(0, 1)) - light) < 4.5 * error).all()
    assert (error < 0.02 * light).all()


def test_the_background_is_the_map_in_every_way_to_trace(overlap, spotted, engine):
    scene = lit_by(overlap.with_camera(overlap.camera.resized(48, 36)), spotted)
    image = fast.trace(scene, "shadow", engine)
    behind = image.surface.ids < 0
    v, u = np.mgrid[:36, :48].astype(float)
    camera = scene.camera
    d = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1 + 0 * u], axis=-1) @ camera.R_cam_board
    expected = np.stack(environment_map(spotted).radiance(tuple(np.moveaxis(d, -1, 0))), axis=-1)
    assert behind.mean() > 0.2
    np.testing.assert_allclose(image.mean[behind], expected[behind], rtol=0, atol=1e-6)
    np.testing.assert_allclose(fast.walk(scene, "sky", engine, sampling="center", samples=1).mean[behind],
                               expected[behind], rtol=0, atol=2e-5)  # fmt: skip
