"""From which value on each doubt is raised: just below it none is."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from photo_helpers import BOARD, SMALL, a_camera, seen

from raytwin.calib.photos import FoundBoard, calibrate_detections
from raytwin.calib.photos.detection import Tag
from raytwin.calib.photos.doubts import doubts_about, normal_spread
from raytwin.calib.photos.fit import Form, Seen, fit
from raytwin.calib.photos.uncertainty import spread
from raytwin.calib.synthetic_photos import poses

SIZE = (1000, 800)
NEAR = 1e-3
"""So near, as a share of it, each value is asked for."""


@pytest.fixture(scope="module")
def sound() -> tuple:
    """What `doubts_about` is given of a sound set of twelve photos."""
    camera, rng = a_camera(*SIZE, dist=()), np.random.default_rng(0)
    tags = seen(camera, poses(BOARD, camera, 12, rng), noise=0.3, rng=rng)
    views = [Seen(p, tuple(t)) for p, t in tags.items()]
    found = fit(views, SIZE, [SMALL], Form("none"))
    return calibrate_detections(tags, SIZE, SMALL, "none"), found, spread(found), views, SIZE, [SMALL], {}, {}


def texts(case: tuple, code: str) -> list[str]:
    return [text for c, text in doubts_about(*case) if c == code]


def test_a_sound_case_raises_no_doubt(sound):
    assert doubts_about(*sound) == []


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(
    ("number", "limit", "said"),
    [
        ("sd of fx", 0.02 * 700, "fx = 700 ± 14"),
        ("sd of fy", 0.02 * 700, "fy = 700 ± 14"),
        ("sd of cx", 30.0, "cx is known to ± 30 px"),
        ("sd of cy", 24.0, "cy is known to ± 24 px"),
        ("fx", 714.0, "fx / fy = 1.02"),
        ("fy", 700 / 0.98, "fx / fy = 0.9"),
        ("cx", 499.5 + 120, "cx = 6"),
        ("cx", 499.5 - 120, "cx = 3"),
        ("cy", 399.5 + 96, "cy = 49"),
        ("cy", 399.5 - 96, "cy = 30"),
    ],
)
def test_numbers_of_the_camera_are_doubted_beyond_their_limits(sound, number, limit, said, side):
    value = {"fx": 700.0, "fy": 700.0, "cx": 499.5, "cy": 399.5}
    sd = dict.fromkeys(value, 1.0)
    of = sd if number.startswith("sd") else value
    # Further from what it should be: up, but for a centre that lies to the left or above.
    away = -1 if number in ("cx", "cy") and limit < value[number] else 1
    of[number[-2:]] = limit * (1 + side * away * NEAR)
    K = ((value["fx"], 0.0, value["cx"]), (0.0, value["fy"], value["cy"]), (0.0, 0.0, 1.0))
    doubted = texts((msgspec.structs.replace(sound[0], K=K, sigma=sd), *sound[1:]), "degenerate-views")
    assert [said in text for text in doubted] == [True] * (side > 0)


@pytest.mark.parametrize(("degrees", "doubted"), [(14.98, 1), (15.02, 0)])
def test_boards_are_doubted_that_lean_too_little_apart(sound, degrees, doubted):
    turn = np.radians(np.linspace(0, degrees, 12))
    R = np.array([[[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]] for a in turn])
    assert normal_spread(R) == pytest.approx(degrees)
    case = (sound[0], replace(sound[1], R=R), *sound[2:])
    assert len([t for t in texts(case, "degenerate-views") if "tilt differs by 15 degrees" in t]) == doubted


@pytest.mark.parametrize(("cells", "doubted"), [(24, 1), (25, 0)])
def test_a_frame_is_doubted_of_which_less_than_a_quarter_is_covered(sound, cells, doubted):
    """Tags in the middles of so many of the hundred cells, each photo's others in the first."""
    at = [((i % 10) * 100 + 50.0, (i // 10) * 80 + 40.0) for i in range(cells)]
    views = []
    for view in sound[3]:
        places = at + at[:1] * len(view.tags)
        views.append(replace_tags(view, places))
    case = (sound[0], *sound[1:3], views, *sound[4:])
    shown = [text for text in texts(case, "degenerate-views") if f"tags cover {cells} % of the frame" in text]
    assert len(shown) == doubted


def replace_tags(view: Seen, places: list[tuple[float, float]]) -> Seen:
    tags = tuple(Tag(t.id, p, t.corners, 1.0) for t, p in zip(view.tags, places, strict=False))
    return Seen(view.photo, tags, view.board)


@pytest.mark.parametrize(("count", "doubted"), [(7, 1), (8, 0)])
def test_fewer_than_eight_photos_are_few(sound, count, doubted):
    found = fit(sound[3][:count], SIZE, [SMALL], Form("none"))
    made = msgspec.structs.replace(sound[0], views=sound[0].views[:count])
    assert len(texts((made, found, spread(found), sound[3][:count], *sound[4:]), "few-views")) == doubted


DIAGONAL = 1e3 * float(np.linalg.norm(np.ptp(list(SMALL.centers().values()), axis=0)))


@pytest.mark.parametrize(
    ("bend", "sigma", "doubted"),
    [
        (5e-4 * DIAGONAL * (1 + NEAR), 0.001, 1), (5e-4 * DIAGONAL * (1 - NEAR), 0.001, 0),
        (2.0, 0.4999, 1), (2.0, 0.5001, 0),
    ],
)  # fmt: skip
def test_a_board_is_called_bent_beyond_its_size_and_its_sigma(sound, bend, sigma, doubted):
    made = msgspec.structs.replace(sound[0], boards=(FoundBoard(None, bend, sigma),))
    assert len(texts((made, *sound[1:]), "bent-board")) == doubted


@pytest.mark.parametrize(
    ("times", "px", "count", "doubted"),
    [
        (2.51, 1.0, 12, 1),
        (2.49, 1.0, 12, 0),
        (4.0, 0.21, 12, 1),
        (4.0, 0.19, 12, 0),
        (4.0, 1.0, 5, 1),
        (4.0, 1.0, 4, 0),
    ],
)
def test_a_photo_is_called_odd_by_its_rms_in_medians_where_pixels_tell_it_of_enough_photos(
    sound, times, px, count, doubted
):
    """All residuals of a photo alike, `px` in the odd one, a share of that in the others; none pulls K."""
    views = sound[3][:count]
    found = fit(views, SIZE, [SMALL], Form("none"))
    rms = np.full(count, px / times)
    rms[2] = px
    along = found.sights.weight[..., None] * rms[:, None, None] * [0.6, 0.8]
    known = replace(spread(found), errors=rms, moves=np.zeros((count, 4)))
    made = msgspec.structs.replace(sound[0], views=sound[0].views[:count])
    shown = texts((made, replace(found, residuals=along), known, views, *sound[4:]), "odd-photo")
    assert [text.split(" (")[0] for text in shown] == [f"view_02: its rms is {times:.1f} times the median"] * doubted


def pulling(found, known, times: dict[int, float]) -> np.ndarray:
    """Moves of each photo by as much as it may, (H - H_i)^-1 H_i (H - H_i)^-1, along its first axis; some by more."""
    C = np.linalg.pinv(known.covariance[:4, :4], hermitian=True)
    moves = []
    for own in found.H:
        rest = np.linalg.inv(found.H.sum(axis=0) - own)
        moves.append([np.sqrt(np.trace(C @ (rest @ own @ rest)) / C[0, 0]), 0, 0, 0])
    return np.array([np.multiply(move, times.get(i, 1)) for i, move in enumerate(moves)])


@pytest.mark.parametrize(("times", "doubted"), [(5.1, 1), (4.9, 0)])
def test_a_photo_is_called_odd_by_its_pull_in_medians(sound, times, doubted):
    _, found, known, *_ = sound
    odd = replace(known, moves=pulling(found, known, {5: times}), errors=np.ones(12))
    shown = texts((sound[0], found, odd, *sound[3:]), "odd-photo")
    assert [text.startswith(f"view_05: it pulls K {times:.1f} times as much") for text in shown] == [True] * doubted


def test_of_two_odd_photos_the_one_further_beyond_its_limit_is_named_first(sound):
    _, found, known, *_ = sound
    errors = np.ones(12)
    errors[2] = 2.6
    odd = replace(known, moves=pulling(found, known, {5: 10}), errors=errors)
    assert texts((sound[0], found, odd, *sound[3:]), "odd-photo")[0].startswith("view_05")
