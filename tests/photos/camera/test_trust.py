"""What a calibration says of itself holds: its sigmas, the board's bend, and which photo or board is at fault."""

import re

import cv2
import msgspec
import numpy as np
import pytest
from photo_helpers import BOARD, SMALL, a_camera, seen

from raytwin.photos.boards import Board, BoardTag, Grid
from raytwin.photos.camera import (
    calibrate_detections,
    lens_model,
    pose_of_tags,
)
from raytwin.photos.camera.fit import Fit, ModelSpec, fit, matched
from raytwin.photos.camera.model import covariance
from raytwin.photos.synthetic_photos import bow_of, poses

pytestmark = pytest.mark.nightly

SIZE = (1008, 756)
FOUR = ("fx", "fy", "cx", "cy")


def four(found) -> np.ndarray:
    return np.array([found.K[0][0], found.K[1][1], found.K[0][2], found.K[1][2]])


def views(
    seed: int = 0, count: int = 12, noise=0.1, bend: float = 0.0, camera=None, breath: float = 0.0, pool=()
) -> tuple:
    """A camera, where it stood, and what it sees from there of a board bent by `bend`; `noise` px, one or by view.

    `breath`: the focal length's standard deviation from view to view, as a share of it. `pool`: what stands are drawn
    from.
    """
    camera = camera or a_camera(*SIZE)
    rng = np.random.default_rng(seed)
    stands = [pool[i] for i in rng.permutation(len(pool))[:count]] or poses(BOARD, camera, count, rng)
    tags = seen(camera, stands)
    if bend:
        centers = np.array(list(SMALL.centers().values()))
        places = dict(zip(SMALL.centers(), bow_of(SMALL, bend).bent(centers), strict=True))
        tags = {
            photo: [moved(t, lens_model.project(places[t.id][None], *stand, camera.K, camera.dist)[0]) for t in found]
            for (photo, found), stand in zip(tags.items(), stands, strict=True)
        }
    if breath:
        middle = np.array([camera.cx, camera.cy])
        tags = {
            p: [moved(t, middle + scale * (np.array(t.center) - middle)) for t in found]
            for (p, found), scale in zip(tags.items(), rng.normal(1, breath, count), strict=True)
        }
    noises = np.broadcast_to(noise, count)
    tags = {
        p: [moved(t, rng.normal(t.center, s)) for t in found]
        for (p, found), s in zip(tags.items(), noises, strict=True)
    }
    tags = {p: [t for t in found if inside(t.center)] for p, found in tags.items()}
    return camera, stands, tags


def inside(center) -> bool:
    return bool((np.array(center) > 5).all() and (np.array(center) < np.array(SIZE) - 6).all())


def moved(tag, center):
    return msgspec.structs.replace(tag, center=tuple(map(float, center)))


def sigmas(made: Fit) -> np.ndarray:
    return np.sqrt(np.diag(covariance(made, made.leave_one_out()[0]))[:4])


def but(tags: dict, photo: str) -> dict:
    return {p: found for p, found in tags.items() if p != photo}


def codes(found) -> set[str]:
    return {w.code for w in found.warnings}


# ---------------------------------------------------------------------------------- the fit, against others


def test_on_a_flat_board_the_fit_is_opencvs(real_tags, real_board):
    """cv2.calibrateCamera run until it stands still; squares are flat at their minimum, so K agrees less than they."""
    (tags, size), board = real_tags("april_fine"), real_board("fine")
    known = {p: [t for t in found if t.id in board.centers()] for p, found in tags.items()}
    points = [board.points(t.id for t in of).astype(np.float32) for of in known.values()]
    pixels = [np.array([t.center for t in of], np.float32) for of in known.values()]
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-12)
    rms, K, dist, *_ = cv2.calibrateCamera(points, pixels, size, None, None, criteria=criteria)
    found = fit(known, size, board, ModelSpec("full5"))
    assert rms * (1 - 2e-5) < found.rms_px < rms * (1 + 1e-7)
    assert np.abs(found.K - K).max() < 2e-4 * K[0, 0]
    assert np.allclose(found.dist, dist.ravel(), atol=0.01)


