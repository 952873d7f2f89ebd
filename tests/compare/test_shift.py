"""The translation between two images: to which part of a pixel, under noise, and what is none."""

import numpy as np
import pytest
from measure.noise_models import render

from raytwin.compare import compare
from raytwin.compare.shift import find_shift
from raytwin.compare.significance import two_sided
from raytwin.images.image import Image
from raytwin.images.image_formats import read_image


def discs(dx=0.0, dy=0.0, h=96, w=128):
    """Antialiased discs, moved by (dx, dy)."""
    y, x = np.mgrid[:h, :w]
    mean = np.full((h, w), 0.2)
    for cx, cy, r, value in ((50, 40, 22, 0.8), (95, 60, 15, 0.5), (30, 75, 9, 1.0)):
        cover = np.clip(r + 0.5 - np.hypot(x - cx - dx, y - cy - dy), 0, 1)
        mean = mean * (1 - cover) + value * cover
    return np.repeat(mean[..., None], 3, -1).astype(np.float32)


def test_a_shift_is_found_to_a_twentieth_and_to_an_eighth_of_itself_whatever_the_brightness_and_size():
    for whole in ((-5.7, 3.2), (0.4, 6.0), (2.5, -1.5)):
        s = find_shift(discs(*whole), discs())
        assert (s.dx, s.dy) == pytest.approx(whole, abs=0.05), whole
    for shift in (0.02, 0.1, 0.5, 0.9):
        s = find_shift(1.3 * discs(shift, -shift) + 0.1, discs())
        assert (s.dx, s.dy) == pytest.approx((shift, -shift), rel=0.125), shift
    big = [np.repeat(np.repeat(discs(k), 4, 0), 4, 1) for k in (0.25, 0)]
    assert find_shift(*big, most_pixels=20_000).dx == pytest.approx(1.0, abs=0.1)


def test_an_image_without_detail_in_both_directions_has_no_shift_nor_have_two_different_pictures():
    for flat in (np.full((60, 80, 3), 0.5), np.linspace(0, 1, 80)[None, :, None] + np.zeros((60, 80, 3))):
        assert find_shift(flat.astype(np.float32), flat.astype(np.float32)) is None
    s = find_shift(np.ascontiguousarray(discs()[:, ::-1]), discs())
    assert s is None or s.length < 1


def test_a_shifted_image_fails_with_the_shift_before_the_radiance():
    c = compare(Image(discs(0.1)), Image(discs()))
    assert not c.passed
    assert c.geometry.shift_px == pytest.approx(0.1, rel=0.1)
    assert c.reasons[0].startswith("the test image is shifted by (+0.10")


def test_shadows_that_are_missing_are_not_told_as_a_shift(scenes):
    """The overlap scene's references carry no surface: that nothing moved must be read off the radiance."""
    folder = scenes.parent / "reference" / "overlap"
    lit, shaded = (read_image(folder / f"{rung}.exr") for rung in ("lambert", "shadow"))
    found = find_shift(lit.mean, shaded.mean)
    assert found.length > 0.3
    assert found.significant
    assert not found.better_than_light
    c = compare(lit, shaded)
    assert c.geometry.shift_px is None
    assert not any("shift" in reason for reason in c.reasons)


def wave(dx: float = 0.0) -> np.ndarray:
    y, x = np.mgrid[:48, :64]
    return (0.5 + 0.2 * np.sin((x - dx) / 3) + 0.2 * np.sin(y / 4))[..., None] * np.array([1, 0.8, 0.6])


def test_noise_is_seldom_taken_for_a_shift():
    """At a level of 1 %, at most 7 of 100 correct pairs: chance exceeds that once in 100 000 times."""
    for kind in ("gauss", "exp"):
        rng, wrong = np.random.default_rng([8, len(kind)]), 0
        for _ in range(100):
            shift = find_shift(*(render(rng, wave(), samples=n, kind=kind, sd=1.0).mean for n in (16, 256)))
            wrong += float(two_sided(max(abs(shift.dx), abs(shift.dy)) / shift.sigma, shift.dof)) < 0.005
        assert wrong <= 7, kind


def test_a_shift_of_a_quarter_of_a_pixel_is_seen_through_noise():
    rng = np.random.default_rng(16)
    reference = render(rng, wave(), samples=16384, kind="exp", sd=1.0)
    for _ in range(3):
        found = compare(render(rng, wave(0.25), samples=64, kind="exp", sd=1.0), reference)
        assert found.reasons[0].startswith("the test image is shifted by (+0.2")
