import numpy as np
import pytest

from raytwin.compare import error_map, error_scale
from raytwin.compare.heatmap import signed_error
from raytwin.errors import InputError
from raytwin.images.image import Image

R = np.full((12, 16, 3), 0.5, np.float32)


def shown(error, scale):
    """The colours of an error in one pixel, and elsewhere."""
    t = R.copy()
    t[4, 5, 1] += error
    colours = error_map(Image(t), Image(R), scale=scale)
    assert (colours.dtype, colours.shape) == (np.float32, R.shape)
    return colours[4, 5], colours[0, 0]


def test_agreement_is_white_signs_have_their_own_hue_and_what_is_not_finite_another():
    for error, strong, weak in ((0.1, 0, 2), (-0.1, 2, 0), (np.nan, 1, 0)):
        colour, elsewhere = shown(error, 0.1)
        assert np.isfinite(colour).all()
        assert colour[strong] > 5 * colour[weak]
        assert np.all(elsewhere == 1)


def test_lightness_falls_with_the_error_on_both_sides_and_stops_at_the_scale():
    for sign in (-1, 1):
        steps = [float(shown(sign * e, 0.2)[0] @ [0.2126, 0.7152, 0.0722]) for e in (0.0, 0.05, 0.1, 0.15, 0.2, 5.0)]
        assert steps[:-1] == sorted(steps[:-1], reverse=True)
        assert steps[-1] == pytest.approx(steps[-2])


def test_the_scale_is_rounded_up_to_one_two_or_five_and_is_one_without_error():
    for error, scale in ((0.1, 0.1), (0.11, 0.2), (0.3, 0.5), (0.7, 1.0), (2e-3, 2e-3), (0.0, 1.0)):
        images = Image(R.astype(float) + error), Image(R.astype(float))
        assert error_scale(*images) == pytest.approx(scale, rel=0.03), error
    with pytest.raises(InputError, match="scale"):
        error_map(*images, scale=0.0)


def test_the_channel_that_errs_most_is_shown_the_first_of_equals_and_nan_before_all():
    test = np.array([[[1, -3, 2], [2, -2, 2], [0, np.nan, 9], [np.nan, 1, 2], [0, 0, np.inf]]], np.float32)
    found = signed_error(Image(test), Image(np.zeros_like(test)))[0]
    np.testing.assert_array_equal(found, np.float32([-3, 2, np.nan, np.nan, np.inf]))