def test_the_fit_without_a_photo_is_told_without_making_it():
    _, _, tags = views(noise=0.3)
    whole = fit(tags, SIZE, SMALL, ModelSpec("k1k2"))
    moves, errors = whole.leave_one_out()
    for i, photo in ((0, "view_00"), (11, "view_11")):
        rest = fit(but(tags, photo), SIZE, SMALL, ModelSpec("k1k2"))
        assert np.allclose(moves[i][:4], (rest.shared - whole.shared)[:4], atol=0.05 * np.abs(moves[i][:4]).max())
        points, pixels = matched(tags[photo], SMALL)
        five = lens_model.five(rest.dist)
        _, turn, shift = cv2.solvePnP(points, pixels, rest.K, five)
        turn, shift = cv2.solvePnPRefineLM(points, pixels, rest.K, five, turn, shift)
        off = cv2.projectPoints(points, turn, shift, rest.K, five)[0][:, 0] - pixels
        assert errors[i] == pytest.approx(np.sqrt((off**2).sum(axis=1).mean()), rel=0.02)


# ---------------------------------------------------------------------------------- sigma


SETS = {
    "each coordinate errs alike": {},
    "some photos are blurred": {"noise": 0.1 * np.exp(np.random.default_rng(1000).normal(0, 0.7, 12))},
    "the board is bent": {"bend": 1e-3},
    "tags have other tags' ids": {},
    "the focus moves": {"breath": 1e-3},
}


def a_set(i: int, pool) -> dict:
    """The i-th of a hundred sets of photos, of SETS' kinds by turns."""
    _, _, tags = views(seed=i, pool=pool, **SETS[list(SETS)[i % 5]])
    if i % 5 == 3:
        for found in tags.values():
            found[2], found[7] = moved(found[2], found[7].center), moved(found[7], found[2].center)
    return tags


def test_over_a_hundred_sets_the_truth_lies_as_far_off_as_sigma_says():
    """z = (found - true) / sigma of fx, fy, cx, cy.

    fx and fy err together, and sigma is known to a fifth: 20 sets of a kind are worth 25 independent draws. Were sigma
    true, a kind's rms z were 1 ± 0.14, and outside 0.55 and 1.6 for less than one seed in a thousand, by chi-squared;
    of all together, 125 draws, outside 0.75 and 1.3.
    """
    camera, z = a_camera(*SIZE), []
    pool = poses(BOARD, camera, 60, np.random.default_rng(0))
    for i in range(100):
        tags = a_set(i, pool)
        if i % 5 == 3:
            found = calibrate_detections(tags, SIZE, SMALL, "k1k2")
            K, sigma = found.K, [found.sigma[n] for n in FOUR]
        else:  # what `calibrate_detections` ends in, without what it need not find out here
            made = fit(tags, SIZE, SMALL, ModelSpec("k1k2", i % 5 == 2))
            K, sigma = made.K, sigmas(made)
        off = np.array([K[0][0], K[1][1], K[0][2], K[1][2]]) - (camera.fx, camera.fy, camera.cx, camera.cy)
        z.append(off / sigma)
    z = np.array(z)
    by_kind = [np.sqrt((z[kind::5] ** 2).mean()) for kind in range(5)]
    assert min(by_kind) > 0.55, by_kind
    assert max(by_kind) < 1.6, by_kind
    assert 0.75 < np.sqrt((z**2).mean()) < 1.3
    assert 0.88 < (np.abs(z) < 2).mean() < 0.99


