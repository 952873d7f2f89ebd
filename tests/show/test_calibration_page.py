"""A calibration's page and drawings: its residuals, each where it belongs."""

import re
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest

from raytwin.photos import camera
from raytwin.photos.camera.calibration_result import Evidence
from raytwin.photos.camera.diagnostics import coverage
from raytwin.show import calibration_page, terminal_text
from raytwin.show.calibration_page import MEAN, SIDE, residual_drawing


def elements(drawing: str, kind: str, **like: str) -> list[ElementTree.Element]:
    found = ElementTree.fromstring(drawing).iter("{http://www.w3.org/2000/svg}" + kind)
    return [e for e in found if all(e.get(name) == value for name, value in like.items())]


def test_the_residuals_kept_are_those_that_the_rms_is_of(calibration):
    evidence = calibration.evidence
    off = np.array(evidence.residuals)
    assert len(off) == len(evidence.seen)
    assert np.sqrt((off**2).sum(axis=1).mean()) == pytest.approx(calibration.rms_px, rel=1e-6)
    view = calibration.views[0]  # projected minus seen: within the detector's bias, which is taken out of what is seen
    board = calibration.evidence.board
    xyz = board.points(board.centers())
    at = camera.project(xyz, np.array(view.R_cam_board), np.array(view.t_cam_board), calibration.K, calibration.dist)
    shown = np.array(evidence.seen[: view.tags]) + off[: view.tags]
    nearest = np.linalg.norm(shown[:, None] - at[None], axis=-1).min(axis=1)
    assert nearest.max() < 1e-3


def test_a_common_shift_shows_in_every_cell_and_noise_in_none(calibration):
    rng = np.random.default_rng(4)
    noise = rng.normal(0, 0.1, (len(calibration.evidence.seen), 2))
    lengths = {}
    for name, off in (("noise", noise), ("shift", noise + np.array([0.3, 0.0]))):
        evidence = msgspec.structs.replace(calibration.evidence, residuals=tuple(map(tuple, off.tolist())))
        drawing = residual_drawing(msgspec.structs.replace(calibration, evidence=evidence))
        by = float(re.search(r"drawn ([\d.e+]+) times", drawing)[1]) * SIDE / max(calibration.image_size)
        lines = [e.get("points").split() for e in elements(drawing, "polyline", stroke=MEAN)[:-1]]  # the last: the key
        ends = np.array([[[float(v) for v in xy.split(",")] for xy in line] for line in lines])
        lengths[name] = (ends[:, 1] - ends[:, 0]) / by
    assert np.median(lengths["shift"], axis=0) == pytest.approx([0.3, 0.0], abs=0.03)
    assert np.abs(lengths["noise"]).mean() < 0.06


def test_the_page_says_what_is_known_and_of_a_calibration_that_was_read_back_no_evidence(calibration, tmp_path):
    """Photos come the worst first."""
    page = tmp_path / "camera.html"
    bent = msgspec.structs.replace(calibration, board=camera.FoundBoard(None, 1.234, 0.056))
    calibration_page.write_calibration(bent, page, "camera.toml")
    said = f"Tags were seen in {100 * coverage(calibration):.0f} % of the frame. "
    said += "The board is bent by 1.23 ± 0.06 mm, fitted"
    assert said in page.read_text(encoding="utf-8")
    back = msgspec.structs.replace(calibration, evidence=Evidence())
    calibration_page.write_calibration(back, page, "camera.toml")
    text = page.read_text(encoding="utf-8")
    assert f"<b>{len(back.views)} photos</b>" in text
    assert "<svg" not in text
    worst = [view.photo for view in sorted(back.views, key=lambda view: -view.rms_px)]
    assert re.findall(r'<th scope="row">(photo_\d+\.jpg)', text) == worst


def test_calibrates_summary_marks_the_model_that_was_taken_and_has_each_number_beside_its_name(calibration):
    lines = terminal_text.calibration_summary(calibration).splitlines()
    tried = [line for line in lines if "held out" in line]
    assert len(tried) == len(calibration.evidence.held_out_px)
    assert [line.split()[1] for line in tried if line.strip().startswith("*")] == [calibration.model]
    numbers = [line.split() for line in lines if "+-" in line]
    k = calibration.K
    expected = [k[0][0], k[1][1], k[0][2], k[1][2], *calibration.dist]
    assert [row[0] for row in numbers] == ["fx", "fy", "cx", "cy", "k1", "k2"]
    for (name, value, _, sigma), true in zip(numbers, expected, strict=True):
        assert (float(value), float(sigma)) == pytest.approx((true, calibration.sigma[name]), rel=0.05), name
    view = calibration.views[3]
    row = next(line.split() for line in lines if view.photo in line)
    assert list(map(float, row[1:4])) == pytest.approx([view.tags, view.rms_px, view.influence], abs=6e-3)
