"""Of few photos all five coefficients are fitted, and from four on a bend: leave-one-out cannot choose among them."""

import numpy as np
import pytest
from photo_helpers import SMALL, a_camera
from test_trust import FOUR, SIZE, four, moved, views, zoomed

from raytwin.errors import InputError
from raytwin.photos.camera import calibrate_detections
from raytwin.photos.camera.fit import ModelSpec, fit
from raytwin.photos.camera.model import FEW_PHOTOS, covariance, select_model


@pytest.mark.parametrize(("count", "model"), [(FEW_PHOTOS - 1, "full5"), (FEW_PHOTOS, "k1k2")])
def test_auto_fits_all_coefficients_to_few_photos_and_chooses_with_more(count, model):
    _, _, tags = views(seed=1, count=count)
    found = calibrate_detections(tags, SIZE, SMALL)
    assert found.model == model


@pytest.mark.parametrize(("count", "bent"), [(3, False), (4, True)])
def test_a_bend_is_fitted_from_four_photos_on(count, bent):
    camera, _, tags = views(seed=2, count=count, bend=3e-3, noise=0.05)
    found = calibrate_detections(tags, SIZE, SMALL)
    assert (found.board.offsets is not None) == bent
    if bent:
        assert found.board.bend_mm == pytest.approx(3, rel=0.3)
        off = four(found) - (camera.fx, camera.fy, camera.cx, camera.cy)
        assert np.abs(off / [found.sigma[n] for n in FOUR]).max() < 3.5


def test_one_spoilt_photo_does_not_make_auto_fit_a_lens_too_small():
    """Its own error outweighs what a smaller lens adds to the others' in any mean over photos."""
    camera, _, tags = views(seed=3, count=9, noise=0.1)
    tags["view_04"] = [moved(t, 1.03 * np.array(t.center) - 12) for t in zoomed(tags["view_04"], 1.0)]
    tags["view_04"] = [t for t in tags["view_04"] if 5 < t.center[0] < SIZE[0] - 6 and 5 < t.center[1] < SIZE[1] - 6]
    found = calibrate_detections(tags, SIZE, SMALL)
    assert found.model == "full5"
    assert abs(found.K[0][2] - camera.cx) < 3 * found.sigma["cx"]


def test_how_far_models_that_predict_alike_lie_apart_goes_into_sigma():
    """Two models a apart with equal errors: the mean square of 0 and a, of each number."""
    _, _, tags = views(seed=1, count=6)
    start = fit(tags, SIZE, SMALL, ModelSpec("k1k2"))
    taken, errors, gap = select_model(tags, SIZE, SMALL, "auto", start)
    assert taken.form.model == "full5"
    fits = {n: fit(tags, SIZE, SMALL, ModelSpec(n.split(",")[0], "bent" in n), taken) for n in errors}
    cx = [fits[n].shared[2] - taken.shared[2] for n, e in errors.items() if e <= 1.1 * min(errors.values())]
    assert len(cx) > 2
    assert gap[2, 2] == pytest.approx(np.mean(np.square(cx)), rel=1e-3)
    moves, _ = taken.leave_one_out()
    known, wide = covariance(taken, moves), covariance(taken, moves, gap)
    np.testing.assert_allclose(wide[:9, :9], known[:9, :9] + gap)


def test_a_small_lens_of_many_photos_is_no_surer_of_the_centre_than_the_richest_lets_it_be():
    """p1 and p2 of 2e-4 predict next to nothing and are left out; the centre then lies half a pixel off."""
    camera, z = a_camera(*SIZE, dist=(0.08, -0.16, -2e-4, -2e-4)), []
    for seed in (1, 2, 3):
        _, _, tags = views(seed=seed, count=14, camera=camera)
        found = calibrate_detections(tags, SIZE, SMALL)
        assert found.model == "k1k2"
        z.append((four(found) - (camera.fx, camera.fy, camera.cx, camera.cy)) / [found.sigma[n] for n in FOUR])
    assert np.abs(z).max() < 3
    assert np.abs(z).max() > 0.5


def _burst(tags: dict, copies: int = 4, shake: float = 1.0) -> dict:
    """Each view `copies` times, with the errors of its own detections and moved by the hand (px)."""
    rng = np.random.default_rng(9)
    return {
        f"{photo}_{k}": [moved(t, np.array(t.center) + shift + rng.normal(0, 0.02, 2)) for t in found]
        for photo, found in tags.items()
        for k, shift in enumerate(rng.normal(0, shake, (copies, 2)))
    }


@pytest.mark.parametrize("shake", [0.0, 1.0])
def test_a_burst_of_each_view_says_no_more_than_one_photo_of_it(shake):
    """What pulls a view's tags is the same in its copies, so that sigma of four copies was half and less."""
    _, _, tags = views(seed=1, count=5, noise=0.3)
    alone, burst = (calibrate_detections(t, SIZE, SMALL) for t in (tags, _burst(tags, shake=shake)))
    for name in FOUR:
        assert burst.sigma[name] > 0.7 * alone.sigma[name]
    assert [v.photo for v in burst.views] == [f"view_{i:02d}_0" for i in range(5)]
    said = {w.code: w.text for w in burst.warnings}
    assert said["few-views"].startswith("5 photos")
    assert said["no-tags"].startswith("view_00_1, view_00_2, view_00_3 and 12 more were left out: the view of another")
    assert burst.board.bend_mm == pytest.approx(alone.board.bend_mm, abs=0.3)


def test_three_copies_of_one_photo_are_no_three_views():
    _, _, tags = views(seed=1, count=1)
    with pytest.raises(InputError, match="got 1; view_00_1: the view of another photo, as in a burst"):
        calibrate_detections(_burst(tags), SIZE, SMALL)


def test_photos_taken_one_by_one_are_all_used(real_found):
    """Even of those that are deliberately alike: the closest lie twice the limit apart."""
    for name, count in (("april_fine", 21), ("desk_tilted", 32), ("desk_degenerate", 20)):
        assert len(real_found(name).views) == count
