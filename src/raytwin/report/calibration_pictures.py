"""What a calibration rests on, drawn: each tag's residual over the frame, and where the board stood."""

import math

import numpy as np

from raytwin.calib.photos import Calibration, View
from raytwin.report.charts.svg import INK, SOFT, XY, Axes, box, dot, drawing, marker, round_down, stroke, words
from raytwin.report.numbers import short
from raytwin.report.uncertainty_pictures import AXIS, LEFT, TOP, frame_axes

MOST_VECTORS = 1500
"""Residuals drawn at most: evenly chosen of more."""
LONG = 0.06
"""Length of the 95 % quantile of the residuals, as a share of the frame's longer side."""
CELLS, LEAST = 8, 4
"""Cells across the longer side in which residuals are averaged, and tags that a cell needs."""
MEAN = WORST = "#c02f4a"
"""Colour of a cell's mean, and of the photo that fits worst."""
BOARD = "#3b82c4"
PANEL = 380
"""Longer side of a view of the board's poses, pixels."""
VIEWS = {
    "above": (0, -1.0, "x to the left of the camera up, z ahead of it"),
    "the side": (1, 1.0, "y down, z ahead of the camera"),
}
"""From where the poses are seen -> the axis that is shown upright, its sign downwards, and the axes in words."""


def residual_drawing(calibration: Calibration) -> str:
    """Draw where each tag was seen and, as a line from there, where the camera puts it, enlarged.

    Thick: the means of cells. They point nowhere in common where the lens model fits.
    """
    axes, evidence = frame_axes(calibration), calibration.basis
    (left, _), (right, bottom) = axes.corners
    seen, off = np.array(evidence.seen), np.array(evidence.residuals)
    longest = max(calibration.image_size)
    size = float(np.quantile(np.linalg.norm(off, axis=1), 0.95)) or 1.0
    by = round_down(LONG * longest / size)
    some = np.arange(0, len(seen), math.ceil(len(seen) / MOST_VECTORS))
    shapes = [box(*axes.corners, "#f6f7f9", SOFT)]
    for at, moved in zip(seen[some], (seen + by * off)[some], strict=True):
        shapes += [stroke((axes.at(*at), axes.at(*moved)), "#5a6575", 0.9), dot(axes.at(*at), 1.3, INK)]
    for cell, mean, count in cell_means(seen, off, longest):
        tip = f"mean of {count} tags: {math.hypot(*mean):.2g} px"
        shapes += [
            stroke((axes.at(*cell), axes.at(*(cell + by * mean))), MEAN, 2.2),
            marker(axes.at(*cell), 1.8, MEAN, tip, tip),
        ]
    title = f"residuals, drawn {by:g} times as long"
    bar, y = by * round_down(size) * axes.width / calibration.image_size[0], bottom + 16
    shapes += [
        words(title, (left, 12), 11, INK),
        stroke(((left, y), (left + bar, y)), INK, 2),
        words(f"{short(round_down(size))} px", (left + bar + 6, y), 11),
        stroke(((left + 150, y), (left + 170, y)), MEAN, 2.2),
        words(f"mean of a cell of {LEAST} tags or more", (left + 176, y), 11),
    ]
    if len(some) < len(seen):
        shapes.append(words(f"{len(some)} of {len(seen)} tags", (right, 12), 11, anchor="end"))
    return drawing(right + LEFT, y + 12, title, shapes)


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


def pose_drawing(calibration: Calibration, view_from: str) -> str:
    """Draw the camera and where the board stood in each photo, `view_from` above or the side, in metres."""
    across, sign, text = VIEWS[view_from]
    outlines = [outline(calibration, view) for view in calibration.views]
    reach = np.concatenate([*outlines, np.zeros((1, 3))])[:, [2, across]]
    margin = 0.06 * float(np.ptp(reach, axis=0).max())
    (x0, y0), (x1, y1) = reach.min(axis=0) - margin, reach.max(axis=0) + margin
    k = PANEL / max(x1 - x0, y1 - y0)
    upright = (y1, y0) if sign > 0 else (y0, y1)  # below, above
    axes = Axes(LEFT + AXIS, TOP, k * (x1 - x0), k * (y1 - y0), (x0, x1), upright)
    _, (right, bottom) = axes.corners

    def place(point: np.ndarray) -> XY:
        return axes.at(float(point[2]), float(point[across]))

    title = f"{text}; metres"
    shapes = [words(title, (LEFT, 12), 12, INK), *axes.grid(12), box(*axes.corners, line=SOFT)]
    depth, slope = 3 * margin, calibration.image_size[across] / 2 / calibration.K[across][across]
    wedge = np.zeros((4, 3))
    wedge[1:3, 2], wedge[1:3, across] = depth, (-depth * slope, depth * slope)
    shapes.append(stroke((place(p) for p in wedge), INK, 1.5))
    shapes.append(words("camera", (place(wedge[0])[0], place(wedge[2])[1] + sign * 12), 12, INK))
    worst = max(calibration.views, key=lambda v: v.rms_px)
    for view, corners in zip(calibration.views, outlines, strict=True):
        colour, tip = (WORST if view is worst else BOARD), f"{view.photo}: {view.tags} tags, rms {view.rms_px:.3f} px"
        shapes.append(stroke((place(c) for c in (*corners, corners[0])), colour, 1.1))
        shapes.append(marker(place(corners.mean(axis=0)), 3.5, colour, view.photo, tip))
    return drawing(right + 16, bottom + 24, title, shapes)


def outline(calibration: Calibration, view: View) -> np.ndarray:
    """Return the corners of the board's box of tags (4, 3), in the camera's frame, metres."""
    board = calibration.basis.board
    xy = np.array(list(board.centers().values()))
    (x0, y0), (x1, y1) = xy.min(axis=0) - board.tag_edge / 2, xy.max(axis=0) + board.tag_edge / 2
    corners = np.array([(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)])
    return corners @ np.array(view.R_cam_board).T + np.array(view.t_cam_board)
