"""The twin's light against closed forms, exact or with a stated false-alarm rate, on both variants.

F is the share of the sky's light that another surface takes from a surface element (its configuration factor); with
albedo a under a sky of radiance Ls alone the element shows a (1 - F) Ls at one bounce. A sampled mean may err by 3.5 of
its standard errors: a correct twin fails in 5 of 10 000 tests of new seeds. The seeds here are fixed.
"""

from math import cos, hypot, inf, pi, radians, sin, sqrt

import numpy as np
import pytest
from truths import (
    BLACK,
    WHITE,
    Shown,
    agrees,
    element,
    from_element,
    grey,
    in_wedge,
    parallel,
    perpendicular,
    shown,
    view_of,
    wedge,
)

from raytwin.scene import Lambert, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.twin import render

MANY = {"llvm_ad_rgb": 1 << 20, "scalar_rgb": 1 << 14}
"""Samples of a test. `scalar_rgb` takes 20 s for a million; its arithmetic is the same."""


def mean_of(scene: Scene, variant: str, rung: str = "sky", **options) -> Shown:
    pixels = scene.camera.width * scene.camera.height
    image = render(scene, rung, samples=MANY[variant] // pixels, seed=1, cache=False, variant=variant, **options)
    assert (image.surface.ids == image.surface.ids[0, 0]).all()
    return shown(image, 8 if variant == "llvm_ad_rgb" else 1)  # tiles of few samples know too little of their noise


@pytest.mark.parametrize(("at", "lost"), [(0.1, 0.450248140490), (0.5, 0.276393202250), (1.0, 0.146446609407)])
def test_a_wall_hides_its_share_of_the_sky_from_the_floor_beside_it(variant, at, lost):
    """(1 - d / √(d² + H²)) / 2 at the distance d from a wall of height H, infinitely long; both of one albedo.

    The wall is 200 H long, which takes 1e-5 off the share, and the picture 1e-3 H wide: 1e-6.
    """
    grey = Lambert((0.5, 0.5, 0.5))
    floor = Rectangle((0, 0, 0), (100, 0, 0), (0, 100, 0), grey)
    wall = Rectangle((0, 0, 0.5), (0, 100, 0), (0, 0, 0.5), grey)
    camera = view_of((at, 0, 0), (at + 0.4, 0.1, 0.8), 1e-3)
    for planes, expected in (((floor, wall), 0.5 * (1 - lost)), ((wall, floor), 0.5 * (1 - lost))):
        found = mean_of(Scene("wall", camera, planes, (Sky((1, 1, 1)),)), variant)
        assert found.error < 4e-4 * np.sqrt(MANY["llvm_ad_rgb"] / MANY[variant])
        assert agrees(found, expected, 1e-5)


# ---------------------------------------------------------------------------------------------- sphere and element


@pytest.mark.parametrize(
    ("h", "c", "F"),
    [
        (2, 1, 0.25), (2, 0.5, 0.125), (2, 0, 0.0288344428112), (2, -0.25, 0.00619138643466),
        (1.5, 0.3, 0.155199137089), (1.5, 0, 0.0741100731061), (4, 0.1, 0.00726762714777), (1.01, 0, 0.410931538210),
    ],
)  # fmt: skip
def test_a_sphere_hides_from_an_element_what_howell_says(variant, h, c, F):
    """The element at the origin faces up, the sphere stands at the angle acos(c) from that; it is black."""
    assert from_element(h, c) == pytest.approx(F, rel=1e-9)
    ball = Sphere((h * sqrt(1 - c * c), 0, h * c), 1.0, BLACK)
    camera = view_of((0, 0, 0), (-0.6, 0.2, 0.3), 1e-3)
    found = mean_of(Scene("element", camera, (element((0, 0, 1)), ball), WHITE), variant)
    assert agrees(found, 0.5 * (1 - F))


@pytest.mark.parametrize("height", [1.0, 2.0])
@pytest.mark.parametrize("at", [0.0, 0.5, 1.0, 2.0, 3.0])
def test_a_ball_hides_from_the_floor_its_share_of_the_sky(variant, height, at):
    """r² H / (ρ² + H²)^(3/2) for a ball whose centre is H above the floor, ρ from its foot."""
    if height == 1.0 and at == 0.0:
        return  # the point of contact is not seen
    eye = (at + 2.5, 0.0, 0.15) if height == 1.0 else (at + 2.0, 0.3, 0.4)
    floor = Rectangle((0, 0, 0), (10, 0, 0), (0, 10, 0), grey(0.5))
    scene = Scene("ball", view_of((at, 0, 0), eye, 1e-4), (Sphere((0, 0, height), 1.0, grey(0.3)), floor), WHITE)
    hidden = height / hypot(at, height) ** 3
    assert agrees(mean_of(scene, variant), 0.5 * (1 - hidden), 2e-5)  # the picture is 0.002 long


@pytest.mark.parametrize("slope", [-0.8, -0.2, 0.4])
def test_a_ball_over_an_endless_floor_sees_its_half_of_the_sky(variant, slope):
    """(1 + n·z) / 2; a floor of 1000 H leaves 1e-3 rad open above its rim: to an upright surface 6e-4 of the sky."""
    n = np.array([sqrt(1 - slope**2), 0, slope])
    center = np.array([0, 0, 3.0])
    at = center + n
    eye = at + 1.2 * n + np.array([0.0, 0.5, 0.0])
    floor = Rectangle((0, 0, 0), (3000, 0, 0), (0, 3000, 0), BLACK)
    ball = Sphere((0, 0, 3.0), 1.0, grey(0.5))
    found = mean_of(Scene("over", view_of(at, eye, 1e-3), (ball, floor), WHITE), variant)
    assert agrees(found, 0.5 * (1 + slope) / 2, 0.5 * 6.4e-4 * n[0])


# ---------------------------------------------------------------------------------------------- rectangle and element


def test_a_lid_hides_from_the_element_under_its_corner_what_its_solid_angle_does(variant):
    assert parallel(1, 1) == pytest.approx(0.138531605995, rel=1e-11)
    lid = Rectangle((0.75, 0.5, 1.0), (0.75, 0, 0), (0, 0.5, 0), BLACK)
    camera = view_of((0, 0, 0), (-0.6, -0.5, 0.5), 1e-3)
    found = mean_of(Scene("lid", camera, (element((0, 0, 1)), lid), WHITE), variant)
    assert agrees(found, 0.5 * (1 - parallel(1.5, 1.0)))


def test_a_wall_opposite_the_element_hides_what_its_solid_angle_does(variant):
    assert perpendicular(1, 1) == pytest.approx(0.0557341970026, rel=1e-11)
    wall = Rectangle((0.5, 0.6, 0.4), (0, 0.6, 0), (0, 0, 0.4), BLACK)
    camera = view_of((0, 0, 0), (-0.6, -0.5, 0.5), 1e-3)
    found = mean_of(Scene("wall", camera, (element((0, 0, 1)), wall), WHITE), variant)
    assert agrees(found, 0.5 * (1 - perpendicular(0.8 / 1.2, 0.5 / 1.2)))


# ---------------------------------------------------------------------------------------------- wedge: every depth


def test_the_wedges_formula_gives_the_written_numbers():
    for degrees, numbers in {
        90: (0.25, 0.3125, 0.328125, 0.33203125, 1 / 3),
        60: (0.125, 0.171875, 0.189453125, 0.196044922, 0.2),
        120: (0.375, 0.421875, 0.427734375, 0.428466797, 3 / 7),
    }.items():
        assert [in_wedge(degrees, 0.5, 0.5, n) for n in (0, 1, 2, 3, inf)] == pytest.approx(numbers, rel=1e-8)
    assert in_wedge(90, 0.8, 0.3, inf) == pytest.approx(0.489361702128, rel=1e-11)
    assert in_wedge(90, 0.3, 0.8, inf) == pytest.approx(0.223404255319, rel=1e-11)


@pytest.mark.parametrize("half", [5.0, 500.0], ids=["held by Mitsuba", "too large for it"])
@pytest.mark.parametrize("degrees", [60, 90, 120])
@pytest.mark.parametrize(("one", "other", "bounces", "sun"), [
    (0.5, 0.5, 0, 0), (0.5, 0.5, 1, 0), (0.5, 0.5, 2, 0), (0.5, 0.5, 30, 0), (0.8, 0.3, 30, 0), (0.3, 0.8, 2, 2.0),
])  # fmt: skip
def test_light_between_two_planes_is_exact_at_every_depth(variant, half, degrees, one, other, bounces, sun):
    """Seen d = 5 mm from the edge. Where the sheets end the sky comes in: that brightens by d / half at most.

    (9.6e-4 for 10 m at 60 degrees and depth 32, the worst, by 8 million samples; 7e-5 +- 7e-5 for 1 km.)
    """
    at = (0.005, 0.0, 0.0)
    tilt = radians(degrees / 2)  # the sun shines along the wedge's middle
    lights = WHITE + ((Sun((cos(tilt), 0.0, sin(tilt)), (sun,) * 3),) if sun else ())
    share = sun * sin(tilt) / pi
    expected = in_wedge(degrees, one, other, bounces, (share, share))
    eye = (0.005 + 0.15 * cos(radians(35)), 0.04, 0.15 * sin(radians(35)))
    scene = Scene("wedge", view_of(at, eye, 1e-5), wedge(degrees, one, other, half), lights)
    found = mean_of(scene, variant, "path", max_depth=bounces + 2)
    assert agrees(found, expected, at[0] / half)


# ---------------------------------------------------------------------------------------------- white furnace


@pytest.mark.parametrize("depth", [2, 3, 5, 64])
def test_a_white_scene_in_a_white_sky_is_never_brighter_than_it_and_as_bright_in_the_end(variant, depth):
    """Every path that escapes brings Ls. Of 62 bounces between ball and floor next to nothing is left."""
    things = (Sphere((0, 0, 1), 1.0, grey(1)), Sphere((1.5, 1, 0.5), 0.5, grey(1)), Rectangle(
        (0, 0, 0), (5, 0, 0), (0, 5, 0), grey(1)))  # fmt: skip
    scene = Scene("furnace", view_of((0.8, 0.0, 0.0), (3.0, 0.2, 0.4), 1e-3), things, (Sky((0.7, 0.7, 0.7)),))
    found = mean_of(scene, variant, "path", max_depth=depth)
    assert found.mean < 0.7 + 3.5 * found.error + 1e-5
    if depth == 64:
        assert agrees(found, 0.7, 1e-5)
    else:
        assert found.mean < 0.69


def test_one_white_body_in_a_white_sky_is_lost_in_it(variant):
    """a Ls everywhere, without noise but for Mitsuba's own choice of where to look for the sky."""
    camera = view_of((0, 0, 0), (0, -3, 1), 2.0, 24)
    scene = Scene("one", camera, (Sphere((0, 0, 0), 0.9, grey(1)),), (Sky((0.7, 0.7, 0.7)),))
    for rung in ("lambert", "shadow", "sky"):
        np.testing.assert_allclose(render(scene, rung, samples=4, cache=False, variant=variant).mean, 0.7, rtol=1e-6)
    path = render(scene, "path", samples=4, cache=False, variant=variant)
    np.testing.assert_allclose(path.mean, 0.7, rtol=1e-5)
