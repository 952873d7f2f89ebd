"""Detection on shrunk photos in closed form, and the calibration bench on a few small photos."""

import time

import cv2
import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from raytwin.bench import Bench
from raytwin.bench.calibration_cost import (
    BOARD,
    SETTINGS,
    Setting,
    detect_shrunk,
    held_out,
    measure_calibration,
    true_tags,
)
from raytwin.calib import boards, photos, synthetic_photos
from raytwin.calib.boards import Board, Grid, draw_board
from raytwin.cli import app
from raytwin.scene import Camera
from raytwin.workflows.photograph import photograph_board

EYE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
TRUE = Camera(
    (1008, 756), ((780.0, 0.0, 503.0), (0.0, 781.0, 376.0), (0.0, 0.0, 1.0)), EYE, (0.0, 0.0, 0.3), (0.08, -0.16)
)


@pytest.mark.parametrize("n", [2, 4])
def test_centres_found_in_a_shrunk_photo_have_no_half_pixel_bias(n):
    """Tags at four quarter turns, at places that are known: a forgotten half pixel would be (n - 1) / 2 px."""
    board = Board("tag36h11", 0.03, Grid(4, 3, 0.0413))
    albedo, (x_min, _, _, y_max) = draw_board(board, 10_000.0)
    sheet = cv2.GaussianBlur(albedo, (0, 0), 3)
    side = 901  # no multiple of n: the last small pixel reaches beyond the photo
    off = []
    for degrees in (10, 100, 190, 280):
        middle = np.array(sheet.shape[::-1]) / 2
        turn = cv2.getRotationMatrix2D(middle, degrees, 0.45)
        turn[:, 2] += np.array([side / 2 + 0.3, side / 2 + 0.7]) - middle
        grey = cv2.warpAffine(sheet, turn, (side, side), flags=cv2.INTER_LINEAR, borderValue=0.85)
        found = {t.id: t for t in detect_shrunk((grey * 255).astype(np.uint8), board.family, n)}
        assert set(found) == set(board.centers())
        for i, (x, y) in board.centers().items():
            known = turn @ ((x - x_min) * 10_000 - 0.5, (y_max - y) * 10_000 - 0.5, 1)
            off.append([found[i].center - known, np.mean(found[i].corners, axis=0) - known])
    assert np.abs(np.mean(off, axis=0)).max() < 0.1


def test_a_setting_reaches_the_detector():
    """On a photo so small that each way of searching finds other tags."""
    albedo, _ = draw_board(BOARD, 1000.0)
    grey = (albedo * 255).astype(np.uint8)
    counts = {s.name: len(s.find(grey, BOARD.family)) for s in SETTINGS}
    assert counts["full size, one thread, scale 1"] == counts["raytwin's own, scale 1"] == 35
    assert counts["photos shrunk, scale 0.25"] < 35
    assert counts["reduced search, refined, scale 0.125"] < 35


def test_held_out_errors_are_those_of_the_camera_not_of_the_detections(tmp_path_factory):
    """Noise on what the fit sees raises the error by little, noise on the judge's side not at all: it has none."""
    stands = synthetic_photos.poses(BOARD, TRUE, 6, np.random.default_rng(4))
    truth = synthetic_photos.Truth(
        TRUE.image_size, TRUE.K, TRUE.dist, {f"{i}": stand for i, stand in enumerate(stands)}
    )
    points = np.array([(*c, 0.0) for c in BOARD.centers().values()])
    rng = np.random.default_rng(5)
    found = {}
    for noise in (0.0, 0.5):
        tags = {}
        for name, (R, t) in truth.photos.items():
            exact = photos.project(points, np.array(R), np.array(t), TRUE.K, TRUE.dist)
            pixels = exact + rng.normal(0, noise, exact.shape)
            inside = ((exact > 3) & (exact < np.array(TRUE.image_size) - 4)).all(axis=1)
            # Corners in a point: a tag without edges has no bias to be taken off.
            tags[name] = [
                photos.Tag(i, tuple(p), (tuple(p),) * 4, 50.0)
                for i, p, ok in zip(BOARD.centers(), pixels, inside, strict=True)
                if ok
            ]
        c = photos.calibrate_detections(tags, TRUE.image_size, BOARD, "k1k2")
        found[noise] = held_out(tags, c, BOARD, true_tags(truth, BOARD))
    assert found[0.0] < 1e-3
    # 35 tags a photo, 6 photos: a camera of 6 parameters errs by about sqrt(6 / 420) of the noise.
    assert 0.01 < found[0.5] < 0.3


def test_what_finds_no_tags_or_has_no_time_is_named(tmp_path):
    boards.write_board(tmp_path / "given.toml", BOARD)
    photograph_board(tmp_path / "given.toml", tmp_path / "photos", count=3, size=(400, 300), samples=1)
    hopeless = [Setting("hopeless", 1 / 64, shrink=64, reductions=(1.0,))]
    for settings, deadline, why in (
        (hopeless, 1e9, "expected photos of tag36h11 tags"), (SETTINGS, -1.0, "no time to prepare it"),
    ):  # fmt: skip
        until = time.perf_counter() + deadline
        rows, left = measure_calibration(tmp_path / "photos", BOARD, settings=settings, deadline=until, repeats=1)
        assert rows == []
        assert [row.method for row in left] == [f"calibration: {s.name}" for s in settings]
        assert why in left[0].why


def test_one_command_measures_every_setting_with_its_seconds_and_both_errors_and_charts_them(tmp_path):
    photos_of = "--photo-size", "400x300", "--photo-count", "5", "--repeats", "1", "--budget", "3600"
    run = CliRunner().invoke(app, ["bench", "calibration", *photos_of, "-o", str(tmp_path)])
    assert run.exit_code == 0, run.output
    assert (tmp_path / "calibration.svg").exists()
    found = msgspec.json.decode((tmp_path / "bench.json").read_bytes(), type=Bench)
    assert found.budget == 3600
    left = {row.method for row in found.left_out}
    rows = {f"{r.setting}, scale {r.scale:g}": r for r in found.calibration}
    assert rows.keys() | {name.removeprefix("calibration: ") for name in left} == {s.name for s in SETTINGS}
    for r in rows.values():
        assert (r.source, r.width, r.height) == ("synthetic", 400, 300)
        assert r.seconds_median > 0
        assert 0 < r.heldout_px < 1
        assert 0 < r.focal_percent < 3
    whole, ours = (rows[f"{name}, scale 1"] for name in ("full size, one thread", "raytwin's own"))
    assert whole.photos == 5
    assert whole.heldout_px == pytest.approx(ours.heldout_px)  # small photos are searched whole in any case
