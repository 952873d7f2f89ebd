"""The whole light in parts: how many pixels it takes, and the factors of a faulty one."""

import math
from math import pi

import numpy as np
import pytest
from scene_of import changed

from raytwin import fast as fast_package
from raytwin import twin
from raytwin.explain import light_parts
from raytwin.explain.light_decomposition import split
from raytwin.explain.light_parts import WholeLight, sampled_parts
from raytwin.explain.pixel_sample import SubmittedImage, sample_pixels
from raytwin.scene.scene_files import read_scene


@pytest.fixture(scope="module")
def fast() -> str:
    twin.activate()
    return "drjit32"


def small(scene, width=48, height=36):
    return scene.with_camera(scene.camera.resized(width, height))


# ------------------------------------------------------------------------------------------------ factors of the light


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"bounce 1": 0.5}, "the first bounce is too dark by a factor of 2."),
        ({"bounce 2": 0, "bounce 3+": 0}, "what all bounces but the first bring is missing"),
        ({"occlusion": 0.5}, "what hides the sky is 0."),
        ({"sun": pi}, "the sun's part is 3.1"),
        ({}, ""),
    ],
)
def test_of_light_that_chance_finds_the_fewest_factors_are_told(scenes, fast, factors, words):
    """64 samples a pixel; a part's factor may err by 4 of its standard errors, some per cent."""
    overlap = read_scene(scenes / "overlap")
    scene = small(overlap, 120, 90)
    dark = changed(scene, lights=(scene.sun,))
    parts = fast_package.light_parts(scene, fast, samples=64, seed=5)
    sun = fast_package.light_parts(dark, fast, samples=64, seed=5)
    shown = sum(np.float32(factors.get(name, 1)) * image.mean for name, image in parts.items())
    shown = shown + np.float32(factors.get("sun", 1) - 1) * (sun["open"].mean + sun["shadow"].mean)
    right = fast_package.walk(scene, "path", fast, samples=64, seed=7)
    half = 3 * np.sqrt(2 * right.variance)
    found = split(
        sample_pixels(
            SubmittedImage(
                scene, shown, right.mean, "path", half=half, sampled=sampled_parts(scene, "path", fast, "area")
            )
        )
    )
    assert found.words.startswith(words) if words else found.words == ""
    assert found.explained > 0.9 or not words
    told = {part: f for part, f in factors.items() if part != "bounce 3+"}
    assert len(found.shares) == len(told)
    for share in found.shares:
        assert share.factor == pytest.approx(next(iter(told.values())), abs=4 * share.error)
        assert share.error < 0.05


@pytest.mark.parametrize(("count", "most"), [(60, 1 << 16), (640, 1 << 13), (100_000, 1 << 12)])
def test_the_more_objects_a_scene_has_the_fewer_pixels_the_ledger_takes(single, monkeypatch, count, most):
    monkeypatch.setattr(light_parts, "light_parts", lambda *_, **__: {})
    crowd = changed(single, objects=(single.spheres[0],) * count)
    pixels = math.prod(WholeLight(crowd, "drjit32").shape[:2])
    assert most / 4 < pixels <= most
