"""What float32 can and cannot tell: beside the tracer in float64, at outlines, far away, and over large grounds."""

from dataclasses import replace

import numpy as np
import pytest
from measure.random_scenes import KINDS, random_scene
from measure.twin_agreement import far
from scene_of import scene_of
from truths import camera_above, view_of

from raytwin import fast
from raytwin.images.image import Image
from raytwin.scene import Rectangle, Scene, Sky, Sphere, Sun
from raytwin.study.compare_scene import compare_with_twin
from raytwin.twin import render, settle

LIGHTS = Sun((0.4, 0.5, 0.8)), Sky((0.5, 0.7, 1.0))


def ground(thing: Sphere | Rectangle) -> Scene:
    """*Ray Tracing in One Weekend*'s last scene, the three large balls on this ground, under a sun."""
    balls = (Sphere((x, 0, 1), 1.0, (0.4, 0.2, 0.1)) for x in (0, -4, 4))
    return scene_of("weekend", view_of((0, 0, 0), (13, 3, 2), 5.0, 120), (thing, *balls), LIGHTS)


def large_ball(radius: float) -> Sphere:
    return Sphere((0, 0, -radius), radius, (0.5, 0.5, 0.5))


def sheet(half: float) -> Rectangle:
    return Rectangle((0.3, 0.2, 0), (half, 0, 0), (0, half, 0), (0.5, 0.5, 0.5))


def errors(scene: Scene) -> tuple[int, int, Image, Image]:
    """Pixels that see another object than in float64, and those whose light is off by 1e-4 of white; both images."""
    exact, found = fast.trace(scene, "shadow", "numpy64"), render(scene, "shadow", cache=False)
    off = (abs(found.mean - exact.mean) > 1e-4 * np.quantile(exact.mean, 0.99)).any(axis=-1)
    return int((found.surface.ids != exact.surface.ids).sum()), int(off.sum()), exact, found


@pytest.mark.parametrize("kind", KINDS)
def test_a_random_scene_is_float64s_but_for_a_pixel_at_a_shadows_edge(kind):
    ids, off, exact, found = errors(random_scene(kind, 0))
    assert ids == 0
    assert off <= 1
    depth, right = found.surface.depth, exact.surface.depth
    assert np.quantile(abs(depth - right) / np.maximum(right, 1e-9), 0.999) < 1e-5


@pytest.mark.parametrize(("label", "scene"), [row[:2] for row in far(1)])
def test_a_scene_at_any_distance_is_as_float64_sees_it_and_beside_a_near_ball_within_rounding(label, scene):
    """Rays begin where the scene does: from the eye, 2⁻²⁴ of 10 000 radii is 6e-4 of one. No origin serves near and
    far: there single pixels see another object, and the verdict says so."""
    ids, off, exact, found = errors(scene)
    if "near" not in label:
        assert (ids, off) == (0, 0)
        np.testing.assert_allclose(found.surface.depth, exact.surface.depth, rtol=2e-7)
    made = compare_with_twin(exact, found, scene)
    assert made.verdict == "pass", made.reasons
    assert any("single precision" in reason for reason in made.reasons) == ("near" in label)
    other = found.surface.ids != exact.surface.ids
    broken = replace(exact, mean=np.where(other[..., None], np.float32(np.nan), exact.mean))
    assert np.isnan(settle(broken, found, scene)[0].mean).any(axis=-1).sum() == ids  # no rounding makes these
    assert ids > 0 or label != "10000 radii, another near"


@pytest.mark.parametrize(
    ("thing", "most"),
    [(large_ball(100.0), 0), (large_ball(1e3), 0), (large_ball(1e4), 8), (large_ball(1e5), 40), (sheet(1e3), 3),
     (sheet(1e5), 3)],
)  # fmt: skip
def test_a_ground_of_any_size_does_not_shade_itself(thing, most):
    """Of 14400 pixels; with Mitsuba's own offsets 5 % of a ground of 10 km are falsely in shadow, of 100 km 46 %."""
    scene = ground(thing) if isinstance(thing, Sphere) else ground(thing).with_(spheres=[Sphere((0, 0, 1), 1.0)])
    ids, off, exact, found = errors(scene)
    assert ids == 0
    assert off <= most
    made = compare_with_twin(exact, found, scene)
    assert made.verdict == "pass", made.reasons
    assert ("object 0" in " ".join(made.reasons)) == isinstance(thing, Sphere)