def test_few_photos_that_disagree_lie_as_far_off_as_sigma_says():
    """The focus moves by 0.3 % from photo to photo: sigma of 4, 6 and 8 photos, 40 sets each.

    Of 120 draws of some three independent numbers the median of |z| / 0.674 is 1 ± 0.07 where sigma is true.
    """
    camera, z = a_camera(*SIZE), []
    pool = poses(BOARD, camera, 60, np.random.default_rng(0))
    for count in (4, 6, 8):
        for i in range(40):
            _, _, tags = views(seed=i, count=count, pool=pool, breath=3e-3)
            made = fit(tags, SIZE, SMALL, ModelSpec("k1k2"))
            z.append((made.shared[:4] - (camera.fx, camera.fy, camera.cx, camera.cy)) / sigmas(made))
    assert 0.75 < np.median(np.abs(z)) / 0.6745 < 1.22
    assert np.sqrt(np.mean(np.square(z))) < 1.55


def test_large_tags_on_a_sheet_that_bends_on_beyond_them_leave_k_within_sigma():
    """Four rows tell no fourth degree: a polynomial that goes on to the outermost edges puts fx 4 sigma off."""
    board, camera = Board("tag36h11", 0.020, Grid(4, 4, 0.027)), a_camera(*SIZE)
    rng, tags = np.random.default_rng(5), {}
    for i, stand in enumerate(poses(board, camera, 12, rng)):
        (found,) = seen(camera, [stand], board).values()
        at = dict(zip(board.centers(), rng.normal(crossings(2e-3, camera, stand, board), 0.03), strict=True))
        tags[f"view_{i:02d}"] = [moved(tag, at[tag.id]) for tag in found if inside(at[tag.id])]
    found = calibrate_detections(tags, SIZE, board, "k1k2")
    assert found.board.bend_mm == pytest.approx(2, rel=0.1)
    off = four(found) - (camera.fx, camera.fy, camera.cx, camera.cy)
    assert np.abs(off / [found.sigma[n] for n in FOUR]).max() < 3
    assert np.abs(off[:2]).max() < 4


def test_sigma_is_the_larger_of_the_jackknifes_and_that_of_errors_alike():
    """By fits without each photo: of a focus that moves, fx and fy are known worse than their tags say, others not."""
    _, _, tags = views(noise=0.1, breath=1e-3)
    found = fit(tags, SIZE, SMALL, ModelSpec("k1k2"))
    alike = found.variance * np.linalg.inv(found.total[:6, :6])
    without = [fit(but(tags, photo), SIZE, SMALL, ModelSpec("k1k2")).shared[:6] for photo in tags]
    V = 11 / 12 * ((np.array(without) - found.shared[:6]) ** 2).sum(axis=0)
    wider = np.sqrt(np.maximum(V / np.diag(alike), 1))
    assert (wider[:2] > 2).all()
    made = covariance(found, found.leave_one_out()[0])
    np.testing.assert_allclose(made[:6, :6], alike * np.outer(wider, wider), rtol=0.1)
    assert not made[6:].any()


# ---------------------------------------------------------------------------------- the board's own shape


def crossings(bend: float, camera, stand, board: Board = BOARD) -> np.ndarray:
    """(n, 2) pixels: where the diagonals cross of straight lines through bent tags' edges."""
    s, one = np.linspace(-0.767, 0.767, 5), np.ones(5)
    around = np.stack([np.c_[s, -one], np.c_[one, s], np.c_[-s, one], np.c_[-one, -s]]) * board.tag_edge / 2
    flat = np.array(list(board.centers().values()))[:, None, None] + around
    edges = bow_of(board, bend).bent(flat.reshape(-1, 2))
    pixels = lens_model.project(edges, *stand, camera.K, camera.dist).reshape(-1, 4, 5, 2)
    middle = pixels.mean(axis=2)
    along = np.linalg.svd(pixels - middle[:, :, None])[2][:, :, 0]
    line = np.cross(np.insert(middle, 2, 1, axis=-1), np.insert(along, 2, 0, axis=-1))
    corner = np.cross(np.roll(line, 1, axis=1), line)
    found = np.cross(np.cross(corner[:, 0], corner[:, 2]), np.cross(corner[:, 1], corner[:, 3]))
    return found[:, :2] / found[:, 2:]


