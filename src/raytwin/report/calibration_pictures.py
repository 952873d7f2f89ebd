"""What a calibration rests on, drawn: each tag's residual over the frame, and where the board stood."""

import math

import numpy as np

from raytwin.calib.photos import Calibration, View
from raytwin.report.charts import INK, SOFT
from raytwin.report.charts.chart_marks import XY, Box, Drawing, Marker, Shape, Stroke, Words
from raytwin.report.numbers import short
from raytwin.report.uncertainty_pictures import AXIS, LEFT, SIDE, TOP

MOST_VECTORS = 1500
"""Residuals drawn at most: evenly chosen of more."""
LONG = 0.06
"""Length of the 95 % quantile of the residuals, as a share of the frame's longer side."""
CELLS, LEAST = 8, 4
"""Cells across the longer side in which residuals are averaged, and tags that a cell needs."""
MEAN, GROUND, WORST = "#c02f4a", "#e2e6eb", "#c02f4a"
"""Colours of a cell's mean, of the frame's ground and of the photo that fits worst."""
BOARD = "#3b82c4"
PANEL = 380
"""Longer side of a view of the board's poses, pixels."""
VIEWS = {
    "above": (0, -1.0, "x to the left of the camera up, z ahead of it"),
    "the side": (1, 1.0, "y down, z ahead of the camera"),
}
"""From where the poses are seen -> the axis that is shown upright, its sign downwards, and the axes in words."""


def residual_drawing(calibration: Calibration) -> Drawing:
    """Draw where each tag was seen and, as a line from there, where the camera puts it, enlarged.

    Thick: the means of cells. They point nowhere in common where the lens model fits.
    """
    evidence = calibration.basis
    seen, off = np.array(evidence.seen), np.array(evidence.residuals)
    k = SIDE / max(calibration.image_size)
    width, height = (round(k * side) for side in calibration.image_size)
    size = float(np.quantile(np.linalg.norm(off, axis=1), 0.95)) or 1.0
    by = round_down(LONG * SIDE / (k * size))
    low = np.array([LEFT, TOP])
    at, end = low + k * (seen + 0.5), low + k * (seen + 0.5 + by * off)
    some = np.arange(0, len(seen), math.ceil(len(seen) / MOST_VECTORS))
    shapes: list[Shape] = [Box((LEFT, TOP), (LEFT + width, TOP + height), fill="#f6f7f9", line=SOFT)]
    for i in some.tolist():
        shapes += [Stroke((pair(at[i]), pair(end[i])), "#5a6575", 0.9), Marker(pair(at[i]), 0.7, (), INK, INK, "", "")]
    for cell, mean, count in cell_means(seen, off, max(calibration.image_size)):
        start = low + k * (cell + 0.5)
        tip = f"mean of {count} tags: {math.hypot(*mean):.2g} px"
        shapes += [Stroke((pair(start), pair(start + k * by * mean)), MEAN, 2.2),
                   Marker(pair(start), 1.8, (), MEAN, MEAN, tip, tip)]  # fmt: skip
    title = f"residuals, drawn {by:g} times as long"
    bar, y = k * by * round_down(size), TOP + height + 16
    shapes += [
        Words(title, (LEFT, 12), 11, INK),
        Stroke(((LEFT, y), (LEFT + bar, y)), INK, 2),
        Words(f"{short(round_down(size))} px", (LEFT + bar + 6, y), 11, SOFT),
        Stroke(((LEFT + 150, y), (LEFT + 170, y)), MEAN, 2.2),
        Words(f"mean of a cell of {LEAST} tags or more", (LEFT + 176, y), 11, SOFT),
    ]
    if len(some) < len(seen):
        shapes.append(Words(f"{len(some)} of {len(seen)} tags", (LEFT + width, 12), 11, SOFT, anchor="end"))
    return Drawing(width + 2 * LEFT, y + 12, title, tuple(shapes))


