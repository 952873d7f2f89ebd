import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raytwin.compare import compare
from raytwin.compare.geometry import geometry_findings
from raytwin.compare.shift import Shift, _lit, _overlap, find_shift
from raytwin.images.image import Image, Surface
from raytwin.images.image_formats import read_image
from raytwin.scene import Tolerance

H, W = 60, 80
MEAN = np.full((H, W, 3), 0.5, np.float32)


def surface():
    """A ball's disc on the background: depth and normals of an orthographic view."""
    y, x = np.mgrid[:H, :W]
    u, v = (x - 40) / 25, (y - 30) / 25
    inside = u * u + v * v < 0.98
    z = np.sqrt(np.where(inside, 1 - u * u - v * v, 0))
    normal = np.where(inside[..., None], np.stack([u, -v, z], -1), 0).astype(np.float32)
    return Surface(np.where(inside, 0, -1).astype(np.int32), np.where(inside, 2 - z, 0).astype(np.float32), normal)


def judged(test, tolerance=None):
    return geometry_findings(Image(MEAN, surface=test), Image(MEAN, surface=surface()), tolerance or Tolerance())


def test_the_same_surface_has_no_geometric_error():
    geometry, found = judged(surface())
    assert (geometry.mask_mismatch_pixels, geometry.depth_max_rel) == (0, 0)
    assert geometry.normal_max_deg == pytest.approx(0, abs=1e-4)
    assert not found


def test_silhouette_pixels_are_counted_against_the_tolerance_and_located():
    s = surface()
    s.ids[30, 10:13] = 4
    geometry, found = judged(s)
    assert geometry.mask_mismatch_pixels == 3
    assert "3 pixels see another object (allowed 0)" in found[0].text
    assert "(x=10, y=30), where the test sees object 4, the reference the background" in found[0].text
    assert not judged(s, Tolerance(mask_pixels=3))[1]
    assert judged(s, Tolerance(mask_pixels=2))[1]


def test_a_tolerated_silhouette_pixel_may_have_another_radiance_too():
    s, mean = surface(), MEAN.copy()
    s.ids[30, 10] = 4
    mean[30, 10] = 0.9
    pair = Image(mean, surface=s), Image(MEAN, surface=surface())
    assert compare(*pair, tolerance=Tolerance(mask_pixels=1)).passed
    assert not compare(*pair).passed


def wedge(edge: int) -> Surface:
    """Two planes that meet in a column of pixels, where both are equally far."""
    x = np.broadcast_to(np.arange(W), (H, W))
    normal = np.where((x < edge)[..., None], (0.6, 0, 0.8), (-0.6, 0, 0.8)).astype(np.float32)
    return Surface((x >= edge).astype(np.int32), (2 + 0.01 * np.abs(x - 40)).astype(np.float32), normal)


def test_on_the_common_edge_of_two_objects_either_answer_is_right_and_is_counted():
    test, reference = wedge(41), wedge(40)
    mean = np.where((test.ids == 0)[..., None], np.float32(0.5), np.float32(0.3)) * np.ones(3, np.float32)
    shown = np.where((reference.ids == 0)[..., None], np.float32(0.5), np.float32(0.3)) * np.ones(3, np.float32)
    c = compare(Image(mean, surface=test), Image(shown, surface=reference))
    assert c.verdict == "pass"
    assert c.geometry.mask_mismatch_pixels == 0
    assert c.reasons[-1].startswith("60 pixels on the common edge of two objects")
    assert compare(Image(mean), Image(shown)).verdict == "fail"  # without surfaces nobody knows


@pytest.mark.parametrize("wrong", ["nearer", "named otherwise", "another object"])
def test_no_other_pixel_is_taken_for_a_tie(wrong):
    test, reference = wedge(41), wedge(40)
    if wrong == "nearer":
        test.depth[:, 40] *= np.float32(1 - 1.1e-4)
    elif wrong == "named otherwise":
        test.ids[:] = 1 - reference.ids
    else:
        test.ids[:, 40] = 7
    c = compare(Image(MEAN, surface=test), Image(MEAN, surface=reference))
    assert c.verdict == "fail"
    assert "see another object" in c.reasons[0]


def test_relative_depth_is_measured_where_both_see_the_same_object():
    s = surface()
    s.depth[:] *= np.float32(1.01)
    s.ids[0, 0] = 7
    s.depth[0, 0] = 1e6
    geometry, found = judged(s, Tolerance(mask_pixels=1))
    assert geometry.depth_max_rel == pytest.approx(0.01, rel=1e-4)
    assert found[0].text.startswith("depth: ")


@pytest.mark.parametrize("degrees", [1e-4, 0.05, 1.0, 90.0, 180.0])
def test_a_turned_normal_has_the_angle_it_was_turned_by(degrees):
    s, a = surface(), np.radians(degrees)
    x, y, z = np.moveaxis(s.normal.astype(float), -1, 0)
    turned = np.stack([np.cos(a) * x - np.sin(a) * y, np.sin(a) * x + np.cos(a) * y, z], -1)
    s.normal[:] = turned
    s.normal[30, 20:25] = surface().normal[30, 20:25]
    geometry, found = judged(s)
    # Turning about z moves a normal by asin(sin(a / 2) sin(theta)) twice; the rim's theta is near 90 degrees.
    rim = np.hypot(x, y).max()
    assert geometry.normal_max_deg == pytest.approx(np.degrees(2 * np.arcsin(np.sin(a / 2) * rim)), rel=2e-2, abs=2e-5)
    assert bool(found) == (degrees > 0.1)


