import numpy as np
import pytest

from raytwin.compare import error_map, error_scale
from raytwin.compare.heatmap import signed_error
from raytwin.errors import InputError
from raytwin.images.image import Image

R = np.full((12, 16, 3), 0.5, np.float32)


def pair(error, variance=None):
    t = R.copy()
    t[4, 5, 1] += error
    return Image(t, variance), Image(R)


def test_agreement_is_white_and_signs_have_their_own_hue():
    bright, dark = error_map(*pair(0.1), scale=0.1), error_map(*pair(-0.1), scale=0.1)
    assert bright.dtype == np.float32
    assert bright.shape == (12, 16, 3)
    assert np.all(bright[0, 0] == 1)
    assert bright[4, 5, 0] > 5 * bright[4, 5, 2]
    assert dark[4, 5, 2] > 5 * dark[4, 5, 0]


def test_lightness_falls_with_the_error_on_both_sides_and_stops_at_the_scale():
    def luminance(error):
        return float(error_map(*pair(error), scale=0.2)[4, 5] @ [0.2126, 0.7152, 0.0722])

    for sign in (-1, 1):
        steps = [luminance(sign * e) for e in (0.0, 0.05, 0.1, 0.15, 0.2)]
        assert steps == sorted(steps, reverse=True)
        assert luminance(sign * 5) == pytest.approx(steps[-1])


def test_what_is_not_finite_has_a_colour_of_its_own():
    shown = error_map(*pair(np.nan), scale=1)
    assert shown[4, 5, 1] > 5 * shown[4, 5, 0]
    assert np.isfinite(shown).all()


@pytest.mark.parametrize(("error", "scale"), [(0.1, 0.1), (0.11, 0.2), (0.3, 0.5), (0.7, 1.0), (2e-3, 2e-3)])
def test_the_scale_is_rounded_up_to_one_two_or_five(error, scale):
    images = Image(R.astype(float) + error), Image(R.astype(float))
    assert error_scale(*images) == pytest.approx(scale, rel=0.03)


def test_images_without_error_have_the_scale_one_and_no_scale_is_nothing():
    assert error_scale(Image(R), Image(R)) == 1
    with pytest.raises(InputError, match="scale"):
        error_map(Image(R), Image(R), scale=0.0)


def test_the_channel_that_errs_most_is_shown_the_first_of_equals_and_nan_before_all():
    test = np.array([[[1, -3, 2], [2, -2, 2], [0, np.nan, 9], [np.nan, 1, 2], [0, 0, np.inf]]], np.float32)
    found = signed_error(Image(test), Image(np.zeros_like(test)))[0]
    np.testing.assert_array_equal(found, np.float32([-3, 2, np.nan, np.nan, np.inf]))