def test_light_is_followed_from_far_spheres_as_from_near_ones():
    """As the tracer follows it: |z| of each channel's mean below 4.5, by chance in 1 of 24 000 runs."""
    scenes = {label: scene.with_camera(scene.camera.resized(24, 18)) for label, scene, _ in far(1)}
    for rung, label in (("sky", "300 radii"), ("path", "10000 radii")):
        ours = render(scenes[label], rung, samples=1024, seed=1, cache=False)
        theirs = fast.walk(scenes[label], rung, "numpy64", sampling="center", samples=64, seed=2)
        error = (ours.mean.astype(float) - theirs.mean).mean(axis=(0, 1))
        sigma = np.sqrt((ours.variance.astype(float) + theirs.variance).sum(axis=(0, 1))) / (24 * 18)
        assert abs(error / sigma).max() < 4.5


def test_only_what_is_extreme_is_said_to_be_in_single_precision():
    """A ball 1 m ahead, and a tiny one 2 m ahead beside it: 80 and 160 of its radii away."""
    for radius, said in ((1 / 40, False), (1 / 80, True)):
        balls = Sphere((0.0, 0.0, 0.0), 0.2), Sphere((0.3, 1.0, 0.0), radius, (0.6, 0.6, 0.6))
        scene = scene_of("both", view_of((0.15, 0.5, 0.0), (0.15, -1.0, 0.0), 0.6, 120), balls, LIGHTS)
        image = render(scene, "shadow", cache=False)
        tiny = image.surface.ids == 1
        wrong = replace(image, mean=image.mean * np.float32(1.002))  # more than rounding
        settled, sentences = settle(wrong, image, scene)
        assert [text.startswith("single precision") for text in sentences] == [True] * said
        firefly = image.mean.copy()
        ball = np.argwhere(image.surface.ids == 0)
        firefly[*ball[len(ball) // 2]] = 1.0  # elsewhere, of which no pixel of the tiny ball is said to be at an edge
        assert settle(replace(image, mean=firefly), image, scene)[1] == sentences
        assert (settled.mean[tiny] == wrong.mean[tiny]).all(axis=-1).mean() > 0.9
        if said:
            assert f"{tiny.sum()} pixels, compared within the rounding of object 1" in sentences[0]


def flipped(image: Image, places: list[tuple[int, int]], scene: Scene) -> Image:
    """The image with these pixels (row, column) of the floor lit where they are in shadow, and in shadow where lit."""
    mean, albedo = image.mean.copy(), np.asarray(scene.objects[1].albedo)
    dark = albedo * scene.sky.radiance
    lit = dark + albedo / np.pi * scene.sun.irradiance * scene.sun.to_light[2]
    for place in places:
        mean[place] = dark if mean[place][0] > dark[0] + 0.1 else lit
    return replace(image, mean=mean)


def test_a_shadow_and_an_object_are_forgiven_at_their_edge_alone():
    """The sun's ray from one pixel passes the ball's outline exactly; every other change is reported."""
    floor = Rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), (0.5, 0.5, 0.5))
    sun = Sun((0.6, 0.0, 0.8), (3.0, 3.0, 3.0))
    # At a floor point x, the distance of the centre (c, 0, h) from the sun's ray is |0.8 (c - x) - 0.6 h|.
    center, height = 0.45, 0.4
    edge = center - (0.6 * height + 0.1) / 0.8  # 0.025 m: five pixels right of the middle
    scene = scene_of(
        "edge", camera_above(1.0, 121, 200.0), (Sphere((center, 0.0, height), 0.1), floor), (sun, LIGHTS[1])
    )
    image = render(scene, "shadow", cache=False)
    column = 60 + round(200 * edge)
    assert 200 * edge == pytest.approx(column - 60, abs=1e-9)
    for places, left in (([(60, column)], 0), ([(60, column + 1)], 1), ([(60, column), (60, column - 1)], 1)):
        test = flipped(image, places, scene)
        assert (test.mean != image.mean).any(axis=-1).sum() == len(places)
        settled, said = settle(test, image, scene)
        assert (settled.mean != image.mean).any(axis=-1).sum() == left
        assert len(said) == len(places) - left
    for wrong in (np.nan, np.inf, -1.0, 50.0):  # no rounding makes these, nor a firefly
        mean = image.mean.copy()
        mean[60, column] = wrong
        settled, said = settle(replace(image, mean=mean), image, scene)
        np.testing.assert_array_equal(settled.mean, mean)
        assert not said
    ids = image.surface.ids.copy()
    ids[60, column] = -1
    settled, said = settle(replace(image, surface=replace(image.surface, ids=ids)), image, scene)
    assert settled.surface.ids[60, column] == -1
    assert not said
