import numpy as np
import pytest

from raytwin.images.photo_files import from_bytes, srgb_decode, srgb_encode, to_bytes


def test_bytes_are_the_rounded_srgb_curve_on_both_sides_of_every_step_and_for_what_is_no_colour():
    steps = srgb_decode((np.arange(255) + 0.5) / 255)
    for kind, near in ((np.float64, 1e-9), (np.float32, 1e-6)):
        below, above = (to_bytes((steps * (1 + side * near)).astype(kind)) for side in (-1, 1))
        np.testing.assert_array_equal(below, np.arange(255))
        np.testing.assert_array_equal(above, np.arange(1, 256))
    odd = np.array([np.nan, np.inf, -np.inf, -0.0, 0.0, 1.0, 1e-45, 3e38], np.float32)
    assert to_bytes(odd).tolist() == [0, 255, 0, 0, 0, 255, 0, 255]
    assert to_bytes(np.full((2, 3, 3), 0.5, np.float16)).tolist() == np.full((2, 3, 3), 188).tolist()
    every = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(to_bytes(from_bytes(every)), every)


def test_srgb_is_the_standards_curve():
    # IEC 61966-2-1: mid-grey 0.18 is code 0.4614, and the two pieces meet at 0.0031308.
    assert srgb_encode(np.array(0.18)) == pytest.approx(0.461356, abs=1e-6)
    assert srgb_decode(np.array(0.5)) == pytest.approx(0.214041, abs=1e-6)
    assert srgb_encode(np.array(0.0031308)) == pytest.approx(12.92 * 0.0031308)
    assert abs(np.diff(srgb_encode(np.array([0.0031308, 0.0031309])))) < 1e-5
    x = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(srgb_decode(srgb_encode(x)), x, atol=1e-7)