def cell_means(seen: np.ndarray, off: np.ndarray, longest: int) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Return (middle of its tags, mean residual, tags) of each square cell that has LEAST tags."""
    cells = np.floor((seen + 0.5) * CELLS / longest).astype(int)
    keys, which, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    return [
        (seen[which == i].mean(axis=0), off[which == i].mean(axis=0), int(count))
        for i, count in enumerate(counts[: len(keys)])
        if count >= LEAST
    ]


def pose_drawing(calibration: Calibration, view_from: str) -> Drawing:
    """Draw the camera and where the board stood in each photo, `view_from` above or the side, in metres."""
    across, sign, words = VIEWS[view_from]
    outlines = [outline(calibration, view) for view in calibration.views]
    reach = np.concatenate([*outlines, np.zeros((1, 3))])[:, [2, across]] * (1.0, sign)
    margin = 0.06 * float(np.ptp(reach, axis=0).max())
    (x0, y0), (x1, y1) = reach.min(axis=0) - margin, reach.max(axis=0) + margin
    k = PANEL / max(x1 - x0, y1 - y0)
    left, right, bottom = LEFT + AXIS, LEFT + AXIS + k * (x1 - x0), TOP + k * (y1 - y0)

    def place(point: np.ndarray) -> XY:
        return left + k * float(point[2] - x0), TOP + k * float(sign * point[across] - y0)

    title = f"{words}; metres"
    shapes: list[Shape] = [Words(title, (LEFT, 12), 12, INK), Box((left, TOP), (right, bottom), line=SOFT)]
    for at in ticks(x0, x1):
        x = left + k * (at - x0)
        shapes += [
            Stroke(((x, TOP), (x, bottom)), GROUND, 1),
            Words(short(at), (x, bottom + 11), 12, SOFT, anchor="middle"),
        ]
    for at in ticks(y0, y1):
        y = TOP + k * (at - y0)
        shapes += [
            Stroke(((left, y), (right, y)), GROUND, 1),
            Words(short(sign * at + 0.0), (left - 5, y), 12, SOFT, anchor="end"),
        ]
    depth, slope = 5 * margin * 0.6, calibration.image_size[across] / 2 / calibration.K[across][across]
    wedge = np.zeros((4, 3))
    wedge[1:3, 2], wedge[1:3, across] = depth, (-depth * slope, depth * slope)
    shapes.append(Stroke(tuple(place(p) for p in wedge), INK, 1.5))
    shapes.append(Words("camera", (place(wedge[0])[0], place(wedge[2])[1] + sign * 12), 12, INK))
    worst = max(calibration.views, key=lambda v: v.rms_px)
    for view, corners in zip(calibration.views, outlines, strict=True):
        colour = WORST if view is worst else BOARD
        shapes.append(Stroke(tuple(place(c) for c in (*corners, corners[0])), colour, 1.1))
    for view, corners in zip(calibration.views, outlines, strict=True):
        colour, tip = (WORST if view is worst else BOARD), f"{view.photo}: {view.tags} tags, rms {view.rms_px:.3f} px"
        shapes.append(Marker(place(corners.mean(axis=0)), 3.5, (), colour, colour, view.photo, tip))
    return Drawing(round(right + 16), round(bottom + 24), title, tuple(shapes))


def outline(calibration: Calibration, view: View) -> np.ndarray:
    """Return the corners of the board's box of tags (4, 3), in the camera's frame, metres."""
    board = calibration.basis.boards[view.board]
    xy = np.array(list(board.centers().values()))
    (x0, y0), (x1, y1) = xy.min(axis=0) - board.tag_edge / 2, xy.max(axis=0) + board.tag_edge / 2
    corners = np.array([(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)])
    return corners @ np.array(view.R_cam_board).T + np.array(view.t_cam_board)


def ticks(low: float, high: float) -> list[float]:
    """Return three to eight round numbers from low to high."""
    step = round_down((high - low) / 3.5)
    return [float(n * step) for n in range(math.ceil(low / step), math.floor(high / step) + 1)]


def round_down(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at most `value`."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (5, 2, 1) if m * power <= value * (1 + 1e-9))


def pair(point: np.ndarray) -> XY:
    return float(point[0]), float(point[1])
