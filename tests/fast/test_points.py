"""Rays through any points of the image plane: what they see and what hides the sun, against every object in turn."""

import msgspec
import numpy as np
import pytest
from scene_of import changed
from test_bvh import strewn

from raytwin.fast import ENGINES, trace, trace_points
from raytwin.fast.boxes import corner_box
from raytwin.fast.speculation import AWAY, LIT, doubtful, speculate
from raytwin.scene import Phong
from raytwin.tracer import STAGES
from raytwin.tracer.world import intersect


@pytest.fixture(scope="module")
def strewn_scene(overlap):
    return strewn(overlap, np.random.default_rng(5), 40, 12)


def test_points_strewn_over_many_tiles_see_what_float64_sees_and_know_what_hides_the_sun(strewn_scene, engine):
    """All blockers of a point are told by trying every object; in float32 a ray at an edge may go astray."""
    scene, rng = strewn_scene, np.random.default_rng(9)
    u, v = rng.uniform(0, np.array(scene.camera.image_size) - 1, (400, 2)).T
    found = trace_points(scene, u, v, "shadow", engine, point=True)
    exact = trace_points(scene, u, v, "shadow", "numpy64", point=True)
    astray = 0.01 if ENGINES[engine].bits == 32 else 0
    assert (found.ids != exact.ids).mean() <= astray
    assert (np.abs(found.colour - exact.colour).max(axis=-1) > 1e-5).mean() <= astray
    sun, eye = np.array(scene.sun.to_light), np.array(scene.camera.eye)
    hidden = np.zeros(len(u), bool)
    for i, thing in enumerate(scene.objects):
        start = eye + exact.point.astype(float) + 1e-6 * sun
        t = intersect(tuple(start.T), tuple(sun.tolist()), thing, STAGES)
        reaches = np.isfinite(t) & (exact.ids != i)
        hidden |= reaches
        assert ((found.blocker == i) & ~reaches & (exact.ids != i)).mean() <= astray
    told = (found.blocker != AWAY) & (found.ids >= 0)
    assert told.mean() > 0.2
    assert ((found.blocker == LIT) == ~hidden)[told].mean() > 0.98  # a ball that shades itself is not in `hidden`
    assert hidden[told].any()
    assert (~hidden[told]).any()


@pytest.mark.parametrize("shiny", [0, 3])
def test_many_objects_keep_the_highlight_of_each(strewn_scene, engine, shiny):
    """Looked up in a table on Dr.Jit: the first object's as well as another's."""
    gloss = Phong((0.2, 0.2, 0.2), (0.5, 0.4, 0.3), 20.0)
    objects = [
        msgspec.structs.replace(thing, albedo=gloss) if i == shiny else thing
        for i, thing in enumerate(strewn_scene.objects)
    ]
    scene = changed(strewn_scene, objects=tuple(objects))
    scene = scene.with_camera(scene.camera.resized(48, 36))
    found, exact = (trace(scene, "shadow", e) for e in (engine, "numpy64"))
    assert (np.abs(found.mean - exact.mean).max(axis=-1) > 1e-4 * exact.mean.max()).mean() < 0.005
    assert (exact.mean != trace(strewn_scene.with_camera(scene.camera), "shadow", "numpy64").mean).any()


@pytest.mark.parametrize(("share", "doubted"), [(0.9, False), (1.1, True)])
def test_a_block_is_guessed_where_a_quarter_of_its_corners_second_differences_is_within_the_tolerance(share, doubted):
    """c x²/2 has the second difference c along x, and none along y; the lattice's rim has no neighbours to tell."""
    tolerance, x = 1e-3, np.arange(8.0)
    colour = np.repeat(np.repeat((share * 4 * tolerance * x * x / 2)[None, :, None], 7, axis=0), 3, axis=2)
    ids, blocker = np.zeros((7, 8), int), np.zeros((7, 8), int)
    for along in (colour, colour.transpose(1, 0, 2)):
        shape = along.shape[:2]
        found = doubtful(along.astype("f"), ids.reshape(shape), blocker.reshape(shape), tolerance)
        assert (found[1:-1, 1:-1] == doubted).all()


def test_a_guess_is_held_to_5e_4_unless_asked_otherwise(single):
    shares = [speculate(single, 4, "lambert", **asked)[1] for asked in ({}, {"tolerance": 5e-4}, {"tolerance": 6e-4})]
    assert shares[0] == shares[1] > shares[2]


def test_the_papers_box_is_that_of_the_projected_corners_and_the_frame_where_one_has_no_pixel(single):
    """Of a sheet its own four; of a sphere its cube's eight."""
    camera = single.camera
    sheet = strewn(single, np.random.default_rng(1), 0, 1).objects[1]
    for thing in (sheet, single.spheres[0]):
        half = (sheet.half_u, sheet.half_v) if thing is sheet else thing.radius * np.eye(3)
        turns = np.array(np.meshgrid(*[(-1, 1)] * len(half))).reshape(len(half), -1).T
        at = (np.array(thing.center) + turns @ np.array(half)) @ np.array(camera.R_cam_board).T + camera.t_cam_board
        u, v = (at[:, :2] / at[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)).T
        x0, y0, x1, y1 = corner_box(thing, camera)
        assert (x0, y0) == (max(np.floor(u.min()), 0), max(np.floor(v.min()), 0))
        assert (x1, y1) == (min(np.ceil(u.max()) + 1, 640), min(np.ceil(v.max()) + 1, 480))
    through = msgspec.structs.replace(sheet, center=camera.eye, half_u=(0.0, 0.0, 1.0))
    at_eye = msgspec.structs.replace(through, half_u=(1e-3, 0.0, 0.0), half_v=(0.0, 1e-3, 0.0))
    assert corner_box(at_eye, camera) == (0, 0, 640, 480)
