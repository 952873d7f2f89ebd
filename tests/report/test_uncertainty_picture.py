"""The picture of the projected uncertainty, and what is said of the models tried."""

import base64
import io
import math

import numpy as np
import pytest
from PIL import Image as Pillow

from raytwin import boards, photos, report
from raytwin.errors import InputError
from raytwin.jobs.camera import list_photos
from raytwin.photos import ModelTrial, explained, uncertainty_map
from raytwin.report.uncertainty import uncertainty_url


@pytest.fixture(scope="module")
def calibration(scenes):
    folder = scenes / "desk"
    return photos.calibrate(list_photos(folder / "photos"), boards.read_board(folder / "board.toml"))


def picture_of(url: str) -> np.ndarray:
    return np.asarray(
        Pillow.open(io.BytesIO(base64.b64decode(url.removeprefix("data:image/png;base64,")))).convert("RGB")
    )


def test_the_picture_is_brightest_where_the_map_is_most_uncertain(calibration):
    picture = picture_of(uncertainty_url(calibration)).astype(float)
    found = uncertainty_map(calibration)
    # viridis runs from purple, whose green is low, to yellow; the frame is the large coloured rectangle.
    coloured = np.ptp(picture, axis=-1) > 40
    columns, rows = (np.flatnonzero(coloured.mean(axis=a) > 0.5) for a in (0, 1))
    frame = picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1, 1]
    h, w = found.shape
    y = ((np.arange(h) + 0.5) / h * frame.shape[0]).astype(int)
    x = ((np.arange(w) + 0.5) / w * frame.shape[1]).astype(int)
    green, flat = frame[np.ix_(y, x)].ravel(), found.ravel()
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


def test_each_model_tried_has_its_reason():
    trials = {
        "none": ModelTrial(2.0),
        "k1": ModelTrial(1.02),
        "k1k2": ModelTrial(1.0),
        "k1k2k3": ModelTrial(0.9, "k3 within 3 standard deviations of 0"),
        "full5": ModelTrial(math.inf, "the fit does not converge"),
    }
    told = {t.model: t for t in explained(trials, "k1")}
    assert list(told) == list(trials)
    assert [t.model for t in told.values() if t.taken] == ["k1"]
    # Of the sound ones the best has 1.0.
    assert told["none"].why == "2 times the best"
    assert told["k1"].why == "the smallest that is sound and near the best"
    assert told["k1k2"].why == "larger than needed"
    assert told["k1k2k3"].why == "k3 within 3 standard deviations of 0"
    assert told["full5"].why == "the fit does not converge"
    assert explained({}, "k1") == []
    unsound = {"none": ModelTrial(3.0, "the distortion folds back inside the image")}
    assert explained(unsound, "none")[0].why == "none is sound"


def test_the_summary_marks_the_model_that_was_taken(calibration):
    lines = report.calibration_summary(calibration).splitlines()
    tried = [line for line in lines if "held out" in line]
    assert len(tried) == 5
    assert [line.split()[1] for line in tried if line.strip().startswith("*")] == [calibration.model]
