"""Phong's highlight in the tracer: against its formula, its energy by quadrature, and on every engine."""

from math import pi

import numpy as np
import pytest
from engines import plain_paths
from scene_of import scene_of
from scipy import integrate
from truths import camera_above, glare

from raytwin import fast
from raytwin.fast import ENGINES
from raytwin.scene import Rectangle, Scene, Sky, Sun
from raytwin.scene.scene_files import read_scene
from raytwin.tracer.arrays import power

SUN = Sun((0.6, 0.0, 0.8), (2.0, 2.0, 2.0))


def sheet(material: tuple, *lights) -> Scene:
    return scene_of(
        "sheet", camera_above(1.0, 8, 400.0), (Rectangle((0, 0, 0), (9, 0, 0), (0, 9, 0), *material),), lights
    )


def f_of(material: tuple, v: np.ndarray, out: np.ndarray) -> float:
    """The formula on a surface that faces z, red."""
    mirrored = np.array((-v[0], -v[1], v[2])) @ out
    albedo, specular, exponent = material
    return albedo[0] / pi + specular[0] * (exponent + 2) / (2 * pi) * max(0.0, mirrored) ** exponent


def sent_back(material: tuple, v: np.ndarray) -> float:
    """∫ f cos dω over the hemisphere."""

    def at(phi: float, theta: float) -> float:
        out = np.array((np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)))
        return f_of(material, v, out) * np.sin(theta) * np.cos(theta)

    return float(integrate.dblquad(at, 0, pi / 2, 0, 2 * pi, epsabs=1e-7)[0])


@pytest.mark.parametrize("exponent", [9.0, 300.0, 5000.0])
def test_a_sharp_highlight_is_as_exact_as_a_dull_one_on_every_engine(engine, exponent):
    """A power of r·v in float32 is off by 5e-5 of the peak at 300 and by 4e-4 at 5000."""
    scene, expected = glare(exponent)
    most = 1e-12 if ENGINES[engine].bits == 64 else 5e-6
    np.testing.assert_allclose(fast.trace(scene, "lambert", engine).mean[..., 0] / expected.max(),
                               expected / expected.max(), rtol=0, atol=max(most, 6e-8))  # fmt: skip


def test_far_from_its_peak_a_highlight_is_nothing_on_every_engine(engine):
    """Where the power leaves the range of doubles, too: (r·v)⁹⁶ is 2⁻¹⁰²³ for r·v = 6e-4."""
    kind = ENGINES[engine].float_type or np.float64
    for exponent in (24.0, 96.0, 1e4):
        x = 2.0 ** (-np.linspace(1000, 1100, 1001) / exponent)
        found = np.array(power(kind(x), kind(exponent)), float)
        assert found.max() < 1e-300
        assert found.min() >= 0


def test_under_an_even_sky_a_sheet_shows_what_quadrature_says():
    """By random walks: 4.5 standard errors; seen straight from above the cheap rungs are correct, too."""
    material = (0.3, 0.2, 0.1), (0.4, 0.3, 0.2), 9.0
    scene = sheet(material, Sky((1.0, 1.0, 1.0)))
    image = fast.walk(scene, "sky", "numpy32", samples=256, seed=1)
    error = float(np.sqrt(image.variance[..., 0].sum(dtype=float))) / 64
    expected = sent_back(material, np.array((0.0, 0.0, 1.0)))
    assert expected == pytest.approx(0.7, abs=1e-6)
    assert error < 2e-3
    assert float(image.mean[..., 0].mean()) == pytest.approx(
        expected, abs=4.5 * error + 1e-4
    )  # the picture is 1 degree
    assert fast.trace(scene, "lambert").mean[..., 0] == pytest.approx(0.7, abs=1e-6)


def test_every_engine_follows_the_plain_tracers_paths_from_highlight_to_highlight(scenes, engine):
    scene = read_scene(scenes / "gloss")
    scene = scene.with_camera(scene.camera.resized(24, 18))
    found, plain = fast.walk(scene, "path", engine, samples=3, depth=4), plain_paths(scene, 4, 3)
    close = 1e-6 if ENGINES[engine].bits == 64 else 2e-4
    assert np.quantile(abs(found.mean - plain.mean), 0.99) < close * plain.mean.max()
