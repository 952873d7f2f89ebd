"""The twin's light against closed forms, exact or with a stated false-alarm rate.

A sampled mean may err by 3.5 of its standard errors: a correct twin fails in 5 of 10 000 tests of new seeds. The seeds
here are fixed.
"""

from math import inf

import numpy as np
import pytest
from scene_of import scene_of
from truths import (
    CLOSED,
    Shown,
    agrees,
    beside_wall,
    from_element,
    grey,
    in_wedge,
    parallel,
    perpendicular,
    shown,
    view_of,
)

from raytwin.scene import Rectangle, Scene, Sky, Sphere
from raytwin.twin import render

MANY = 1 << 20
"""Samples of a test."""


def mean_of(scene: Scene, rung: str = "sky", **options) -> Shown:
    pixels = scene.camera.width * scene.camera.height
    image = render(scene, rung, samples=MANY // pixels, seed=1, cache=False, **options)
    assert (image.surface.ids == image.surface.ids[0, 0]).all()
    return shown(image, 8)


@pytest.mark.parametrize("name", [*CLOSED][::2])
def test_the_light_is_what_the_closed_form_says(name):
    """Every second one; `speed` tries all."""
    row = CLOSED[name]
    found = mean_of(row.scene, "sky" if row.depth == 2 else "path", max_depth=row.depth)
    assert found.error < 1e-3
    assert agrees(found, row.expected, row.bias)


def test_no_light_leaks_through_a_wall_of_the_floors_own_material():
    """At 0.08 of its height beside it: (1 + d/√(d² + H²)) / 4 = 0.270. The merged rectangles of `load_dict`'s default
    give 0.401 (Mitsuba 3.9)."""
    row = beside_wall(0.08)
    assert row.expected == pytest.approx(0.27, abs=1e-3)
    found = mean_of(row.scene, "sky", max_depth=2)
    assert agrees(found, row.expected, row.bias)
    assert found.error < 0.01


def test_the_formulas_give_the_written_numbers():
    for h, c, F in (
        (2, 1, 0.25), (2, 0.5, 0.125), (2, 0, 0.0288344428112), (2, -0.25, 0.00619138643466),
        (1.5, 0.3, 0.155199137089), (1.5, 0, 0.0741100731061), (4, 0.1, 0.00726762714777), (1.01, 0, 0.410931538210),
    ):  # fmt: skip
        assert from_element(h, c) == pytest.approx(F, rel=1e-9), (h, c)
    for degrees, numbers in {
        90: (0.25, 0.3125, 0.328125, 0.33203125, 1 / 3),
        60: (0.125, 0.171875, 0.189453125, 0.196044922, 0.2),
        120: (0.375, 0.421875, 0.427734375, 0.428466797, 3 / 7),
    }.items():
        assert [in_wedge(degrees, 0.5, 0.5, n) for n in (0, 1, 2, 3, inf)] == pytest.approx(numbers, rel=1e-8)
    found = in_wedge(90, 0.8, 0.3, inf), in_wedge(90, 0.3, 0.8, inf), parallel(1, 1), perpendicular(1, 1)
    assert found == pytest.approx((0.489361702128, 0.223404255319, 0.138531605995, 0.0557341970026), rel=1e-11)


@pytest.mark.parametrize("depth", [2, 64])
def test_a_white_scene_in_a_white_sky_is_never_brighter_than_it_and_as_bright_in_the_end(depth):
    """Every path that escapes brings Ls. Of 62 bounces between ball and floor next to nothing is left."""
    floor = Rectangle((0, 0, 0), (5, 0, 0), (0, 5, 0), grey(1))
    things = Sphere((0, 0, 1), 1.0, grey(1)), Sphere((1.5, 1, 0.5), 0.5, grey(1)), floor
    scene = scene_of("furnace", view_of((0.8, 0.0, 0.0), (3.0, 0.2, 0.4), 1e-3), things, (Sky((0.7, 0.7, 0.7)),))
    found = mean_of(scene, "path", max_depth=depth)
    assert found.mean < 0.7 + 3.5 * found.error + 1e-5
    assert agrees(found, 0.7, 1e-5) if depth == 64 else found.mean < 0.69


def test_one_white_body_in_a_white_sky_is_lost_in_it():
    """a Ls everywhere, without noise but for Mitsuba's own choice of where to look for the sky."""
    camera = view_of((0, 0, 0), (0, -3, 1), 2.0, 24)
    scene = scene_of("one", camera, (Sphere((0, 0, 0), 0.9, grey(1)),), (Sky((0.7, 0.7, 0.7)),))
    for rung, rtol in (("lambert", 1e-6), ("shadow", 1e-6), ("sky", 1e-6), ("path", 1e-5)):
        np.testing.assert_allclose(render(scene, rung, samples=4, cache=False).mean, 0.7, rtol=rtol)
