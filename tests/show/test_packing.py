"""What viewer.js is given can be decoded to what the renderers computed, within the stated rounding."""

import base64
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raytwin.images.image import Image, Surface
from raytwin.images.packing import Packed, binned, pack, raw_parts


def decoded(values: Packed) -> dict[str, np.ndarray]:
    """Each plane as viewer.js reads it."""
    out = {}
    for plane in values.planes:
        raw = np.frombuffer(zlib.decompress(base64.b64decode(plane.data)), np.uint8)
        high, low = raw.reshape(2, values.lines, values.columns).astype(np.uint16)
        words = high << 8 | low
        if plane.left:
            words = np.cumsum(words, axis=1, dtype=np.uint16)
        if plane.kind == "half":
            out[plane.name] = np.ldexp(words.view(np.float16).astype(np.float64), plane.shift)
        else:
            out[plane.name] = words.view(np.int16) * plane.step
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


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 99), st.sampled_from([1e-30, 1e-4, 1.0, 1e6, 1e30]), st.sampled_from([1e-7, 1e-3, 1.0]))
def test_radiance_and_error_come_back_to_eleven_bits_of_their_own(seed, scale, error):
    test, reference = images(np.random.default_rng(seed), scale=scale, error=error)
    found = decoded(pack(test, reference))
    for c, name in enumerate("RGB"):
        for key, true in (("", reference.mean[..., c]), ("d", test.mean[..., c] - reference.mean[..., c])):
            top = np.abs(true).max()
            assert np.all(np.abs(found[key + name] - true) <= np.abs(true) * 2.0**-11 + top * 2.0**-38)


@pytest.mark.parametrize("shape", [(20, 30), (1, 9), (9, 1), (1, 1)])
def test_ids_come_back_exactly_and_depths_to_a_4095th_of_the_largest(shape):
    test, reference = images(np.random.default_rng(1), *shape)
    found = decoded(pack(test, reference))
    np.testing.assert_array_equal(found["id"], reference.surface.ids)
    np.testing.assert_array_equal(found["id"] + found["did"], test.surface.ids)
    step = max(reference.surface.depth.max(), test.surface.depth.max()) / 4095
    np.testing.assert_allclose(found["depth"], reference.surface.depth, atol=0.51 * step)
    np.testing.assert_allclose(found["depth"] + found["ddepth"], test.surface.depth, atol=0.51 * step)


def test_noise_is_kept_to_a_sixteenth_of_its_sigma_and_sigma_to_six_bits():
    rng = np.random.default_rng(6)
    sigma = (10.0 ** rng.uniform(-3, 0, (40, 50, 3))).astype(np.float32)
    sigma[:4] = 0
    mean = rng.random(sigma.shape, np.float32)
    test = Image((mean + sigma * rng.normal(size=sigma.shape)).astype(np.float32), 0.75 * sigma**2, 16)
    reference = Image(mean, 0.25 * sigma**2, 48)
    found = decoded(pack(test, reference))
    for c, name in enumerate("RGB"):
        np.testing.assert_allclose(found["s" + name], sigma[..., c], rtol=2.0**-6)
        error = test.mean[..., c] - mean[..., c]
        for key, true in (("", mean[..., c]), ("d", error)):
            assert np.all(np.abs(found[key + name] - true) <= found["s" + name] / 16 + np.abs(true) * 2.0**-11 + 1e-9)
    plain = pack(Image(test.mean), Image(reference.mean))
    noisy = [p for p in pack(test, reference).planes if not p.name.startswith("s")]
    assert sum(len(p.data) for p in noisy) < 0.8 * sum(len(p.data) for p in plain.planes)


