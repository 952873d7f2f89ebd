"""What float32 can and cannot tell: beside the tracer in float64, at outlines, far away, and over large grounds."""

from dataclasses import replace

import numpy as np
import pytest
from measure.twin_agreement import far
from scene_of import scene_of

from raytwin import fast
from raytwin.compare import compare
from raytwin.images.image import Image
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.twin import render, settle

pytestmark = pytest.mark.usefixtures("compiled")
LIGHTS = (Sun((0.4, 0.5, 0.8)), Sky((0.5, 0.7, 1.0)))


def looking_at(point, eye, size=(160, 120), degrees=20.0, dist=()) -> Camera:
    """A camera at `eye` whose vertical field of view is `degrees`, world Z up in the picture."""
    z = np.subtract(point, eye) / np.linalg.norm(np.subtract(point, eye))
    x = np.cross(z, (0, 0, 1)) / np.linalg.norm(np.cross(z, (0, 0, 1)))
    R = np.stack([x, np.cross(z, x), z])
    f = size[1] / 2 / np.tan(np.radians(degrees / 2))
    K = ((f, 0.0, (size[0] - 1) / 2), (0.0, f, (size[1] - 1) / 2), (0.0, 0.0, 1.0))
    return Camera(size, K, tuple(map(tuple, R.tolist())), tuple((-R @ np.asarray(eye)).tolist()), dist)


def random_scene(k: int, size=(160, 120)) -> Scene:
    """Spheres and sheets on and above a table, as the shipped scenes have them; every third through a lens."""
    rng = np.random.default_rng(1000 + k)
    eye = (*rng.uniform(-0.5, 0.5, 2), rng.uniform(0.15, 0.8))
    dist = tuple((np.array([-0.12, 0.03, 0.001, -0.001]) * rng.random()).tolist()) if k % 3 == 0 else ()
    camera = looking_at((*rng.uniform(-0.1, 0.1, 2), 0.03), eye, size, rng.uniform(20, 70), dist)
    things = [
        Sphere((*rng.uniform(-0.15, 0.15, 2).tolist(), rng.uniform(0, 0.12)), rng.uniform(0.005, 0.06), Lambert(grey))
        for grey in [tuple(rng.uniform(0.1, 0.9, 3).tolist()) for _ in range(rng.integers(1, 12))]
    ]
    things += [Rectangle((0, 0, 0), (0.2, 0, 0), (0, 0.25, 0)), Rectangle((0, 0, -0.002), (1.5, 0, 0), (0, 1.5, 0))]
    u, v, _ = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    things.append(Rectangle((0.05, 0.05, 0.1), tuple((0.05 * u).tolist()), tuple((0.08 * v).tolist())))
    sun = Sun((*rng.normal(0, 0.6, 2).tolist(), 1.0))
    return scene_of("random", camera, tuple(things), (sun, LIGHTS[1]))


def far_away(radii: float, count: int = 3, size=(64, 48)) -> Scene:
    """Balls on a floor, seen from `radii` radii away, as large in the picture at any distance."""
    rng, r = np.random.default_rng(7), 0.05
    side = r * max(2.5, 1.2 * count**0.5)
    eye = np.array((0.3, -0.8, 0.5)) / np.linalg.norm((0.3, -0.8, 0.5)) * radii * r
    camera = looking_at((0, 0, 0), tuple(eye.tolist()), size, np.degrees(2 * np.arctan(1.6 * side / radii / r)))
    things = [Sphere((*rng.uniform(-side, side, 2).tolist(), s), s, Lambert(tuple(rng.uniform(0.2, 0.9, 3).tolist())))
              for s in r * rng.uniform(0.9, 1, count)]  # fmt: skip
    return scene_of("far", camera, (*things, Rectangle((0, 0, 0), (2 * side, 0, 0), (0, 2 * side, 0))), LIGHTS)


