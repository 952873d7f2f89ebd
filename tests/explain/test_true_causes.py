"""A cause that is named is true: its numbers are correct, it changes what is seen, and correct tracers have none."""

import itertools

import msgspec
import numpy as np
import pytest
from scene_of import changed, small

from raytwin.explain.changes import moved
from raytwin.explain.diagnosis import diagnose, explain
from raytwin.explain.evidence import is_likelier
from raytwin.explain.parametric_faults import FAMILIES, bright
from raytwin.explain.pixel_sample import PixelSample, SubmittedImage, sample_pixels
from raytwin.explain.predict import NO_MISTAKE, predictor
from raytwin.images.image import Image
from raytwin.scene import Sphere
from raytwin.tracer import trace

nightly = pytest.mark.nightly


SCENES = {name: small(name, (80, 60)) for name in ("eclipse", "overlap", "distorted")}


def with_sun(scene, **changes):
    sun = msgspec.structs.replace(scene.sun, **changes)
    return changed(scene, lights=tuple(sun if x is scene.sun else x for x in (scene.sun, scene.sky)))


def turned_sun(scene, degrees):
    to = np.array(scene.sun.to_light)
    aside = np.cross(to, (0.0, 0.0, 1.0))
    aside /= np.linalg.norm(aside)
    a = np.radians(degrees)
    return with_sun(scene, to_light=tuple((to * np.cos(a) + np.cross(aside, to) * np.sin(a)).tolist()))


def test_a_sun_that_is_turned_is_reported_with_the_angle_between_both_directions():
    scene = SCENES["distorted"]
    said = explain(trace(turned_sun(scene, 3)), trace(scene), scene)[0].reason
    assert "the sun's direction is off by 3 degrees" in said
    family = next(f for f in FAMILIES if f.name == "light-turned")
    suns = [with_sun(scene, to_light=to) for to in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))]
    assert family.sentence((np.radians(5), 0.0, 0.0), suns) == "the sun's direction is off by up to 5 degrees"


@nightly
def test_an_image_of_one_value_is_said_to_be_one_and_no_power_is_fitted():
    scene = SCENES["overlap"]
    right = trace(scene)
    for known, value in ((True, 1 / 255), (False, 1.0)):
        flat = Image(mean=np.full(right.mean.shape, value, np.float32))
        said = explain(flat, right, scene if known else None)[0].reason
        assert f"every pixel has the same value, {value:.4g}" in said
        assert "power" not in said


@nightly
def test_a_rounded_pi_is_said_in_percent_and_nothing_wrong_is_called_right():
    scene = SCENES["overlap"]
    sun = with_sun(scene, irradiance=tuple(x * np.pi / 3.14 for x in scene.sun.irradiance))
    said = explain(trace(sun), trace(scene), scene)[0].reason
    assert "the sun's part is 0.051 % too bright (π written as 3.14)" in said
    assert "right" not in [bright(1 + k) for k in (1e-6, 1e-4, 1e-3, -1e-3)]
    both = next(f for f in FAMILIES if f.name == "sun-and-sky-scaled")
    assert both.sentence((1.0, 2.0), ()) == "the sky's part is 2 times too bright"


@nightly
def test_where_a_few_scattered_values_are_off_nothing_is_named():
    for name, count in (("eclipse", 3), ("overlap", 12)):
        scene = SCENES[name]
        right = trace(scene)
        rng = np.random.default_rng(count)
        shown = right.mean.copy()
        shown.reshape(-1, 3)[rng.choice(80 * 60, count, replace=False)] += rng.normal(0, 0.05, (count, 3))
        for known in (scene, None):
            assert not any(said.names_a_cause for said in explain(Image(shown), right, known)), name


@nightly
def test_a_cause_under_noise_has_to_bring_the_noisy_pixels_nearer():
    """The rays three pixels aside, and as many to the other side; the noise is a third of the scale."""
    scene = SCENES["overlap"]
    left, right = (moved(x, 0) for x in (-3, 3))
    exact, made = (predictor(scene).picture(way).reshape(60, 80, 3) for way in (NO_MISTAKE, left))
    noise = np.random.default_rng(0).normal(0, 0.3, made.shape)
    samples = [sample_pixels(SubmittedImage(scene, made + noise, exact, half=np.full(made.shape, 0.9)))]
    assert is_likelier(samples, left)
    assert not is_likelier(samples, right)
    assert not is_likelier(samples, NO_MISTAKE)


@nightly
@pytest.mark.parametrize(("name", "known"), [("overlap", True), ("distorted", False)])
def test_rounding_that_exceeds_the_tolerance_a_little_has_no_cause(name, known):
    """Half of what is called an error here, and more, is less than four tolerances: to leave it explains nothing."""
    scene = SCENES[name]
    right = trace(scene)
    noise = np.random.default_rng(1).uniform(-8e-6, 8e-6, right.mean.shape) * right.mean.max()
    said = explain(Image((right.mean + noise).astype(np.float32)), right, scene if known else None)
    assert not any(finding.names_a_cause for finding in said)


@nightly
def test_a_fitted_number_is_proved_by_two_scenes_that_it_leaves_nothing_of_but_rounding():
    """Light with a factor of 1.7 in two scenes, in one, and but for half a thousandth of the scale."""
    v = np.arange(60)[:, None, None]
    scenes = [SCENES[name] for name in ("eclipse", "distorted")]
    suns = [trace(with_sun(s, irradiance=tuple(1.7 * x for x in s.sun.irradiance))).mean for s in scenes]
    exact = [SubmittedImage(scene, x) for scene, x in zip(scenes, suns, strict=True)]
    near = [SubmittedImage(s, x + 5e-4 * x.max() * np.sin(v / 9)) for s, x in zip(scenes, suns, strict=True)]
    found = [diagnose(views) for views in (exact, exact[:1], near)]
    assert [made.cause.name for made in found] == ["sun-scaled"] * 3
    assert [made.certainty for made in found] == ["proved", "likely", "likely"]


@nightly
def test_a_radius_that_is_a_little_off_is_not_taken_for_several_rays_a_pixel():
    for name in ("eclipse", "distorted"):
        scene = SCENES[name]
        first, *others = scene.objects
        assert isinstance(first, Sphere)
        larger = msgspec.structs.replace(first, radius=first.radius + 1e-3)
        made = trace(changed(scene, objects=(larger, *others)))
        assert "rays a pixel" not in "".join(f.text for f in explain(made, trace(scene), scene)), name


WAVES = 1 + 0.2 * (np.sin(np.arange(80) / 5) * np.cos(np.arange(60) / 3)[:, None])[..., None]
MOST_PREDICTIONS = 6000
"""Of a search, mostly of few pixels."""


@nightly
@pytest.mark.parametrize("factor", [WAVES, 1.3], ids=["waves", "brighter"])
def test_a_search_has_an_end(factor, monkeypatch):
    right = trace(SCENES["overlap"]).mean
    predictions, predict = itertools.count(), PixelSample.predict
    monkeypatch.setattr(PixelSample, "predict", lambda sample, steps: (next(predictions), predict(sample, steps))[1])
    diagnose([SubmittedImage(SCENES["overlap"], factor * right)])
    assert next(predictions) < MOST_PREDICTIONS
