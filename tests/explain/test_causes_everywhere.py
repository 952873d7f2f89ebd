"""Causes that are tried before the catalogue: formulas of depth, rounding, and what changes values under noise."""

import numpy as np
import pytest
from test_true_causes import SCENES, with_sun

from raytwin import scene_folders
from raytwin.compare import Comparison
from raytwin.compare.finding import Finding, notes
from raytwin.explain.diagnosis import explain
from raytwin.explain.noisy_values import noisy_cause
from raytwin.explain.predict import NO_MISTAKE, written
from raytwin.explain.rounding_cause import rounding_cause
from raytwin.fast import trace
from raytwin.images.image import Image, Surface
from raytwin.scene.scene_files import read_scene
from raytwin.scene_folders import find_scene
from raytwin.show.terminal_text import because


def with_depth(image, factor):
    surface = image.surface
    depth = np.where(surface.ids >= 0, surface.depth * factor, surface.depth).astype(np.float32)
    return Image(image.mean, surface=Surface(surface.ids, depth, surface.normal))


DEPTHS = {
    "depth / reference = √(x² + y² + 1)": lambda stretch: stretch,
    "along the camera's axis": lambda stretch: 1 / stretch,
    "all depths are 1000 times": lambda stretch: np.full_like(stretch, 1000),
}


@pytest.mark.parametrize("words", DEPTHS)
def test_depths_that_are_off_by_a_formula_of_the_pixel_are_named(words):
    scene = SCENES["distorted"]
    right = trace(scene)
    v, u = np.indices((60, 80), float).reshape(2, -1)
    K, dist = np.array(scene.camera.K), np.array(scene.camera.coefficients)
    stretch = 1 / written(NO_MISTAKE)["through"](K, dist, u, v)[:, 2].reshape(60, 80)
    (found,) = explain(with_depth(right, DEPTHS[words](stretch)), right, scene)
    said = found.reason
    assert said.startswith("cause (likely): ")
    assert words in said
    noise = np.random.default_rng(1).uniform(0.9, 1.1, stretch.shape)
    assert not any(said.names_a_cause for said in explain(with_depth(right, noise), right, scene))


def test_the_textbook_solver_in_single_precision_is_told_as_rounding_and_another_sun_is_not():
    scene = read_scene(find_scene(scene_folders.SCENES / "single"))
    scene = scene.with_camera(scene.camera.resized(160, 120))
    (found,) = rounding_cause(trace(scene, "shadow", "numpy32", "textbook"), trace(scene), scene, "shadow")
    said = found.reason
    assert said.startswith("cause (likely): rounding: ")
    assert "textbook" in said
    assert "float32" in said
    sun = with_sun(scene, irradiance=tuple(1.0001 * x for x in scene.sun.irradiance))
    assert rounding_cause(trace(sun), trace(scene), scene, "shadow") == ()


RIGHT_IMAGE = trace(SCENES["overlap"]).mean.astype(float)[:56, :80]
SIGMA = 0.1 * RIGHT_IMAGE + 0.02
UNDER_NOISE = {
    "10 % too bright": (lambda x: 1.1 * x, "the whole image, background too, is 1."),
    "tint": (lambda x: x * (1.0, 0.9, 1.1), "the channels are off by the factors"),
    "mirrored": (lambda x: x[:, ::-1], "mirrored left to right"),
    "upside down": (lambda x: x[::-1], "upside down"),
    "bgr": (lambda x: x[..., ::-1], "red and blue are swapped"),
    "gamma": (lambda x: x ** (1 / 2.2), "encoded for display (gamma)"),
    "offset": (lambda x: x + 0.05, "is added to every value"),
}


def noisy(mean, seed):
    return mean + np.random.default_rng(seed).normal(0, 1, mean.shape) * SIGMA


@pytest.mark.parametrize("name", UNDER_NOISE)
def test_what_changes_values_or_order_is_named_under_noise(name):
    change, words = UNDER_NOISE[name]
    variance = SIGMA**2
    said = noisy_cause(noisy(change(RIGHT_IMAGE), 1), noisy(RIGHT_IMAGE, 2), variance, variance)
    assert words in said
    images = [Image(noisy(x, k), variance=variance) for k, x in ((1, change(RIGHT_IMAGE)), (2, RIGHT_IMAGE))]
    assert words in explain(*images)[0].reason


def test_nothing_is_named_of_images_that_differ_by_noise_alone_or_in_one_place():
    """40 seeds: the mean square of 210 blocks' errors lies within 8 standard deviations of 1 but once in 1e13."""
    variance = SIGMA**2
    assert not any(
        noisy_cause(noisy(RIGHT_IMAGE, k), noisy(RIGHT_IMAGE, k + 100), variance, variance) for k in range(40)
    )
    local = RIGHT_IMAGE.copy()
    local[8:24, 8:24] *= 1.5
    assert not any(noisy_cause(noisy(local, k), noisy(RIGHT_IMAGE, k + 100), variance, variance) for k in range(10))


def test_a_cause_stands_first_and_ends_the_first_line_and_what_is_unknown_stands_last():
    failed = Comparison("fail", notes(["5 % of values are off"]))
    named = failed.because(Finding("proved", "the sun is π times too bright"), *notes(["this explains 100 %"]))
    assert named.reasons == ("cause (proved): the sun is π times too bright", "this explains 100 %", *failed.reasons)
    assert named.cause == "the sun is π times too bright"
    assert because(named) == ": the sun is π times too bright"
    unknown = failed.because(Finding("unknown", "wrong everywhere"))
    assert unknown.reasons == (*failed.reasons, "cause unknown: wrong everywhere")
    assert (unknown.cause, because(unknown), because(failed.because())) == ("", "", "")
