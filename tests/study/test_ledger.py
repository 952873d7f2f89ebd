"""The ledger against closed forms, the twin, and errors that were put in."""

import math
from math import inf, pi

import msgspec
import numpy as np
import pytest
from scene_of import changed
from truths import corner, in_wedge

from raytwin import fast as fast_package
from raytwin import twin
from raytwin.explain import ledger
from raytwin.explain.ledger import WholeLight, make_ledger
from raytwin.images.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene

LIT = [name for name, row in RUNGS.items() if row.lit]


@pytest.fixture(scope="module")
def fast() -> str:
    twin.activate()
    return "drjit32"


@pytest.fixture(scope="module")
def small(overlap) -> Scene:
    return overlap.with_camera(overlap.camera.resized(64, 48))


def rows(found):
    return {part.part: part for part in found.parts}


@pytest.mark.parametrize("rung", LIT)
def test_parts_add_up_to_what_is_shown_less_the_whole_light(small, fast, rung):
    """The error's mean beside that from the twin's own path tracing: 4.5 standard errors."""
    shown = fast_package.walk(small, rung, fast, seed=9) if RUNGS[rung].noisy else fast_package.trace(small, rung, fast)
    found = make_ledger(small, shown, rung, fast)
    whole = twin.render(small, "path", sampling="area", samples=256, cache=False)
    total = sum(picture.astype(float) for picture in found.pictures.values())
    np.testing.assert_allclose(total, found.error, atol=1e-6)
    assert whole.variance is not None
    sigma = np.sqrt(whole.variance.mean(dtype=float) + rows(found)["noise"].rmse ** 2) / np.sqrt(total.size)
    assert total.mean() == pytest.approx((shown.mean - whole.mean).mean(dtype=float), abs=4.5 * sigma)
    shares = [part.share_of_error for part in found.parts if part.share_of_error is not None]
    assert sum(shares) == pytest.approx(1, abs=1e-5)
    # What a rung has is not among what it leaves out.
    left = {name for name in found.pictures if name in ledger.LIGHT_LEFT_OUT}
    assert len(left) == {"lambert": 5, "shadow": 4, "sky": 3, "path": 0}[rung]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["distorted", "wedge", "weekend", "studio"])
def test_on_every_scene_the_parts_are_the_whole_error_pixel_by_pixel(scenes, fast, name):
    """What is shown less the walks of the ledger's own seeds, to float32's rounding of a handful of sums."""
    scene = read_scene(scenes / name)
    small = scene.with_camera(scene.camera.resized(64, 48))
    shown = fast_package.trace(small, "lambert", fast)
    halves = [
        fast_package.walk(small, "path", fast, samples=ledger.SAMPLES, seed=seed, surface=False).mean
        for seed in ledger.SEEDS
    ]
    found = make_ledger(small, shown, "lambert", fast)
    total = sum(picture.astype(float) for picture in found.pictures.values())
    np.testing.assert_allclose(total, shown.mean - (halves[0] + halves[1]) / 2, atol=2e-6 * max(1, shown.mean.max()))


def test_in_a_wedge_each_part_is_its_term_of_the_series(fast):
    """90 degrees, albedo 1/2, sky of 1: 1/2 open, 1/4 occluded, bounces 1/16, 1/64 and 1/192 in all that follow."""
    scene = corner(32)
    found = make_ledger(scene, fast_package.trace(scene, "shadow", fast), "shadow", fast, depth=30)
    terms = [in_wedge(90, 0.5, 0.5, n) for n in (0, 1, 2, inf)]
    for name, missing in {
        "sky's occlusion": terms[0] - 0.5, "bounce 1": terms[1] - terms[0], "bounce 2": terms[2] - terms[1],
        "bounces 3 and more": terms[3] - terms[2],
    }.items():  # fmt: skip
        part = rows(found)[name]
        error = 4.5 * part.noise / 32 / terms[3]
        assert part.share_of_light == pytest.approx(-missing / terms[3], abs=error)
        assert part.rmse == pytest.approx(abs(missing), rel=0.08)
    assert rows(found)["numerics"].rmse < 1e-6
    assert rows(found)["pixel sampling"].rmse < 1e-6


PLANTED = {
    "what shadows take away is missing": lambda scene, fast: fast_package.trace(scene, "lambert", fast),
    "the sun's part is 3.142 = π times too bright": lambda scene, fast: fast_package.trace(
        _sun(scene, pi), "shadow", fast
    ),
    "the sun's part is missing": lambda scene, fast: fast_package.trace(_sun(scene, 0.0), "shadow", fast),
}


def _sun(scene, factor):
    sun = msgspec.structs.replace(scene.sun, irradiance=tuple(factor * x for x in scene.sun.irradiance))
    return changed(scene, lights=tuple(sun if x is scene.sun else x for x in (scene.sun, scene.sky)))


