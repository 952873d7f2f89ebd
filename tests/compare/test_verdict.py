import json
import re

import msgspec
import numpy as np
import pytest

from raytwin.compare import Comparison, Report, compare
from raytwin.images.image import Image
from raytwin.scene import Tolerance

H, W = 48, 64


def picture(h=H, w=W):
    """A soft ball on a ramp, unlike its own mirror images."""
    y, x = np.mgrid[:h, :w].astype(np.float32)
    r = np.hypot(x - 0.4 * w, y - 0.45 * h) / (0.3 * h)
    ball = 0.5 * np.sqrt(np.clip(1 - r * r, 0, 1))
    return ((0.2 + 0.3 * x / w + 0.1 * y / h + ball)[..., None] * np.array([1, 0.8, 0.6])).astype(np.float32)


P = picture()
REFERENCE = Image(P)


def verdict(mean, **options):
    return compare(Image(mean), REFERENCE, **options)


def said(comparison, pattern):
    return re.search(pattern, " ".join(comparison.reasons))


def test_the_json_has_exactly_the_designed_keys_null_where_nothing_applies():
    data = json.loads(msgspec.json.encode(Report("desk", "shadow", verdict(P)).numbers()))
    keys = "scene rung verdict reasons geometry radiance statistics perceptual ledger seconds backend"
    assert list(data) == keys.split()
    assert (data["scene"], data["rung"], data["verdict"], data["ledger"]) == ("desk", "shadow", "pass", [])
    for key, names in (
        ("geometry", "mask_mismatch_pixels depth_max_rel normal_max_deg shift_px"),
        ("radiance", "max_abs p999_abs rmse relmse relmse_trimmed mean_ratio"),
        ("statistics", "z_mean z_tile_worst pixel_fail_fraction minimum_detectable_bias minimum_detectable_tile_bias "
                       "looks samples_to_certainty noise_of_samples"),
        ("perceptual", "flip_mean"),
        ("seconds", "calibrate tracer twin compare"),
    ):  # fmt: skip
        assert list(data[key]) == names.split()
    assert data["seconds"]["compare"] > 0
    assert data["statistics"]["z_mean"] is None
    assert data["geometry"]["mask_mismatch_pixels"] is None
    assert msgspec.json.decode(msgspec.json.encode(verdict(P)), type=Comparison).passed


def test_an_image_passes_within_the_tolerance_and_says_how_well_it_agrees():
    """A thousandth of the values may err by more, and fails with one more; outliers are counted apart."""
    c = verdict(P.copy())
    assert c.passed
    assert c.radiance.max_abs == 0
    assert c.geometry.shift_px == pytest.approx(0, abs=1e-6)
    assert said(c, r"99\.9 %")
    assert verdict(P + np.float32(5e-6)).passed
    c = verdict(P + np.float32(1e-4))
    assert not c.passed
    assert said(c, "are off by more than the tolerance of 8.31e-06")
    for more in (0, 1):
        t = P.copy()
        t.flat[: P.size // 1000 + more] += np.float32(5e-5)
        assert verdict(t).passed == (not more)
    t = P.copy()
    t[7, 9] += np.float32(0.1)
    c = verdict(t)
    assert not c.passed
    assert said(c, r"1 pixel of 3072 is off by more than 10 times the tolerance of 8.31e-06 .*\(x=9, y=7\)")
    assert c.statistics.pixel_fail_fraction == pytest.approx(1 / (H * W))
    assert verdict(t, tolerance=Tolerance(outlier_fraction=1e-3)).passed
    half = P.astype(np.float16)
    for dtype in (np.float16, np.float64):
        assert compare(Image(half.astype(dtype)), Image(half.astype(np.float32))).passed


@pytest.mark.parametrize(
    ("value", "words"),
    [(np.nan, "1 NaN"), (np.inf, "1 infinite"), (-np.inf, "1 infinite"), (-0.5, "1 negative")],
)
def test_one_bad_value_of_an_image_or_its_variance_fails_is_counted_and_located(value, words):
    for variance in (None, np.full_like(P, 1e-3)):
        bad = P.copy()
        bad[7, 9, 1] = value
        pair = [Image(bad, variance), Image(P, variance)]
        for whose, images in (("test", pair), ("reference", pair[::-1])):
            c = compare(*images)
            assert c.verdict == "fail"
            assert c.reasons[0].startswith(f"the {whose} image has {words} value in 1 pixel, the first at (x=9, y=7)")
            json.loads(msgspec.json.encode(c))
    variance = np.full_like(P, 1e-4)
    variance[3, 4] = value
    c = compare(Image(P, variance, 16), REFERENCE)
    assert c.verdict == "fail"
    assert said(c, r"variance of the test image .*\(x=4, y=3\)")


def test_a_black_image_fails_whatever_variance_it_states():
    c = compare(Image(0 * P, np.full_like(P, 100)), REFERENCE)
    assert (c.verdict, c.reasons) == ("fail", ("the test image is all black",))


@pytest.mark.foreign
def test_what_is_no_image_of_this_size_fails_in_words():
    for mean, words in (
        (P[:-1], "64 x 47 pixels, the reference 64 x 48"),
        (P.transpose(1, 0, 2).copy(), "width and height are swapped"),
        (P[..., 0], r"shape \(48, 64\)"),
        (P[..., :2], r"shape \(48, 64, 2\)"),
        (P[:0], "shape"),
        ((255 * P).astype(np.uint8), "uint8"),
        (P.astype(complex), "complex"),
        (P.tolist(), "list"),
        (None, "NoneType"),
    ):
        c = verdict(mean)
        assert not c.passed, words
        assert said(c, words), words
    assert said(compare(Image(P, P[:-1]), REFERENCE), "variance has the shape")


def test_inputs_are_left_as_they_were():
    t, v = P + np.float32(0.1), np.full_like(P, 1e-4)
    before = t.copy(), P.copy(), v.copy()
    compare(Image(t, v, 16), Image(P, v, 16))
    for old, new in zip(before, (t, P, v), strict=True):
        assert np.array_equal(old, new)


@pytest.mark.parametrize("scale", [1e-40, 1e-3, 1, 1e37])
@pytest.mark.parametrize(("h", "w", "seed"), [(1, 1, 1), (1, 20, 2), (7, 2, 3), (20, 19, 4)])
def test_whatever_is_finite_gets_a_verdict_and_valid_json(h, w, seed, scale):
    rng = np.random.default_rng(seed)
    a, b, va, vb = (rng.random((4, h, w, 3)) * scale).astype(np.float32)
    for pair in ((Image(a), Image(b)), (Image(a, va, 4), Image(b, vb, 4)), (Image(a, va, 4), Image(b))):
        c = compare(*pair)
        assert json.loads(msgspec.json.encode(c))["findings"]