def test_a_depth_that_is_not_a_number_fails_and_is_located():
    s = surface()
    s.depth[30, 41] = np.nan
    c = compare(Image(MEAN, surface=s), Image(MEAN, surface=surface()))
    assert not c.passed
    assert "depth of 1 pixel is not a number, first at (x=41, y=30)" in c.reasons[0]


def test_a_surface_of_another_size_fails():
    s = Surface(*(a[:-1] for a in (surface().ids, surface().depth, surface().normal)))
    c = compare(Image(MEAN, surface=s), Image(MEAN, surface=surface()))
    assert not c.passed
    assert "surface" in c.reasons[0]


def discs(dx=0.0, dy=0.0, h=96, w=128):
    """Antialiased discs, moved by (dx, dy)."""
    y, x = np.mgrid[:h, :w]
    mean = np.full((h, w), 0.2)
    for cx, cy, r, value in ((50, 40, 22, 0.8), (95, 60, 15, 0.5), (30, 75, 9, 1.0)):
        cover = np.clip(r + 0.5 - np.hypot(x - cx - dx, y - cy - dy), 0, 1)
        mean = mean * (1 - cover) + value * cover
    return np.repeat(mean[..., None], 3, -1).astype(np.float32)


@settings(deadline=None, max_examples=25)
@given(st.floats(-6, 6), st.floats(-6, 6))
def test_a_shift_of_several_pixels_is_found_to_a_twentieth(dx, dy):
    s = find_shift(discs(dx, dy), discs())
    assert s.dx == pytest.approx(dx, abs=0.05)
    assert s.dy == pytest.approx(dy, abs=0.05)


@pytest.mark.parametrize("shift", [0.02, 0.1, 0.5, 0.9])
def test_a_subpixel_shift_is_found_to_an_eighth_of_itself_whatever_the_brightness(shift):
    s = find_shift(1.3 * discs(shift, -shift) + 0.1, discs())
    assert s.dx == pytest.approx(shift, rel=0.125)
    assert s.dy == pytest.approx(-shift, rel=0.125)


def test_a_large_image_is_reduced_and_its_shift_given_in_its_own_pixels():
    big = [np.repeat(np.repeat(discs(k), 4, 0), 4, 1) for k in (0.25, 0)]
    assert find_shift(*big, most_pixels=20_000).dx == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    "flat", [MEAN, np.broadcast_to(np.linspace(0, 1, W, dtype=np.float32)[None, :, None], MEAN.shape)]
)
def test_an_image_without_detail_in_both_directions_has_no_shift(flat):
    assert find_shift(np.array(flat), np.array(flat)) is None


def test_two_different_pictures_have_no_shift_of_pixels():
    s = find_shift(np.ascontiguousarray(discs()[:, ::-1]), discs())
    assert s is None or s.length < 1


def test_a_shifted_image_fails_with_the_shift_before_the_radiance():
    c = compare(Image(discs(0.1)), Image(discs()))
    assert not c.passed
    assert c.geometry.shift_px == pytest.approx(0.1, rel=0.1)
    assert c.reasons[0].startswith("the test image is shifted by (+0.10")


@pytest.mark.parametrize(
    ("length", "sigma", "explained", "light", "better", "significant", "certain"),
    [
        (0.5, 0.01, 0.8, 0.7, True, True, True),
        (0.5, 0.01, 0.7, 0.8, False, True, False),
        (0.5, 0.01, 0.4, 0.3, True, True, False),  # what is left is more
        (1.5, 0.01, 0.1, 0.9, True, True, True),  # of whole pixels, no light explains it
        (0.5, 0.11, 0.8, 0.7, True, False, False),  # 4.5 sigma
        (0.019, 0.001, 0.8, 0.7, True, False, False),
        (0.021, 0.001, 0.8, 0.7, True, True, True),
    ],
)
def test_what_a_shift_says_of_itself(length, sigma, explained, light, better, significant, certain):
    shift = Shift(0.6 * length, -0.8 * length, sigma, 100.0, explained, light)
    assert (shift.better_than_light, shift.significant, shift.certain) == (better, significant, certain)


@pytest.mark.parametrize("dx", [-3, 0, 2])
@pytest.mark.parametrize("dy", [-2, 0, 1])
def test_the_overlap_of_an_image_and_itself_moved_is_the_same_in_both(dx, dy):
    r, t = np.random.default_rng(2).random((9, 11)), np.full((9 + 6, 11 + 6), np.nan)
    t[3 + dy : 12 + dy, 3 + dx : 14 + dx] = r
    a, b = _overlap(t[3:12, 3:14], r, dx, dy)
    assert a.shape == (9 - abs(dy), 11 - abs(dx))
    assert np.array_equal(a, b)


def test_what_light_explains_does_not_depend_on_the_scale():
    d, m = np.random.default_rng(4).random((2, 40, 50))
    assert _lit(1e-3 * d, 1e-3 * m) == pytest.approx(1e-6 * _lit(d, m), rel=1e-12)
    assert _lit(0.3 * m, m) == pytest.approx(np.square(0.3 * m).sum(), rel=1e-12)


def test_shadows_that_are_missing_are_not_told_as_a_shift(scenes):
    """The overlap scene's references carry no surface: that nothing moved must be read off the radiance."""
    lit, shaded = (
        read_image(scenes.parent / "reference" / "overlap" / f"{rung}.exr") for rung in ("lambert", "shadow")
    )
    found = find_shift(lit.mean, shaded.mean)
    assert found.length > 0.3
    assert found.significant
    assert not found.better_than_light
    c = compare(lit, shaded)
    assert c.geometry.shift_px is None
    assert not any("shift" in reason for reason in c.reasons)
