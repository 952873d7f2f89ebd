"""The sky that spheres leave, in closed form: Howell's numbers, and where it must not be used."""

import numpy as np
import pytest
from scene_of import scene_of
from truths import WHITE, element, from_element, view_of

from raytwin import fast
from raytwin.scene import Rectangle, Shape, Sphere
from raytwin.tracer.hit import Hit
from raytwin.tracer.lights import sky_visibility, sphere_share

TRUTHS = [(2, 1, 0.25), (2, 0.5, 0.125), (2, 0, 0.0288344428112), (2, -0.25, 0.00619138643466),
          (1.5, 0.3, 0.155199137089), (1.5, 0, 0.0741100731061), (4, 0.1, 0.00726762714777),
          (1.01, 0, 0.410931538210), (3, -0.9, 0.0), (1, 0.3, 0.65)]  # fmt: skip
UP = (0.0, 0.6, 0.8)


def ball(direction, h: float, radius: float = 1.0) -> Sphere:
    """A sphere h radii away from the origin."""
    x, y, z = (np.asarray(direction) / np.linalg.norm(direction) * h * radius).tolist()
    return Sphere((x, y, z), radius)


def left_at_origin(*others: Shape, inside: bool = False) -> tuple[float, bool]:
    """`sky_visibility` on a sheet at the origin that faces UP, object 0."""
    point = tuple(np.zeros(1) for _ in range(3))
    normal = tuple(np.full(1, c) for c in UP)
    hit = Hit(np.ones(1), np.zeros(1, int), point, normal, normal, np.full(1, inside), normal)
    left, known = sky_visibility(hit, (element(UP), *others))
    return float(left[0]), bool(known[0])


@pytest.mark.parametrize(("precision", "most"), [(np.float64, 1e-12), (np.float32, 3e-7)])
def test_a_sphere_takes_the_share_that_howell_gives_cut_by_the_horizon_or_not(precision, most):
    h, c, F = np.array(TRUTHS).T
    np.testing.assert_allclose(sphere_share(h.astype(precision), c.astype(precision)), F, rtol=0, atol=max(most, 6e-13))
    h, c = np.random.default_rng(3).uniform((1.001, -1), (9, 1), (200, 2)).T
    expected = [from_element(*pair) for pair in zip(h, c, strict=True)]
    np.testing.assert_allclose(sphere_share(h.astype(precision), c.astype(precision)), expected, rtol=0, atol=most)


def test_spheres_that_stand_apart_add_up_and_those_below_the_horizon_do_not_matter():
    along, across = np.array((1.0, 0.8, -0.6)), np.array((-1.0, 0.8, -0.6))
    left, known = left_at_origin(ball(UP, 3.0, 0.2), ball(along, 2.0), ball(-np.array(UP), 1.2, 9.0), ball(across, 2.0))
    assert known
    assert left == pytest.approx(1 - 1 / 9 - 2 * from_element(2.0, 0.0), abs=1e-12)
    deep = np.subtract((0.2, 0.0, 0.0), UP)  # overlaps the other, but both lie under the horizon
    assert left_at_origin(ball(-np.array(UP), 1.2), ball(deep, 1.3)) == (1.0, True)


def test_nothing_is_claimed_where_spheres_overlap_or_a_rectangle_rises():
    aside = np.add(UP, (0.5, 0.0, 0.0))  # 26.6 degrees away
    h = 1 / np.sin(np.arctan(0.5) / 2)
    assert left_at_origin(ball(UP, h * 1.001), ball(aside, h * 1.001, 3.0))[1]
    assert not left_at_origin(ball(UP, h * 0.999), ball(aside, h * 0.999, 3.0))[1]
    assert not left_at_origin(ball(aside, h * 0.999), ball(UP, h * 0.999, 3.0))[1]
    wall = Rectangle((0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    under = Rectangle((0.0, 0.0, -3.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert not left_at_origin(wall)[1]
    assert left_at_origin(under) == (1.0, True)


@pytest.mark.parametrize(("h", "c"), [(0.0, 1.0), (0.3, -1.0), (0.99, 0.3), (0.9999, -0.3)])
def test_a_sphere_around_a_point_hides_the_whole_sky_whatever_else_is_there(h, c):
    around = ball(c * np.array(UP) + np.sqrt(1 - c * c) * np.array((1.0, 0.0, 0.0)), max(h, 1e-9), 5.0)
    wall = Rectangle((0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert left_at_origin(ball(UP, 2.0), inside=True) == (0.0, True)
    for others in ((around,), (around, ball(UP, 2.0)), (ball(UP, 2.0), around), (around, wall), (wall, around)):
        assert left_at_origin(*others) == (0.0, True)


@pytest.mark.parametrize("precision", [np.float64, np.float32])
def test_a_second_sphere_in_the_same_place_hides_nothing(precision):
    """Points of it lie on the first within rounding: neither is inside."""
    twice = (Sphere((0.1, 0.2, 3.0), 0.7), Sphere((0.1, 0.2, 3.0), 0.7))
    n = np.random.default_rng(5).normal(size=(3, 4000))
    n = tuple((n / np.linalg.norm(n, axis=0)).astype(precision))
    point = tuple((c + 0.7 * x).astype(precision) for c, x in zip(twice[0].center, n, strict=True))
    hit = Hit(np.ones(4000), np.zeros(4000, int), point, n, n, np.full(4000, False), n)
    left, known = sky_visibility(hit, twice)
    assert known.all()
    np.testing.assert_allclose(left, 1, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("h", "c"), [(2, -0.25), (1.01, 0)])
def test_the_rung_sky_is_closed_and_without_noise_over_an_element(engine, h, c):
    """On every engine to 1e-5: the picture is 1e-4 wide."""
    up = np.array(UP)
    across = np.cross(up, (1.0, 0.0, 0.0))
    hides = ball(c * up + np.sqrt(1 - c * c) * across, h, 1e3)
    camera = view_of((0, 0, 0), 0.003 * up + (0.001, 0.0, 0.0), 1e-4, 4)
    scene = scene_of("element", camera, (element(UP, 1.0), hides), WHITE)
    image = fast.walk(scene, "sky", engine, sampling="center", samples=4)
    assert image.variance is not None
    assert image.variance.max() < 1e-12
    np.testing.assert_allclose(image.mean, 1 - from_element(h, c), rtol=0, atol=1e-5)
