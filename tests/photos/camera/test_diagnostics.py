"""From which value on each doubt is raised: just below it none is."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from photo_helpers import BOARD, SMALL, a_camera, seen

from raytwin.photos.camera import Calibration, calibrate_detections
from raytwin.photos.camera.detection import Tag
from raytwin.photos.camera.diagnostics import degenerate, normal_spread, warnings_for
from raytwin.photos.camera.fit import Fit, ModelSpec, fit
from raytwin.photos.synthetic_photos import poses

SIZE = (1000, 800)
NEAR = 1e-3
"""So near, as a share of it, each value is asked for."""


@pytest.fixture(scope="module")
def sound() -> tuple[dict[str, list[Tag]], Calibration, Fit]:
    """A sound set of twelve photos."""
    camera, rng = a_camera(*SIZE, dist=()), np.random.default_rng(0)
    tags = seen(camera, poses(BOARD, camera, 12, rng), noise=0.3, rng=rng)
    return tags, calibrate_detections(tags, SIZE, SMALL, "none"), fit(tags, SIZE, SMALL, ModelSpec("none"))


def test_fewer_than_eight_photos_are_few_and_a_sound_case_raises_no_doubt(sound):
    tags, made, _ = sound
    for count, codes in ((8, []), (7, ["few-views"])):
        some = dict(list(tags.items())[:count])
        of = msgspec.structs.replace(made, views=made.views[:count])
        said = warnings_for(of, fit(some, SIZE, SMALL, ModelSpec("none")), some, SMALL, {}, {})
        assert [w.code for w in said] == codes, count


def test_numbers_of_the_camera_are_doubted_beyond_their_limits(sound, subtests):
    _, made, found = sound
    for number, limit, said in (
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
    ):
        for side in (-1, 1):
            value = {"fx": 700.0, "fy": 700.0, "cx": 499.5, "cy": 399.5}
            sd = dict.fromkeys(value, 1.0)
            of = sd if number.startswith("sd") else value
            # Further from what it should be: up, but for a centre that lies to the left or above.
            away = -1 if number in ("cx", "cy") and limit < value[number] else 1
            of[number[-2:]] = limit * (1 + side * away * NEAR)
            K = ((value["fx"], 0.0, value["cx"]), (0.0, value["fy"], value["cy"]), (0.0, 0.0, 1.0))
            with subtests.test(f"{number}, {limit:g}, {side}"):
                doubts = degenerate(msgspec.structs.replace(made, K=K, sigma=sd), found)
                assert [said in text for text in doubts] == [True] * (side > 0)


def test_boards_that_lean_too_little_apart_and_frames_that_are_not_covered_are_doubted(sound):
    _, made, found = sound
    for degrees, doubted in ((14.98, 1), (15.02, 0)):
        turn = np.radians(np.linspace(0, degrees, 12))
        R = np.array([[[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]] for a in turn])
        assert normal_spread(R) == pytest.approx(degrees)
        doubts = degenerate(made, replace(found, R=R))
        assert len([text for text in doubts if "tilt differs by 15 degrees" in text]) == doubted
    for cells, doubted in ((24, 1), (25, 0)):
        seen = tuple((100.0 * (i % 5) + 50, 80.0 * (i // 5) + 40) for i in range(cells))
        evidence = msgspec.structs.replace(made.evidence, seen=seen)
        doubts = degenerate(msgspec.structs.replace(made, evidence=evidence), found)
        assert len([text for text in doubts if f"tags cover {cells} % of the frame" in text]) == doubted
