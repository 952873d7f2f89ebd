"""A calibration's page and drawings: residuals, poses, bend and uncertainty, each where it belongs."""

import base64
import io
import re
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest
from PIL import Image as Pillow

from raytwin.calib import boards, photos
from raytwin.calib.photos import uncertainty_map
from raytwin.report import calibration_page, terminal_text
from raytwin.report.calibration_pictures import BOARD, MEAN, WORST, pose_drawing, residual_drawing
from raytwin.report.uncertainty_pictures import (
    AXIS,
    LEFT,
    SIDE,
    TOP,
    bend_drawing,
    uncertainty_drawing,
    without_tags,
)


def elements(drawing: str, kind: str, **like: str) -> list[ElementTree.Element]:
    found = ElementTree.fromstring(drawing).iter("{http://www.w3.org/2000/svg}" + kind)
    return [e for e in found if all(e.get(name) == value for name, value in like.items())]


def at(circle: ElementTree.Element) -> tuple[float, float]:
    return float(circle.get("cx")), float(circle.get("cy"))


def test_the_residuals_kept_are_those_that_the_rms_is_of(calibration):
    evidence = calibration.basis
    off = np.array(evidence.residuals)
    assert len(off) == len(evidence.seen)
    assert np.sqrt((off**2).sum(axis=1).mean()) == pytest.approx(calibration.rms_px, rel=1e-6)
    view = calibration.views[0]  # projected minus seen: within the detector's bias, which is taken out of what is seen
    board = calibration.basis.board
    xyz = board.points(board.centers())
    at = photos.project(xyz, np.array(view.R_cam_board), np.array(view.t_cam_board), calibration.K, calibration.dist)
    shown = np.array(evidence.seen[: view.tags]) + off[: view.tags]
    nearest = np.linalg.norm(shown[:, None] - at[None], axis=-1).min(axis=1)
    assert nearest.max() < 1e-3


def test_a_common_shift_shows_in_every_cell_and_noise_in_none(calibration):
    rng = np.random.default_rng(4)
    noise = rng.normal(0, 0.1, (len(calibration.basis.seen), 2))
    lengths = {}
    for name, off in (("noise", noise), ("shift", noise + np.array([0.3, 0.0]))):
        evidence = msgspec.structs.replace(calibration.basis, residuals=tuple(map(tuple, off.tolist())))
        drawing = residual_drawing(msgspec.structs.replace(calibration, evidence=evidence))
        by = float(re.search(r"drawn ([\d.e+]+) times", drawing)[1]) * SIDE / max(calibration.image_size)
        lines = [e.get("points").split() for e in elements(drawing, "polyline", stroke=MEAN)[:-1]]  # the last: the key
        ends = np.array([[[float(v) for v in xy.split(",")] for xy in line] for line in lines])
        lengths[name] = (ends[:, 1] - ends[:, 0]) / by
    assert np.median(lengths["shift"], axis=0) == pytest.approx([0.3, 0.0], abs=0.03)
    assert np.abs(lengths["noise"]).mean() < 0.06


@pytest.mark.parametrize(("side", "axis", "sign"), [("above", 0, -1), ("the side", 1, 1)])
def test_each_photo_stands_where_its_pose_puts_the_board_and_the_worst_is_red(calibration, side, axis, sign):
    drawing = pose_drawing(calibration, side)
    dots = [e for e in elements(drawing, "circle") if e.get("data-name")]
    assert [d.get("data-name") for d in dots] == [v.photo for v in calibration.views]
    middle = np.array([*np.mean(list(calibration.basis.board.centers().values()), axis=0), 0.0])
    places = np.array([np.array(v.R_cam_board) @ middle + v.t_cam_board for v in calibration.views])
    for column, of in ((0, places[:, 2]), (1, sign * places[:, axis])):
        drawn = np.array([at(d)[column] for d in dots])
        assert np.ptp(drawn - np.polyval(np.polyfit(of, drawn, 1), of)) < 0.2
        assert np.polyfit(of, drawn, 1)[0] > 0
    worst = int(np.argmax([v.rms_px for v in calibration.views]))
    assert [d.get("fill") for d in dots] == [WORST if i == worst else BOARD for i in range(len(dots))]
    numbers = [float(e.text) for e in elements(drawing, "text") if re.fullmatch(r"-?[\d.]+", e.text)]
    assert len(numbers) >= 6  # three an axis
    assert len(set(numbers[:3])) == 3


