"""The picture of the projected uncertainty, and what is said of the models tried."""

import io
import math

import msgspec
import numpy as np
import pytest
from PIL import Image as Pillow

from raytwin import files, report
from raytwin.calib import boards, photos
from raytwin.calib.photos import ModelTrial, uncertainty_map
from raytwin.calib.photos.model import trial_rows
from raytwin.errors import InputError
from raytwin.report.charts import png_bytes
from raytwin.report.uncertainty_pictures import uncertainty_drawing, without_tags


@pytest.fixture(scope="module")
def calibration(scenes):
    folder = scenes / "desk"
    return photos.calibrate(files.list_photos(folder / "photos"), boards.read_board(folder / "board.toml"))


def test_the_picture_is_brightest_where_the_map_is_most_uncertain(calibration):
    with Pillow.open(io.BytesIO(png_bytes(uncertainty_drawing(calibration)))) as shown:
        picture = np.asarray(shown.convert("RGB")).astype(float)
    found = uncertainty_map(calibration)
    # viridis runs from purple, whose green is low, to yellow; the frame is the large coloured rectangle.
    coloured = np.ptp(picture, axis=-1) > 40
    columns, rows = (np.flatnonzero(coloured.mean(axis=a) > 0.4) for a in (0, 1))
    frame = picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1, 1]
    h, w = found.shape
    y = ((np.arange(h) + 0.5) / h * frame.shape[0]).astype(int)
    x = ((np.arange(w) + 0.5) / w * frame.shape[1]).astype(int)
    tagged = ~without_tags(calibration, w, h)
    assert (~tagged).mean() == pytest.approx(1 - calibration.basis.coverage, abs=0.02)
    green, flat = frame[np.ix_(y, x)][tagged], found[tagged]
    ranks = [np.argsort(np.argsort(a)) for a in (green, flat)]
    assert np.corrcoef(*ranks)[0, 1] > 0.75  # dots and contours are white


def test_the_evidence_holds_every_tag_that_was_used(calibration):
    assert len(calibration.evidence.seen) == sum(view.tags for view in calibration.views)
    u, v = np.array(calibration.evidence.seen).T
    assert -0.5 <= u.min() < u.max() <= 2015.5
    assert -0.5 <= v.min() < v.max() <= 1511.5


def test_a_file_is_written_whole_or_not_at_all(calibration, tmp_path):
    report.write_uncertainty(calibration, tmp_path / "map.png")
    with Pillow.open(tmp_path / "map.png") as picture:
        assert 900 < picture.size[0] <= 1100
    with pytest.raises(InputError, match=r"map\.png"):
        report.write_uncertainty(calibration, tmp_path / "map.png" / "map.png")
    assert [p.name for p in tmp_path.iterdir()] == ["map.png"]


def test_a_boards_picture_is_brightest_where_it_is_highest_one_file_a_board(calibration, tmp_path):
    """z = c x y, x to the right and y up: high in two corners, low in the two others."""
    (board,) = calibration.basis.boards
    bent = msgspec.structs.replace(board, heights=boards.Heights(2, (0.0, 1e-3, 0.0)))
    evidence = msgspec.structs.replace(calibration.basis, boards=(bent, board))
    report.write_bends(msgspec.structs.replace(calibration, evidence=evidence), tmp_path / "bend.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bend.png", "bend_2.png"]
    shown, flat = (files.read_photo(tmp_path / name).astype(float) for name in ("bend.png", "bend_2.png"))
    xy = np.array(list(board.centers().values()))
    (w, h), longest = np.ptp(xy, axis=0), np.ptp(xy, axis=0).max()
    # Twice as fine as the drawing: 2 x 26 pixels above the sheet, 2 x 42 beside it, 2 x 220 its longer side.
    sheet = slice(52, 52 + round(440 * h / longest)), slice(84, 84 + round(440 * w / longest)), 1
    green = shown[sheet]
    y, x = np.meshgrid(
        *(np.linspace(1, -1, n) * sign for n, sign in zip(green.shape, (1, -1), strict=True)), indexing="ij"
    )
    ranks = [np.argsort(np.argsort(a[::7, ::7].ravel())) for a in (green, x * y)]
    assert np.corrcoef(*ranks)[0, 1] > 0.8  # dots and contours are white
    assert np.unique(flat[sheet], return_counts=True)[1].max() > 0.9 * green.size


def test_each_model_tried_has_its_reason():
    trials = {
        "full5": ModelTrial(1.0, "the lens folds back inside the frame"),
        "full5, bent 2": ModelTrial(math.inf, "the fit does not converge"),
        "k1k2k3": ModelTrial(1.001),
        "k1": ModelTrial(1.005),
        "none": ModelTrial(2.0),
    }
    told = {t.model: t for t in trial_rows(trials, "k1", 20)}
    assert list(told) == list(trials)
    assert [t.model for t in told.values() if t.taken] == ["k1"]
    assert told["none"].why == "2 times the best"
    assert told["k1"].why == "the smallest that predicts as well as the best"
    assert told["k1k2k3"].why == "larger than needed"
    assert told["full5"].why == "larger than needed; the lens folds back inside the frame"
    assert told["full5, bent 2"].why == "the fit does not converge"
    assert trial_rows({}, "k1", 20) == []


def test_the_summary_marks_the_model_that_was_taken(calibration):
    lines = report.calibration_summary(calibration).splitlines()
    tried = [line for line in lines if "held out" in line]
    assert len(tried) == len(calibration.evidence.trials)
    assert [line.split()[1] for line in tried if line.strip().startswith("*")] == [calibration.model]
    photos = [line.split() for line in lines if line.strip().startswith("photo_")]
    assert [p[0] for p in photos] == [v.photo for v in calibration.views]
    assert [float(p[2]) for p in photos] == pytest.approx([v.rms_px for v in calibration.views], abs=6e-4)
    assert [float(p[3]) for p in photos] == pytest.approx([v.influence for v in calibration.views], abs=6e-3)


def test_the_summary_counts_photos_and_not_the_boards_seen_in_them(calibration):
    of_two = tuple(v for view in calibration.views for v in (view, msgspec.structs.replace(view, board=1)))
    first = report.calibration_summary(msgspec.structs.replace(calibration, views=of_two)).splitlines()[0]
    assert first.startswith(f"{len(calibration.views)} photos of ")
