import numpy as np
import pytest

from raytwin.explain.draw_scene import draw_scene
from raytwin.explain.pixel_sample import SubmittedImage, sample_pixels
from raytwin.explain.predict import NO_MISTAKE, predictor, slip, text_of
from raytwin.explain.textbook import FUNCTIONS

SCENES = [draw_scene(seed, (60, 44)) for seed in (1, 2)]


def radiance(way, scene=SCENES[0], every=7):
    return predictor(scene, every=every).radiance(way)


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
    sample = sample_pixels(SubmittedImage(SCENES[0], np.zeros((44, 60, 3))))
    assert np.isnan(sample.predict((*by_point, *summed))).all()
    assert np.isfinite(sample.predict(summed)).all()