def weekend(radius: float, size=(160, 120)) -> Scene:
    """*Ray Tracing in One Weekend*'s last scene, the three large balls on the ground of this radius, under a sun."""
    ground = Sphere((0, 0, -radius), radius, Lambert((0.5, 0.5, 0.5)))
    balls = (Sphere((x, 0, 1), 1.0, Lambert((0.4, 0.2, 0.1))) for x in (0, -4, 4))
    return scene_of("weekend", looking_at((0, 0, 0), (13, 3, 2), size), (ground, *balls), LIGHTS)


def errors(scene: Scene) -> tuple[int, int, Image, Image]:
    """Pixels that see another object than in float64, and those whose light at `shadow` is off by 1e-4; both images."""
    exact, found = fast.trace(scene, "shadow", "numpy64"), render(scene, "shadow", cache=False)
    off = (abs(found.mean - exact.mean) > 1e-4).any(axis=-1)
    return int((found.surface.ids != exact.surface.ids).sum()), int(off.sum()), exact, found


@pytest.mark.parametrize("k", range(0, 224, 28))
def test_a_random_scene_is_float64s_but_for_a_pixel_at_a_shadows_edge(k):
    """8 scenes of 19 200 pixels, 1e-4 of which may differ."""
    ids, off, exact, found = errors(random_scene(k))
    assert ids == 0
    assert off <= 1
    depth, right = found.surface.depth, exact.surface.depth
    assert np.quantile(abs(depth - right) / np.maximum(right, 1e-9), 0.999) < 1e-5


@pytest.mark.parametrize("radii", [130.0, 1e3, 1e4, 1e5])
def test_a_scene_at_any_distance_is_as_float64_sees_it_and_shades_the_floor_it_touches(radii):
    """Rays begin where the scene does: from the eye, 2⁻²⁴ of 10 000 radii is 6e-4 of one."""
    ids, off, exact, found = errors(far_away(radii))
    assert (ids, off) == (0, 0)
    np.testing.assert_allclose(found.surface.depth, exact.surface.depth, rtol=2e-7)


@pytest.mark.parametrize(("radius", "most"), [(100.0, 0), (1e3, 0), (1e4, 8), (1e5, 20)])
def test_a_ground_of_any_radius_does_not_shade_itself(radius, most):
    """Of 19 200 pixels; with Mitsuba's own offsets 894 are falsely in shadow at 10 km, 8770 at 100 km."""
    ids, off, _, _ = errors(weekend(radius))
    assert ids == 0
    assert off <= most


@pytest.mark.parametrize("half", [1e3, 1e5])
def test_a_floor_of_any_size_does_not_shade_itself(half):
    floor = Rectangle((0.3, 0.2, 0), (half, 0, 0), (0, half, 0), Lambert((0.5, 0.5, 0.5)))
    scene = scene_of("floor", looking_at((0, 0, 0), (13, 3, 2)), (Sphere((0, 0, 1), 1.0), floor), LIGHTS)
    ids, off, exact, found = errors(scene)
    assert ids == 0
    assert off <= 4
    np.testing.assert_allclose(found.surface.depth, exact.surface.depth, rtol=1e-5)


def test_light_is_followed_from_far_spheres_as_from_near_ones():
    """As the tracer follows it: |z| of each channel's mean below 4.5, by chance in 1 of 24 000 runs."""
    found = []
    for rung, radii in (("sky", 129.0), ("path", 1e5)):
        scene = far_away(radii, size=(24, 18))
        ours = render(scene, rung, samples=1024, seed=1, cache=False)
        theirs = fast.walk(scene, rung, "numpy64", sampling="center", samples=64, seed=2)
        error = (ours.mean.astype(float) - theirs.mean).mean(axis=(0, 1))
        sigma = np.sqrt((ours.variance.astype(float) + theirs.variance).sum(axis=(0, 1))) / (24 * 18)
        found.append(abs(error / sigma).max())
    assert max(found) < 4.5


# ---------------------------------------------------------------------------------------------- said in the verdict