def test_on_a_bent_board_the_camera_lies_as_far_off_as_sigma_says():
    """z of fx, fy, cx, cy of five sets: fx and fy err as one, so 15 independent draws.

    Were sigma true, their rms were above 1.6, and the mean of fx beyond 3.3 of its own deviation, once in a thousand.
    """
    camera, z = a_camera(*SIZE), []
    for seed, bend in enumerate((0.5, 1.0, 3.0, 1.0, 0.5)):
        rng = np.random.default_rng(seed)
        tags = {}
        for i, stand in enumerate(poses(BOARD, camera, 12, rng)):
            (found,) = seen(camera, [stand], BOARD).values()
            at = dict(zip(BOARD.centers(), rng.normal(crossings(1e-3 * bend, camera, stand), 0.05), strict=True))
            tags[f"{i}"] = [moved(t, at[t.id]) for t in found if inside(at[t.id])]
        found = calibrate_detections(tags, SIZE, BOARD, "k1k2")
        assert found.board.bend_mm == pytest.approx(bend, abs=0.06)
        assert found.basis.taken == "k1k2, bent"
        off = four(found) - (camera.fx, camera.fy, camera.cx, camera.cy)
        z.append(off / [found.sigma[n] for n in FOUR])
    assert np.sqrt(np.square(z).mean()) < 1.6, z
    assert np.abs(np.mean(z, axis=0)).max() * np.sqrt(5) < 3.3, z


def test_on_photos_of_a_bent_board_the_bend_and_the_camera_are_the_truth(shoot, bent_found):
    """One set in eight would have one of the four numbers beyond two of its sigmas; this seed's has none."""
    (_, truth), found = shoot(14, bend=3e-3), bent_found
    board = found.board
    assert board.bend_mm == pytest.approx(3, rel=0.02)
    true = np.array([truth.K[0][0], truth.K[1][1], truth.K[0][2], truth.K[1][2]])
    assert (np.abs(four(found) - true) < 2 * np.array([found.sigma[n] for n in FOUR])).all()
    assert codes(found) == set()
    assert truth.bend_mm == 3


# ---------------------------------------------------------------------------------- odd photos


def photo_of(camera, seed: int = 50, index: int = 1) -> list:
    return list(views(seed=seed, noise=0.1, camera=camera)[2].values())[index]


def zoomed(tags: list, share: float = 0.8) -> list:
    """Cut at a share of its sides, off the middle, and enlarged again."""
    cut = [(t, (np.array(t.center) - (60, 90)) / share) for t in tags]
    return [moved(t, at) for t, at in cut if inside(at)]


def by_another_camera(tags: list) -> list:
    other = a_camera(*SIZE, dist=(-0.05,))
    K = ((0.8 * other.fx, 0.0, 490.0), (0.0, 0.8 * other.fy, 390.0), (0.0, 0.0, 1.0))
    return photo_of(msgspec.structs.replace(other, K=K))


def upside_down(tags: list) -> list:
    return [moved(t, np.array(SIZE) - 1 - t.center) for t in tags]


@pytest.mark.parametrize(("spoil", "seed"), [(by_another_camera, 0), (zoomed, 6), (zoomed, 13), (upside_down, 13)])
def test_a_photo_at_odds_with_the_rest_is_named_and_no_other(spoil, seed):
    """The fit of all may be pulled so far that sound photos' rms is three times the median there."""
    _, _, tags = views(seed, count=14, noise=0.03)
    tags["view_05"] = spoil(tags["view_05"])
    found = calibrate_detections(tags, SIZE, SMALL, "k1k2")
    assert [re.split("[: ]", w.text)[0] for w in found.warnings if w.code in ("odd-photo", "no-tags")] == ["view_05"]


def test_a_photo_far_off_hides_no_other():
    _, _, tags = views(1, count=14, noise=0.03)
    tags["view_05"], tags["view_09"] = by_another_camera(tags["view_05"]), zoomed(tags["view_09"], 0.93)
    found = calibrate_detections(tags, SIZE, SMALL, "k1k2")
    assert sorted(w.text.split(":")[0] for w in found.warnings if w.code == "odd-photo") == ["view_05", "view_09"]


