"""The picture of the projected uncertainty, and what is said of the models tried."""

import base64
import io
import math
import re

import msgspec
import numpy as np
import pytest
from PIL import Image as Pillow

from raytwin import files
from raytwin.calib import boards, photos
from raytwin.calib.photos import ModelTrial, uncertainty_map
from raytwin.calib.photos.model import trial_rows
from raytwin.errors import InputError
from raytwin.report import terminal_text, uncertainty_pictures
from raytwin.report.uncertainty_pictures import uncertainty_drawing, without_tags


@pytest.fixture(scope="module")
def calibration(scenes):
    folder = scenes / "desk"
    return photos.calibrate(files.list_photos(folder / "photos"), boards.read_board(folder / "board.toml"))


def pixels(svg: str) -> np.ndarray:
    """The first picture in a drawing, float (H, W, 3)."""
    data = re.search(r'href="data:image/png;base64,([^"]+)"', svg)[1]
    with Pillow.open(io.BytesIO(base64.b64decode(data))) as shown:
        return np.asarray(shown.convert("RGB")).astype(float)


def test_the_picture_is_brightest_where_the_map_is_most_uncertain(calibration):
    """Viridis runs from purple, whose green is low, to yellow."""
    svg = uncertainty_drawing(calibration)
    frame, found = pixels(svg)[..., 1], uncertainty_map(calibration)
    h, w = found.shape
    y = ((np.arange(h) + 0.5) / h * frame.shape[0]).astype(int)
    x = ((np.arange(w) + 0.5) / w * frame.shape[1]).astype(int)
    tagged = ~without_tags(calibration, w, h)
    assert (~tagged).mean() == pytest.approx(1 - calibration.basis.coverage, abs=0.02)
    ranks = [np.argsort(np.argsort(a)) for a in (frame[np.ix_(y, x)][tagged], found[tagged])]
    assert np.corrcoef(*ranks)[0, 1] > 0.9  # contours are white
    assert svg.count('r="1.5"') == len(calibration.basis.seen)


def test_the_evidence_holds_every_tag_that_was_used(calibration):
    assert len(calibration.evidence.seen) == sum(view.tags for view in calibration.views)
    u, v = np.array(calibration.evidence.seen).T
    assert -0.5 <= u.min() < u.max() <= 2015.5
    assert -0.5 <= v.min() < v.max() <= 1511.5


def test_a_file_is_written_whole_or_not_at_all(calibration, tmp_path):
    uncertainty_pictures.write_uncertainty(calibration, tmp_path / "map.svg")
    assert (tmp_path / "map.svg").read_text(encoding="utf-8").endswith("</svg>\n")
    with pytest.raises(InputError, match=r"map\.svg"):
        uncertainty_pictures.write_uncertainty(calibration, tmp_path / "map.svg" / "map.svg")
    assert [p.name for p in tmp_path.iterdir()] == ["map.svg"]


def test_a_boards_picture_is_brightest_where_it_is_highest_one_file_a_board(calibration, tmp_path):
    """z = c x y, x to the right and y up: high in two corners, low in the two others."""
    (board,) = calibration.basis.boards
    bent = msgspec.structs.replace(board, heights=boards.Heights(2, (0.0, 1e-3, 0.0)))
    evidence = msgspec.structs.replace(calibration.basis, boards=(bent, board))
    uncertainty_pictures.write_bends(msgspec.structs.replace(calibration, evidence=evidence), tmp_path / "bend.svg")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bend.svg", "bend_2.svg"]
    green, flat = (pixels((tmp_path / name).read_text())[..., 1] for name in ("bend.svg", "bend_2.svg"))
    y, x = np.meshgrid(
        *(np.linspace(1, -1, n) * sign for n, sign in zip(green.shape, (1, -1), strict=True)), indexing="ij"
    )
    ranks = [np.argsort(np.argsort(a[::7, ::7].ravel())) for a in (green, x * y)]
    assert np.corrcoef(*ranks)[0, 1] > 0.9  # contours are white
    assert np.ptp(flat) == 0


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
    lines = terminal_text.calibration_summary(calibration).splitlines()
    tried = [line for line in lines if "held out" in line]
    assert len(tried) == len(calibration.evidence.trials)
    assert [line.split()[1] for line in tried if line.strip().startswith("*")] == [calibration.model]
    photos = [line.split() for line in lines if line.strip().startswith("photo_")]
    assert [p[0] for p in photos] == [v.photo for v in calibration.views]
    assert [float(p[2]) for p in photos] == pytest.approx([v.rms_px for v in calibration.views], abs=6e-4)
    assert [float(p[3]) for p in photos] == pytest.approx([v.influence for v in calibration.views], abs=6e-3)


def test_the_summary_counts_photos_and_not_the_boards_seen_in_them(calibration):
    of_two = tuple(v for view in calibration.views for v in (view, msgspec.structs.replace(view, board=1)))
    first = terminal_text.calibration_summary(msgspec.structs.replace(calibration, views=of_two)).splitlines()[0]
    assert first.startswith(f"{len(calibration.views)} photos of ")