def beside_near(radius: float) -> Scene:
    """A ball 1 m ahead and a tiny one of this radius 2 m ahead beside it, which no origin serves both."""
    balls = Sphere((0.0, 0.0, 0.0), 0.2), Sphere((0.3, 1.0, 0.0), radius, Lambert((0.6, 0.6, 0.6)))
    return scene_of("both", looking_at((0.15, 0.5, 0.0), (0.15, -1.0, 0.0)), balls, LIGHTS)


def test_only_what_is_extreme_is_said_to_be_in_single_precision():
    for radius, said in ((1 / 40, False), (1 / 80, True)):  # 2 m ahead: 80 and 160 radii
        scene = beside_near(radius)
        image = render(scene, "shadow", cache=False)
        _, sentences = settle(image, image, scene)
        assert [text.startswith("single precision") for text in sentences] == [True] * said
        if said:
            assert f"{(image.surface.ids == 1).sum()} pixels, compared within the rounding of object 1" in sentences[0]


def test_a_kilometre_of_ground_passes_and_is_said():
    scene = weekend(1e3)
    exact, found = fast.trace(scene, "shadow", "numpy64"), render(scene, "shadow", cache=False)
    test, said = settle(exact, found, scene)
    assert compare(test, found).verdict == "pass"
    assert "object 0" in said[-1]


def test_far_balls_beside_a_near_one_pass_though_single_pixels_see_another_object():
    """No origin serves both: float32 errs at 300 radii."""
    differ = 0
    for scene in (scene for label, scene, _ in far(2) if label == "300 radii, another near"):
        ids, _, exact, found = errors(scene)
        test, said = settle(exact, found, scene)
        assert compare(test, found).verdict == "pass", said
        differ += ids
    assert differ > 0


def flipped(image: Image, places: list[tuple[int, int]], scene: Scene) -> Image:
    """The image with these pixels (row, column) of the floor lit where they are in shadow, and in shadow where lit."""
    mean, albedo = image.mean.copy(), np.asarray(scene.objects[1].material.albedo)
    dark = albedo * scene.sky.radiance
    lit = dark + albedo / np.pi * scene.sun.irradiance * scene.sun.to_light[2]
    for place in places:
        mean[place] = dark if mean[place][0] > dark[0] + 0.1 else lit
    return replace(image, mean=mean)


def test_a_shadow_is_forgiven_at_its_edge_alone():
    """The sun's ray from one pixel passes the ball's outline exactly; every other change is reported."""
    floor = Rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), Lambert((0.5, 0.5, 0.5)))
    # Straight from above, the ball at x = 0.5 m casts the circle of its own size: it ends at a pixel's centre.
    K = ((200.0, 0.0, 80.0), (0.0, 200.0, 60.0), (0.0, 0.0, 1.0))
    camera = Camera((161, 121), K, ((1, 0, 0), (0, -1, 0), (0, 0, -1)), (0, 0, 1.0))
    sun = Sun((0.6, 0.0, 0.8), (3.0, 3.0, 3.0))
    # At a floor point x, the distance of the centre (c, 0, h) from the sun's ray is |0.8 (c - x) - 0.6 h|.
    center, height = 0.45, 0.4
    edge = center - (0.6 * height + 0.1) / 0.8  # 0.025 m: five pixels right of the middle
    scene = scene_of("edge", camera, (Sphere((center, 0.0, height), 0.1), floor), (sun, LIGHTS[1]))
    image = render(scene, "shadow", cache=False)
    column = 80 + round(200 * edge)
    assert 200 * edge == pytest.approx(column - 80, abs=1e-9)
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


def test_another_object_is_forgiven_on_an_outline_alone():
    scene = random_scene(0)
    image = render(scene, "shadow", cache=False)
    ids = image.surface.ids.copy()
    row, column = np.argwhere(ids >= 0)[len(np.argwhere(ids >= 0)) // 2]
    ids[row, column] = -1
    wrong = replace(image, surface=replace(image.surface, ids=ids))
    settled, said = settle(wrong, image, scene)
    assert settled.surface.ids[row, column] == -1
    assert not said
