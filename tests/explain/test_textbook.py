"""The textbook's tracer is the subject, and takes slips in its text."""

import numpy as np
import pytest

from raytwin import scene_folders
from raytwin.explain.draw_scene import draw_scene
from raytwin.explain.pixel_sample import SubmittedImage, sample_pixels
from raytwin.explain.predict import NO_MISTAKE, predictor, slip, text_of
from raytwin.explain.textbook import FUNCTIONS, tracer_with
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


DRAWN = draw_scene(1, (60, 44))


def radiance(way):
    return predictor(DRAWN, every=7).radiance(way)


@pytest.mark.parametrize("function", FUNCTIONS)
def test_a_function_of_the_textbook_without_a_slip_is_the_tracers_own_step(function):
    assert np.abs(radiance(slip(function)) - radiance(NO_MISTAKE)).max() < 1e-9


def test_slips_in_one_function_add_up_and_those_that_exclude_one_another_are_refused():
    changes = (" / np.pi", ""), ("albedo * sky", "sky"), ("return albedo", "return 0 * albedo")
    pi, sky, all_ = (slip("shade", change) for change in changes)
    both = radiance((*pi, *sky))
    assert np.array_equal(both, radiance((*sky, *pi)))
    assert not np.allclose(both, radiance(sky))
    again = slip("shade", ("albedo / np.pi", "albedo / 3"))
    with pytest.raises(ValueError, match="shade has no"):
        radiance((*pi, *again))
    assert text_of(all_) == ("shade", (("return albedo", "return 0 * albedo"),))
    assert text_of(NO_MISTAKE) is None


def test_slips_that_do_not_go_with_another_change_predict_nothing():
    summed = slip("shade", ("albedo * sky", "albedo @ sky[:, None]"))
    by_point = slip("radiance", ("    lit = shade(", "    sky = sky * np.ones((3, 7, 1))\n    lit = shade("))
    sample = sample_pixels(SubmittedImage(DRAWN, np.zeros((44, 60, 3))))
    assert np.isnan(sample.predict((*by_point, *summed))).all()
    assert np.isfinite(sample.predict(summed)).all()