def test_a_photo_that_fits_no_camera_of_the_others_is_left_out_and_named():
    _, _, tags = views(7, count=14, noise=0.03)
    tags["view_05"] = zoomed(tags["view_05"])
    found = calibrate_detections(tags, SIZE, SMALL, "k1k2")
    assert len(found.views) == 13
    (text,) = [w.text for w in found.warnings]
    assert text.startswith("view_05 was left out: too few of its tags agree with the camera of the others")


def test_each_photo_says_how_much_it_pulls():
    """A jackknife's moves have a mean square of 1 / (n - 1) of sigma's, before small sets are drawn together."""
    _, _, tags = views(count=14)
    pulls = np.array([v.influence for v in calibrate_detections(tags, SIZE, SMALL, "k1k2").views])
    assert np.sqrt((pulls**2).mean()) == pytest.approx(1 / np.sqrt(13), rel=0.3)


# ---------------------------------------------------------------------------------- the board's description at fault


def stretched(board: Board, by: float) -> Board:
    tags = tuple(BoardTag(i, (x, y * by)) for i, (x, y) in board.centers().items())
    return Board(board.family, board.tag_edge, tags=tags)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_pitch_wrong_in_one_direction_is_doubted_and_widens_sigma(seed):
    """By 3 % in y: fx and fy of photos taken upright and sideways cannot make up for it."""
    camera, _, tags = views(count=12, seed=seed)
    found = calibrate_detections(tags, SIZE, stretched(SMALL, 1 / 1.03))
    off = four(found) - (camera.fx, camera.fy, camera.cx, camera.cy)
    assert np.abs(off / [found.sigma[n] for n in FOUR]).max() < 3
    assert found.sigma["fx"] > 5
    (text,) = [w.text for w in found.warnings if w.code == "degenerate-views"]
    assert re.search(r"tags lie 2.. % of their pitch off", text)


def test_a_mirrored_description_is_told_what_to_write():
    """An order of rows for a grid, the signs of x for a list of tags; it fits as well as the correct one."""
    camera = a_camera(*SIZE)
    down = msgspec.structs.replace(SMALL, grid=msgspec.structs.replace(SMALL.grid, order="down"))
    mirrored = Board("tag36h11", 0.001, tags=tuple(BoardTag(i, (-x, y)) for i, (x, y) in SMALL.centers().items()))
    stands = poses(msgspec.structs.replace(down, tag_edge=0.03), camera, 8, np.random.default_rng(1))
    both = {SMALL: views(count=8)[2], down: seen(camera, stands, down)}
    cases = (SMALL, down, 'order = "up"'), (down, SMALL, 'order = "down"'), (SMALL, mirrored, "the sign of x")
    for true, written, advice in cases:
        found = calibrate_detections(both[true], SIZE, written, "k1k2")
        (text,) = [w.text for w in found.warnings if w.code == "mirrored-board"]
        assert advice in text
        assert codes(found) == {"mirrored-board"}


def test_half_the_noise_is_half_the_uncertainty():
    camera = a_camera(*SIZE)
    stands = poses(BOARD, camera, 12, np.random.default_rng(0))
    rng = [np.random.default_rng(5), np.random.default_rng(5)]
    whole, half = (
        calibrate_detections(seen(camera, stands, noise=n, rng=r), SIZE, SMALL, "k1k2").sigma
        for n, r in zip((0.2, 0.1), rng, strict=True)
    )
    assert list(half.values()) == pytest.approx([s / 2 for s in whole.values()], rel=0.03)


def test_a_photo_of_a_bent_board_is_none_of_another_board():
    """A bow of 10 mm that nobody has measured moves tags by less than half of the way to the next one."""
    for seed in range(3):
        camera, _, tags = views(seed, bend=10e-3)
        for photo, found in tags.items():
            pose_of_tags(camera.K, camera.dist, found, SMALL, photo)
