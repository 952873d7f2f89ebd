"""What correct tracers differ in is forgiven, and no more."""

import numpy as np

from raytwin.explain.changes import offset_by
from raytwin.explain.draw_scene import draw_scene
from raytwin.explain.predict import NO_MISTAKE, predictor, slip
from raytwin.explain.tolerance_mask import forgiven

SCENE = draw_scene(3)


def shown(way=NO_MISTAKE):
    return predictor(SCENE).picture(way).reshape(SCENE.camera.height, SCENE.camera.width, 3)


def test_another_start_of_shadow_rays_is_forgiven_wholly():
    right = shown()
    for eps, along_light in ((7e-4, False), (5e-5, True), (1e-6, False)):
        made = forgiven(shown(offset_by(eps, along_light)), right, SCENE, "shadow")
        assert np.abs(made - right).max() < 1e-6


def test_a_start_that_loses_shadows_is_not_forgiven_nor_is_a_single_wrong_pixel():
    right = shown()
    far = shown(offset_by(3e-2))
    assert (np.abs(forgiven(far, right, SCENE, "shadow") - right).max(axis=-1) > 0.01).mean() > 1e-3
    one = right.copy()
    one[40, 50] += 0.1
    assert np.array_equal(forgiven(one, right, SCENE, "shadow"), one)


def test_missing_shadows_stay_missing():
    right, bare = shown(), shown(slip("sun_visible", ("return visible", "return visible | True")))
    assert np.array_equal(forgiven(bare, right, SCENE, "shadow"), bare)
