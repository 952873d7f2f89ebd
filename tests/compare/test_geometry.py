"""Where things are seen: silhouettes, depth, normals, and edges where either answer is correct."""

import numpy as np
import pytest

from raytwin.compare import compare
from raytwin.compare.geometry import geometry_findings
from raytwin.images.image import Image, Surface
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


def test_silhouette_pixels_are_counted_against_the_tolerance_and_located():
    """Those that are tolerated may have another radiance, too."""
    geometry, found = judged(surface())
    assert (geometry.mask_mismatch_pixels, geometry.depth_max_rel, found) == (0, 0, [])
    assert geometry.normal_max_deg == pytest.approx(0, abs=1e-4)
    s, mean = surface(), MEAN.copy()
    s.ids[30, 10:13] = 4
    mean[30, 10:13] = 0.9
    geometry, found = judged(s)
    assert geometry.mask_mismatch_pixels == 3
    assert "another object is seen in 3 pixels (allowed 0)" in found[0].text
    assert "(x=10, y=30), where the test sees object 4, the reference the background" in found[0].text
    for tolerated in (2, 3):
        assert bool(judged(s, Tolerance(mask_pixels=tolerated))[1]) == (tolerated < 3)
        c = compare(Image(mean, surface=s), Image(MEAN, surface=surface()), tolerance=Tolerance(mask_pixels=tolerated))
        assert c.passed == (tolerated == 3)


def wedge(edge: int) -> Surface:
    """Two planes that meet in a column of pixels, where both are equally far."""
    x = np.broadcast_to(np.arange(W), (H, W))
    normal = np.where((x < edge)[..., None], (0.6, 0, 0.8), (-0.6, 0, 0.8)).astype(np.float32)
    return Surface((x >= edge).astype(np.int32), (2 + 0.01 * np.abs(x - 40)).astype(np.float32), normal)


def test_on_the_common_edge_of_two_objects_either_answer_is_correct_and_no_other_pixel_is_taken_for_one():
    test, reference = wedge(41), wedge(40)
    mean, shown = (np.where((s.ids == 0)[..., None], 0.5, 0.3) * np.ones(3, np.float32) for s in (test, reference))
    c = compare(Image(mean, surface=test), Image(shown, surface=reference))
    assert (c.verdict, c.geometry.mask_mismatch_pixels) == ("pass", 0)
    assert c.reasons[-1].startswith("60 pixels on the common edge of two objects")
    assert compare(Image(mean), Image(shown)).verdict == "fail"  # without surfaces nobody knows
    nearer, renamed, another = wedge(41), wedge(41), wedge(41)
    nearer.depth[:, 40] *= np.float32(1 - 1.1e-4)
    renamed.ids[:] = 1 - reference.ids
    another.ids[:, 40] = 7
    for wrong in (nearer, renamed, another):
        c = compare(Image(MEAN, surface=wrong), Image(MEAN, surface=reference))
        assert c.verdict == "fail"
        assert "another object is seen" in c.reasons[0]


def test_relative_depth_is_measured_where_both_see_the_same_object():
    s = surface()
    s.depth[:] *= np.float32(1.01)
    s.ids[0, 0] = 7
    s.depth[0, 0] = 1e6
    geometry, found = judged(s, Tolerance(mask_pixels=1))
    assert geometry.depth_max_rel == pytest.approx(0.01, rel=1e-4)
    assert found[0].text.startswith("depth: ")


@pytest.mark.parametrize("degrees", [1e-4, 0.05, 1.0, 180.0])
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


def test_a_depth_that_is_not_a_number_and_a_surface_of_another_size_fail():
    s = surface()
    s.depth[30, 41] = np.nan
    smaller = Surface(*(a[:-1] for a in (surface().ids, surface().depth, surface().normal)))
    for wrong, words in ((s, "depth of 1 pixel is not finite, first at (x=41, y=30)"), (smaller, "surface")):
        c = compare(Image(MEAN, surface=wrong), Image(MEAN, surface=surface()))
        assert not c.passed
        assert words in c.reasons[0]
