"""The textbook's tracer is the subject."""

import numpy as np
import pytest

from raytwin import scene_folders
from raytwin.explain.textbook import tracer_with
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.scene.scene_files import read_scene
from raytwin.scene_folders import find_scene
from raytwin.tracer import trace

SCENES = ("ball", "distorted", "eclipse", "grazing", "overlap", "single", "wedge", "weekend")
"""The shipped ones under sun and even sky, with a camera of their own."""


def small(name):
    scene = read_scene(find_scene(scene_folders.SCENES / name))
    camera = scene.camera
    return scene.with_camera(camera.resized(64, max(2, round(64 * camera.height / camera.width))))


@pytest.mark.parametrize("name", SCENES)
def test_the_textbook_is_the_subject_on_every_shipped_scene(name):
    scene = small(name)
    for rung in ("lambert", "shadow"):
        with np.errstate(all="ignore"):
            off = np.abs(tracer_with().render(as_arrays(scene, rung)) - trace(scene, rung).mean).max(axis=-1)
        assert (off > 1e-5).mean() <= 2e-3, rung  # a pixel on an outline may go either way


def test_a_change_of_what_the_text_does_not_have_is_refused():
    with pytest.raises(ValueError, match="no 'x = y'"):
        tracer_with(changes=(("x = y", "y = x"),))
