"""What report.js is given can be decoded to what the renderers computed, within the stated rounding."""

import base64
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raytwin.image import Image, Surface
from raytwin.report.values import Values, pack_values


def decoded(values: Values) -> dict[str, np.ndarray]:
    """Each plane as report.js reads it."""
    out = {}
    for plane in values.planes:
        raw = np.frombuffer(zlib.decompress(base64.b64decode(plane.data)), np.uint8)
        high, low = raw.reshape(2, values.height, values.width).astype(np.uint16)
        words = high << 8 | low
        if plane.differences:
            words = np.cumsum(words, axis=1, dtype=np.uint16)
        if plane.kind == "half":
            out[plane.name] = np.ldexp(words.view(np.float16).astype(np.float64), plane.shift)
        else:
            out[plane.name] = words * plane.step if plane.kind == "even" else words.view(np.int16)
    return out


def images(rng, height=20, width=30, scale=1.0, error=1e-7) -> tuple[Image, Image]:
    mean = (scale * rng.random((height, width, 3))).astype(np.float32)
    ids = rng.integers(-1, 5, (height, width)).astype(np.int32)
    depth = np.where(ids < 0, 0, rng.uniform(0.5, 1.5, ids.shape)).astype(np.float32)
    normal = np.zeros((height, width, 3), np.float32)
    other = (mean + scale * error * rng.normal(size=mean.shape)).astype(np.float32)
    return Image(other, surface=Surface(ids, depth, normal)), Image(
        mean, surface=Surface(ids[::-1], depth * 1.01, normal)
    )


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 99), st.sampled_from([1e-30, 1e-4, 1.0, 1e6, 1e30]), st.sampled_from([1e-7, 1e-3, 1.0]))
def test_radiance_and_error_come_back_to_eleven_bits_of_their_own(seed, scale, error):
    test, reference = images(np.random.default_rng(seed), scale=scale, error=error)
    found = decoded(pack_values(test, reference))
    for c, name in enumerate("RGB"):
        for key, true in (("", reference.mean[..., c]), ("d", test.mean[..., c] - reference.mean[..., c])):
            top = np.abs(true).max()
            assert np.all(np.abs(found[key + name] - true) <= np.abs(true) * 2.0**-11 + top * 2.0**-38)


def test_ids_come_back_exactly_and_depths_to_a_65535th_of_the_largest():
    test, reference = images(np.random.default_rng(1))
    found = decoded(pack_values(test, reference))
    np.testing.assert_array_equal(found["id"], test.surface.ids)
    np.testing.assert_array_equal(found["id_reference"], reference.surface.ids)
    step = reference.surface.depth.max() / 65535
    np.testing.assert_allclose(found["depth"], reference.surface.depth, atol=0.51 * step)
    np.testing.assert_allclose(found["ddepth"], test.surface.depth - reference.surface.depth, rtol=2**-11, atol=1e-9)


def test_values_that_are_not_finite_stay_so():
    test, reference = images(np.random.default_rng(2))
    test.mean[3, 4] = np.nan, np.inf, -np.inf
    found = decoded(pack_values(test, reference))
    assert np.isnan(found["dR"][3, 4])
    assert found["dG"][3, 4] == np.inf
    assert found["dB"][3, 4] == -np.inf
    assert np.isfinite(found["dR"]).sum() == found["dR"].size - 1


@pytest.mark.parametrize("limits", [{"budget": 2000}, {"most_pixels": 100}])
def test_values_beyond_the_budget_are_those_of_every_nth_pixel(limits):
    test, reference = images(np.random.default_rng(3), 40, 61)
    values = pack_values(test, reference, **limits)
    assert values.thin > 1
    found = decoded(values)
    np.testing.assert_array_equal(found["id"], test.surface.ids[:: values.thin, :: values.thin])
    assert sum(len(p.data) for p in values.planes) < sum(len(p.data) for p in pack_values(test, reference).planes)


def test_images_without_surfaces_have_no_ids():
    rng = np.random.default_rng(4)
    test, reference = (Image(i.mean) for i in images(rng))
    assert {p.name for p in pack_values(test, reference).planes} == {"R", "G", "B", "dR", "dG", "dB"}


def test_equal_black_images_are_all_zero():
    black = Image(np.zeros((5, 6, 3), np.float32))
    assert all(not plane.any() for plane in decoded(pack_values(black, black)).values())


def test_one_row_and_one_column_survive():
    for shape in ((1, 9), (9, 1), (1, 1)):
        test, reference = images(np.random.default_rng(5), *shape)
        np.testing.assert_array_equal(decoded(pack_values(test, reference))["id"], test.surface.ids)
