"""Lambert's law, and which points see the sun."""

import math

import numpy as np
import pytest
from scene_of import changed, scene_of
from truths import camera_above

from raytwin.fast import trace
from raytwin.scene import Rectangle, Scene, Sky, Sphere, Sun
from raytwin.tracer import STAGES, Hit, PlainWorld, back_project, first_hit, intersect_rectangle, lambert, sun_visible
from raytwin.tracer.lights import lighting
from raytwin.tracer.pixel_to_ray import to_board


def everything(scene: Scene) -> PlainWorld:
    return PlainWorld(scene.objects, STAGES)


def hits_of(scene: Scene) -> Hit:
    """What the scene's camera sees, point by point, in the board's frame and float64."""
    w, h = scene.camera.image_size
    u, v = np.meshgrid(np.arange(w), np.arange(h))
    with np.errstate(all="ignore"):
        d = to_board(back_project(u, v, scene.camera), scene.camera)
        return first_hit(everything(scene), scene.camera.eye, d)


def free_by_geometry(p: np.ndarray, scene: Scene, own: int) -> bool:
    """Does the half-line from p to the sun miss every other object? By closest points and a linear system."""
    to_light = np.asarray(scene.sun.to_light)
    for i, thing in enumerate(scene.objects):
        if i == own:
            continue
        if isinstance(thing, Sphere):
            c = np.asarray(thing.center) - p
            if np.linalg.norm(c - max(0.0, float(c @ to_light)) * to_light) < thing.radius:
                return False
        else:
            axes = np.stack([-to_light, thing.half_u, thing.half_v], axis=1)
            s, a, b = np.linalg.solve(axes, p - np.asarray(thing.center))
            if s > 0 and abs(a) < 1 and abs(b) < 1:
                return False
    return True


def test_lambert_is_the_formula():
    slanted = (0.0, math.sin(0.7), math.cos(0.7))
    up = (0.0, 0.0, 1.0)
    assert lambert(0.5, slanted, up, 3.0, 1.0, 0.2) == pytest.approx(0.5 / math.pi * 3 * math.cos(0.7) + 0.1, rel=1e-15)
    assert lambert(0.5, slanted, up, 3.0, 0.0, 0.2) == pytest.approx(0.1)
    assert lambert(0.5, up, (0.0, 0.0, -1.0), 3.0, 1.0, 0.2) == pytest.approx(0.1)


def test_sun_visible_agrees_with_geometry_on_every_shipped_scene(shipped):
    scene = shipped.with_camera(shipped.camera.resized(80, 60))
    hit = hits_of(scene)
    visible = sun_visible(hit, lighting(scene), everything(scene))
    facing = sum(n * c for n, c in zip(hit.normal, scene.sun.to_light, strict=True)) > 0
    points = np.stack(hit.point, axis=-1)
    tried = np.argwhere((hit.ids >= 0) & facing)
    assert len(tried) > 100
    for v, u in tried:
        assert visible[v, u] == free_by_geometry(points[v, u], scene, int(hit.ids[v, u])), (u, v)


@pytest.mark.parametrize("sun_above", [True, False])
def test_a_rectangle_is_lit_and_seen_from_both_sides(engine, sun_above):
    # Seen from above, its half-edges wind so that half_u × half_v points away from the eye.
    away = Rectangle((0.0, 0.0, 0.0), (0.0, 2.0, 0.0), (2.0, 0.0, 0.0), (0.5, 0.5, 0.5))
    assert away.normal == (0.0, 0.0, -1.0)
    towards = Rectangle((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.5, 0.5, 0.5))
    sun = Sun((0.0, 0.0, 1.0 if sun_above else -1.0), (math.pi,) * 3)
    for plane in (away, towards):
        scene = scene_of("leaf", camera_above(1.0, 11), (plane,), (sun, Sky((0.2,) * 3)))
        for rung in ("lambert", "shadow"):
            image = trace(scene, rung, engine)
            np.testing.assert_allclose(image.mean, 0.6 if sun_above else 0.1, rtol=1e-6)
            np.testing.assert_array_equal(image.surface.normal, np.broadcast_to(np.float32([0, 0, 1]), (11, 11, 3)))


@pytest.mark.parametrize("radius", [0.5, 4.0])
def test_inside_a_sphere_it_is_dark_but_for_the_sky(engine, radius):
    scene = scene_of("cave", camera_above(0.1, 21, 10.0), (Sphere((0.0, 0.0, 0.0), radius, (0.5, 0.6, 0.7)),))
    scene = changed(scene, lights=(Sun((0.0, 0.0, 1.0), (3.0,) * 3), Sky((0.1, 0.2, 0.3))))
    image = trace(scene, "shadow", engine)
    assert (image.surface.ids == 0).all()
    np.testing.assert_allclose(image.mean, np.broadcast_to([0.05, 0.12, 0.21], (21, 21, 3)), rtol=1e-6)
    # The rung without shadows lets the sun shine through the shell, onto the floor of the cave.
    assert trace(scene, "lambert", engine).mean[10, 10, 0] == pytest.approx(0.05 + 1.5 / math.pi, rel=1e-6)


def test_a_rectangle_ends_with_its_edges_and_lies_before_the_eye():
    """Its corners at (±2, ±3, 0): t = 1 straight down on an edge; none beyond it, behind the eye, along the plane."""
    sheet = Rectangle((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 3.0, 0.0))
    for x, y, met in (
        (2, 0, 1), (-2, 0, 1), (0, 3, 1), (0, -3, 1), (2, -3, 1),
        (2.01, 0, math.inf), (-2.01, 0, math.inf), (0, 3.01, math.inf), (0, -3.01, math.inf),
    ):  # fmt: skip
        assert intersect_rectangle((float(x), float(y), 1.0), (0.0, 0.0, -1.0), sheet) == met
    for d in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)):
        assert intersect_rectangle((0.0, 0.0, 1.0), d, sheet) == math.inf
    assert intersect_rectangle((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), sheet) == math.inf  # on it: t = 0


def test_the_surface_is_coloured_by_its_normal_on_the_boards_axes(engine):
    """(n + 1) / 2: a sheet that leans by 30 degrees to the right shows (3/4, 1/2, (2 + sqrt 3) / 4)."""
    s, c = math.sin(math.pi / 6), math.cos(math.pi / 6)
    sheet = Rectangle((0.0, 0.0, 0.0), (c, 0.0, -s), (0.0, 1.0, 0.0))
    image = trace(scene_of("sheet", camera_above(1.0, 11), (sheet,), (Sky((0.2,) * 3),)), "surface", engine)
    np.testing.assert_allclose(image.mean, np.broadcast_to([0.75, 0.5, (2 + math.sqrt(3)) / 4], (11, 11, 3)), rtol=1e-6)