@pytest.mark.parametrize("name", PLANTED)
def test_a_fault_of_a_subject_that_fails_is_its_own_error_and_no_numerics(small, fast, name):
    found, correct = (
        make_ledger(small, shown, "shadow", fast, faulty=True)
        for shown in (PLANTED[name](small, fast), fast_package.trace(small, "shadow", fast))
    )
    named, rounding = (rows(one)["the subject's own error"].rmse for one in (found, correct))
    assert named > 0.05
    assert rounding < 1e-5
    assert rows(found)["numerics"].rmse < 1e-6
    assert rows(found)["pixel sampling"].rmse == rows(correct)["pixel sampling"].rmse
    assert sum(part.share_of_error for part in found.parts if part.share_of_error) == pytest.approx(1, abs=1e-3)


def test_of_a_sampled_level_the_subjects_error_and_its_samples_are_one_part(small, fast):
    """Bounces are missing: their light is that part's mean. No row of samples alone says that all is well."""
    shown = [fast_package.walk(small, "path", fast, samples=64, depth=depth) for depth in (8, 2)]
    right, wrong = (make_ledger(small, image, "path", fast, faulty=image is shown[1]) for image in shown)
    both = rows(wrong)["the subject's own error and its own samples"]
    assert not any(name.startswith("the subject") for name in rows(right))
    assert "its own samples" not in rows(wrong)
    missing = (shown[1].mean - shown[0].mean).mean(dtype=float)
    assert both.share_of_light == pytest.approx(missing / shown[0].mean.mean(dtype=float), rel=0.1)
    assert both.share_of_error == pytest.approx(1, abs=1e-6)


def test_a_faint_error_has_a_share_and_none_has_none(overlap, fast, monkeypatch):
    light = WholeLight(overlap.with_camera(overlap.camera.resized(8, 6)), fast)
    light.halves = light.halves[:1] * 2
    monkeypatch.setattr(ledger, "WholeLight", lambda *_: light)
    whole = np.sum([*light.halves[0].values()], axis=0, dtype=np.float32)
    for error, share in ((0, None), (1e-3, pytest.approx(1))):
        found = make_ledger(light.scene, Image(whole + np.float32(error)), "path", fast)
        assert rows(found)["its own samples"].share_of_error == share


def test_a_large_frame_is_judged_by_every_kth_pixel_with_that_pixels_own_area(overlap, fast, monkeypatch):
    small = overlap.with_camera(overlap.camera.resized(160, 120))
    shown = fast_package.trace(small, "shadow", fast)
    monkeypatch.setattr(ledger, "PIXELS_NUMPY", 160 * 120)
    whole = make_ledger(small, shown, "shadow", fast)
    monkeypatch.setattr(ledger, "PIXELS", 160 * 120 // 4)
    monkeypatch.setattr(ledger, "PIXELS_NUMPY", 160 * 120 // 4)
    thin = make_ledger(small, shown, "shadow", fast)
    assert (whole.step, thin.step) == (1, 2)
    assert thin.error.shape == (60, 80, 3)
    # The centres are the same rays: what is left of the tracer's own error is float32's rounding, no shifted picture.
    assert rows(thin)["numerics"].rmse < 1e-6
    assert rows(thin)["bounce 1"].rmse == pytest.approx(rows(whole)["bounce 1"].rmse, rel=0.2)
    assert rows(thin)["pixel sampling"].rmse == pytest.approx(rows(whole)["pixel sampling"].rmse, rel=0.5)


@pytest.mark.parametrize(("count", "most"), [(60, 1 << 16), (640, 1 << 13), (100_000, 1 << 12)])
def test_the_more_objects_a_scene_has_the_fewer_pixels_the_ledger_takes(single, monkeypatch, count, most):
    monkeypatch.setattr(ledger, "light_parts", lambda *_, **__: {})
    crowd = changed(single, objects=(single.spheres[0],) * count)
    pixels = math.prod(WholeLight(crowd, "drjit32").shape[:2])
    assert most / 4 < pixels <= most


MISSING = {
    "sky's occlusion": ["occlusion"], "bounce 1": ["bounce 1"], "bounce 2 and more": ["bounce 2", "bounce 3+"],
    "bounce 1 and more": ["bounce 1", "bounce 2", "bounce 3+"], "": [],
}  # fmt: skip


@pytest.mark.parametrize("name", MISSING)
def test_light_whose_lack_is_the_subjects_own_error_is_called_missing(small, fast, name):
    parts = fast_package.light_parts(small, fast, samples=64, seed=5)
    kept = [image.mean for part, image in parts.items() if part not in MISSING[name]]
    shown = Image(sum(kept), variance=fast_package.walk(small, "path", fast, samples=64).variance)
    assert make_ledger(small, shown, "path", fast, faulty=True).missing == name
    assert make_ledger(small, Image(0.8 * shown.mean), "path", fast, faulty=True).missing == ""