def test_the_bend_has_axes_and_every_tags_number(calibration):
    board = calibration.basis.board
    drawing = bend_drawing(calibration)
    assert {str(tag) for tag in board.centers()} <= {e.text for e in elements(drawing, "text")}
    xy = np.array(list(board.centers().values()))
    left, high = xy[:, 0].min(), xy[:, 1].max()
    k = SIDE / 2 / np.ptp(xy, axis=0).max()
    for tag, (x, y) in board.centers().items():
        (dot,) = elements(drawing, "circle", **{"data-name": f"tag {tag}"})
        assert at(dot) == pytest.approx((LEFT + AXIS + k * (x - left), TOP + k * (high - y)), abs=0.5)
    heights = [float(e.text) for e in elements(drawing, "text") if re.fullmatch(r"[+-]\d\.\d\d", e.text)]
    assert heights == sorted(heights)


def test_the_page_of_a_calibration_that_was_read_back_has_its_photos_the_worst_first(calibration, tmp_path):
    back = msgspec.structs.replace(calibration, evidence=None)
    calibration_page.write_calibration(back, tmp_path / "camera.html", "camera.toml")
    text = (tmp_path / "camera.html").read_text(encoding="utf-8")
    assert f"<b>{len(back.views)} photos</b>" in text
    assert re.findall(r'<th scope="row">(photo_\d+\.jpg)', text) == [
        v.photo for v in sorted(back.views, key=lambda v: -v.rms_px)
    ]
    assert "views" not in re.sub(r"<(script|style).*?</\1>|class=\"views\"", "", text, flags=re.DOTALL)


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


def test_the_boards_picture_is_brightest_where_it_is_highest(calibration):
    """z = c x y, x to the right and y up: high in two corners, low in the two others."""
    board = calibration.basis.board.flat()
    bent = msgspec.structs.replace(board, heights=boards.Heights(2, (0.0, 1e-3, 0.0)))
    evidences = (msgspec.structs.replace(calibration.basis, board=b) for b in (bent, board))
    shown = (bend_drawing(msgspec.structs.replace(calibration, evidence=e)) for e in evidences)
    green, flat = (pixels(drawing)[..., 1] for drawing in shown)
    y, x = np.meshgrid(
        *(np.linspace(1, -1, n) * sign for n, sign in zip(green.shape, (1, -1), strict=True)), indexing="ij"
    )
    ranks = [np.argsort(np.argsort(a[::7, ::7].ravel())) for a in (green, x * y)]
    assert np.corrcoef(*ranks)[0, 1] > 0.9  # contours are white
    assert np.ptp(flat) == 0


def test_the_summary_marks_the_model_that_was_taken(calibration):
    lines = terminal_text.calibration_summary(calibration).splitlines()
    tried = [line for line in lines if "held out" in line]
    assert len(tried) == len(calibration.evidence.trials)
    assert [line.split()[1] for line in tried if line.strip().startswith("*")] == [calibration.model]
    photos = [line.split() for line in lines if line.strip().startswith("photo_")]
    assert [p[0] for p in photos] == [v.photo for v in calibration.views]
    assert [float(p[2]) for p in photos] == pytest.approx([v.rms_px for v in calibration.views], abs=6e-4)
    assert [float(p[3]) for p in photos] == pytest.approx([v.influence for v in calibration.views], abs=6e-3)
