import numpy as np
import pytest
from tracers_by_students import BOARD_FRAME, mistaken, run

from raytwin.diagnose.changes import given
from raytwin.diagnose.diagnosis import SubmittedImage, diagnose
from raytwin.diagnose.draw_scene import draw_scene
from raytwin.diagnose.pixel_sample import look
from raytwin.diagnose.predict import RIGHT, predictor, slip, slips, text_of
from raytwin.diagnose.slip_table import PLACES, read
from raytwin.renderers.scene_exchange import as_arrays

SCENES = [draw_scene(seed, (60, 44)) for seed in (1, 2)]


def radiance(way, scene=SCENES[0], every=7):
    return predictor(scene, every=every).radiance(way)


@pytest.mark.parametrize("function", PLACES)
def test_a_function_of_the_textbook_without_a_slip_is_the_tracers_own_step(function):
    assert np.abs(radiance(slip(function)) - radiance(RIGHT)).max() < 1e-9


def test_slips_in_one_function_add_up_and_what_excludes_the_first_takes_its_place():
    pi, sky, all_ = slips("shade", " / np.pi => ", "albedo * sky => sky", "return albedo => return 0 * albedo")
    both = radiance((*pi, *sky))
    assert np.array_equal(both, radiance((*sky, *pi)))
    assert not np.allclose(both, radiance(sky))
    again = slips("shade", "albedo / np.pi => albedo / 3")[0]
    assert np.array_equal(radiance((*pi, *again)), radiance(again))
    assert text_of(all_) == ("shade", (("return albedo", "return 0 * albedo"),))
    assert text_of(RIGHT) is None


def test_slips_that_do_not_go_with_another_change_predict_nothing():
    (summed,) = slips("shade", "albedo * sky => albedo @ sky[:, None]")
    by_point = given(sky=lambda sky: sky * np.ones((sky.size, 7, 1)))
    sight = look(SubmittedImage(SCENES[0], np.zeros((44, 60, 3))))
    assert np.isnan(sight.predict((*by_point, *summed))).all()
    assert np.isfinite(sight.predict(summed)).all()


def test_every_generated_slip_is_one_of_the_textbooks_text():
    rows = read()
    assert len(rows) > 500
    assert [r.weight for r in rows] == sorted(r.weight for r in rows)
    assert all(right != wrong and right and wrong for right, wrong in (r.line for r in rows))
    names = [r.name for r in rows]
    assert len(set(names)) == len(names)
    assert not [name for name in names if "|" in name or ";" in name or len(name) > 100]


def test_generated_slips_show_and_each_something_else():
    """A sample: one in forty, on two scenes."""
    made = [np.concatenate([radiance(r.way, scene, 3) for scene in SCENES]) for r in read()[::40]]
    shown = [np.nan_to_num(x, nan=-7, posinf=7e3, neginf=-7e3) for x in (np.concatenate(
        [radiance(RIGHT, scene, 3) for scene in SCENES]), *made)]  # fmt: skip
    alike = sum(np.allclose(a, b, atol=1e-6) for k, a in enumerate(shown) for b in shown[:k])
    assert alike <= 2  # what only other scenes tell apart


def test_a_slip_that_is_in_no_table_is_told_by_what_stands_there_and_what_is_right():
    text = mistaken(BOARD_FRAME, '(n * sun["to_light"])', '(n / sun["to_light"])')
    made = diagnose([SubmittedImage(s, x) for s, x in zip(SCENES[:1], run(text, [as_arrays(SCENES[0])]), strict=True)])
    (cause,) = made.causes
    assert cause.name == "slip-in-shade: normals * to_light -> (normals / to_light)"
    assert "`cosine = np.maximum(0, np.sum((normals / to_light)" in cause.sentence
    assert made.sureness == "likely"
    assert made.explained > 0.999
