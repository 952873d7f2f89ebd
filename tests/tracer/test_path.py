"""The plain tracer's random walks: closed forms at every depth, colour by colour, to 4 of their standard errors.

All pixels of a picture see nearly the same place: their spread tells the error of their mean. The seeds are fixed.
"""

from itertools import pairwise
from math import cos, inf, pi, radians, sin

import msgspec
import numpy as np
import pytest
from engines import plain_paths
from scene_of import changed, scene_of
from truths import in_wedge, view_of, wedge

from raytwin import fast
from raytwin.scene import Scene, Sky, Sun
from raytwin.tracer import sample_cosine_hemisphere

SKY = (1.0, 0.5, 0.25)
EYE = (0.005 + 0.15 * cos(radians(35)), 0.04, 0.15 * sin(radians(35)))


def corner(sun: float = 0.0) -> Scene:
    """A wedge of 90 degrees, both albedos 1/2, seen near its edge; a sun along its middle."""
    lights = (Sky(SKY), Sun((cos(pi / 4), 0.0, sin(pi / 4)), (sun, 2 * sun, 0.0)))
    return scene_of("corner", view_of((0.005, 0, 0), EYE, 1e-5), wedge(90, 0.5, 0.5, 500.0), lights)


def assert_mean(pixels: np.ndarray, expected) -> None:
    mean, error = (
        pixels.mean(axis=(0, 1), dtype=float),
        pixels.std(axis=(0, 1), dtype=float) / pixels[..., 0].size ** 0.5,
    )
    assert (np.abs(mean - expected) < 4 * error + 1e-5).all(), (mean, error, expected)


@pytest.mark.parametrize("bounces", [0, 1, 2, 6])
@pytest.mark.parametrize("sun", [0.0, 1.0])
def test_the_plain_walk_finds_what_a_wedge_sends_back_at_every_depth(bounces, sun):
    found = plain_paths(corner(sun), bounces + 2, samples=16, seed=5)
    at_rest = [sun * k * cos(pi / 4) / pi / sky for k, sky in zip((1, 2, 0), SKY, strict=True)]
    expected = [sky * in_wedge(90, 0.5, 0.5, bounces, (s, s)) for sky, s in zip(SKY, at_rest, strict=True)]
    assert_mean(found.mean, expected)
    assert found.samples == 16


def test_each_bounce_adds_its_term_and_the_last_all_that_follow():
    parts = fast.light_parts(corner(), "numpy64", samples=16, seed=5, depth=9)
    terms = [in_wedge(90, 0.5, 0.5, n) for n in (0, 1, 2, 7)]
    assert_mean(parts["occlusion"].mean, [sky * (terms[0] - 0.5) for sky in SKY])
    for name, (before, after) in zip(("bounce 1", "bounce 2", "bounce 3+"), pairwise(terms), strict=True):
        assert_mean(parts[name].mean, [sky * (after - before) for sky in SKY])


def test_each_surface_takes_its_own_colour_of_the_light():
    """Red floor, green wall: no light of a channel that either takes whole comes by way of both."""
    scene = corner()
    floor, wall = (
        msgspec.structs.replace(sheet, albedo=albedo)
        for sheet, albedo in zip(scene.objects, ((0.8, 0.4, 0.0), (0.0, 0.4, 0.8)), strict=True)
    )
    found = plain_paths(changed(scene, objects=(floor, wall)), 12, samples=16, seed=5)
    in_red, in_blue = 0.8 * 0.5, 0.0
    assert_mean(found.mean, [SKY[0] * in_red, SKY[1] * in_wedge(90, 0.4, 0.4, inf), SKY[2] * in_blue])


def test_directions_about_a_normal_are_those_about_the_z_axis_turned():
    """(√a cos 2πb, √a sin 2πb, √(1 - a)): n·ω is the last, lengths, angles and handedness stay."""
    a, b = np.random.default_rng(2).uniform(size=(2, 50))
    upright = np.stack(sample_cosine_hemisphere((0.0, 0.0, 1.0), a, b))
    np.testing.assert_allclose(
        upright, [np.sqrt(a) * np.cos(2 * pi * b), np.sqrt(a) * np.sin(2 * pi * b), np.sqrt(1 - a)], atol=1e-15
    )
    for n in np.vstack([np.eye(3), -np.eye(3), np.random.default_rng(1).normal(size=(9, 3))]):
        n /= np.linalg.norm(n)
        turned = np.stack(sample_cosine_hemisphere(tuple(n), a, b))
        np.testing.assert_allclose(n @ turned, np.sqrt(1 - a), atol=1e-12)
        np.testing.assert_allclose(turned.T @ turned, upright.T @ upright, atol=1e-12)
        assert np.linalg.det(turned[:, :3]) == pytest.approx(np.linalg.det(upright[:, :3]), abs=1e-12)