def test_parts_are_kept_to_a_sixteenth_of_their_noise_and_large_ones_as_means_in_which_it_cancels():
    part = np.random.default_rng(7).normal(size=(18, 19, 3)).astype(np.float32)
    kinds = []
    for sigma in (0.0, 0.5):
        ((about, words),) = raw_parts({"a": part, "none": 0 * part}, 3, {"a": sigma})
        assert [about[k] for k in ("name", "step", "columns", "lines")] == ["a", 3, 19, 18]
        for c, (plane, data) in enumerate(zip(about["planes"], words, strict=True)):
            found = np.ldexp(np.frombuffer(data, np.float16).reshape(18, 19).astype(float), plane["shift"])
            assert (np.abs(found - part[..., c]) <= sigma / 16 + np.abs(part[..., c]) * 2.0**-11 + 1e-9).all()
            kinds.append(len(np.unique(found)))
    assert max(kinds[3:]) < 0.7 * min(kinds[:3])
    noise = 0.1 * np.random.default_rng(1).normal(size=(400, 600, 3))
    ((about, words),) = raw_parts({"large": (0.5 + noise).astype(np.float32)}, 3, {"large": 0.1})
    assert [about[k] for k in ("step", "columns", "lines")] == [6, 300, 200]
    red = np.ldexp(np.frombuffer(words[0], np.float16).astype(float), about["planes"][0]["shift"])
    assert red.std() == pytest.approx(0.05, rel=0.03)  # of 4 pixels each; five standard errors
    assert len(np.unique(red)) < 200  # digits below the noise are left out


def test_values_that_are_not_finite_stay_so():
    test, reference = images(np.random.default_rng(2))
    test.mean[3, 4] = np.nan, np.inf, -np.inf
    found = decoded(pack(test, reference))
    assert np.isnan(found["dR"][3, 4])
    assert found["dG"][3, 4] == np.inf
    assert found["dB"][3, 4] == -np.inf
    assert np.isfinite(found["dR"]).sum() == found["dR"].size - 1


@pytest.mark.parametrize("limits", [{"budget": 2000}, {"most_pixels": 100}])
def test_beyond_the_budget_each_block_keeps_the_pixel_that_errs_most(limits):
    test, reference = images(np.random.default_rng(3), 40, 61)
    test.mean[7, 11, 1] += 5
    test.mean[20, 60, 2] = np.nan
    values = pack(test, reference, **limits)
    n = values.thin
    assert n > 1
    found = decoded(values)
    assert found["dG"][7 // n, 11 // n] == pytest.approx(5, abs=0.01)
    assert np.isnan(found["dB"][20 // n, 60 // n])
    y, x = np.mgrid[: values.lines, : values.columns]
    at = found["at"].astype(int)
    rows, columns = y * n + at // n, x * n + at % n
    np.testing.assert_array_equal(found["id"], reference.surface.ids[rows, columns])
    worst = np.nan_to_num(np.abs(test.mean - reference.mean).max(axis=-1), nan=np.inf)
    for r, c in ((0, 0), (values.lines - 1, values.columns - 1), (2, 3)):
        block = worst[r * n : r * n + n, c * n : c * n + n]
        assert worst[rows[r, c], columns[r, c]] >= 0.999 * block.max()  # the halves' rounding may tie
    assert sum(len(p.data) for p in values.planes) < sum(len(p.data) for p in pack(test, reference).planes)


def test_binned_images_are_means_of_blocks_with_the_variance_of_means():
    rng = np.random.default_rng(9)
    image = Image(rng.random((5, 7, 3), np.float32), rng.random((5, 7, 3), np.float32), 4)
    small = binned(image, 3)
    assert small.shape == (2, 3, 3)
    np.testing.assert_allclose(small.mean[0, 1], image.mean[:3, 3:6].mean(axis=(0, 1)), rtol=1e-6)
    np.testing.assert_allclose(small.variance[0, 1], image.variance[:3, 3:6].sum(axis=(0, 1)) / 81, rtol=1e-6)
    np.testing.assert_allclose(small.mean[1, 2], image.mean[3:, 6:].mean(axis=(0, 1)), rtol=1e-6)
    np.testing.assert_allclose(small.variance[1, 2], image.variance[3:, 6:].sum(axis=(0, 1)) / 4, rtol=1e-6)
    packed = pack(image, image, most_pixels=4)
    assert (packed.binned, packed.thin) == (True, 3)
