"""The page of a calibration: its uncertainty, its photos, its warnings, and each tag's residual over the frame."""

import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.photos.camera import Calibration
from raytwin.photos.camera.diagnostics import coverage
from raytwin.show.charts.svg import INK, SOFT, Axes, box, dot, drawing, marker, round_down, stroke, words
from raytwin.show.numbers import short
from raytwin.show.page import write_page
from raytwin.show.terminal_text import intrinsics

SIDE = 440
"""Length of the frame's longer side in the drawing, pixels."""

TOP, LEFT = 26, 8
"""Pixels above the frame and beside it."""

MOST_VECTORS = 1500
"""Residuals drawn at most: evenly chosen of more."""
LONGEST_SHARE = 0.06
"""Length of the 95 % quantile of the residuals, as a share of the frame's longer side."""
CELLS_ACROSS, FEWEST_TAGS = 8, 4
"""Cells across the longer side in which residuals are averaged, and tags that a cell needs."""
MEAN = "#c02f4a"
"""Colour of a cell's mean."""


def write_calibration(calibration: Calibration, path: str | os.PathLike[str], camera_file: str = "") -> None:
    """Write the page; `camera_file`: the name of the camera.toml beside it."""
    write_page(
        Path(path),
        "calibration.html.j2",
        ("bench.css",),
        ("charts.js",),
        k=calibration,
        calibrated=calibration_tables(calibration),
        camera_file=camera_file,
        of_board=board_sentence(calibration),
    )


def calibration_tables(calibration: Calibration) -> dict[str, Any]:
    """Return the intrinsics with their standard deviations, the photos, worst first, the models tried, and residuals.

    A calibration that was read back has no evidence any more: no models, and no drawing of residuals.
    """
    photos = sorted(calibration.views, key=lambda view: -view.rms_px)
    found = intrinsics(calibration).items()
    return {
        "intrinsics": [(n, v, calibration.sigma.get(n), "px" if n[0] in "fc" else "") for n, v in found],
        "photos": photos,
        "residuals": residual_drawing(calibration) if calibration.evidence.seen else "",
        "tried": calibration.evidence if calibration.evidence.taken else None,
        "largest": max((view.rms_px for view in photos), default=1.0) or 1.0,
    }


def board_sentence(calibration: Calibration) -> str:
    """Return where tags were seen and how the board is bent; of a calibration that was read back, only the bend."""
    said, board = [], calibration.board
    if calibration.evidence.seen:
        said.append(f"Tags were seen in {100 * coverage(calibration):.0f} % of the frame.")
    if board.bend_mm:
        said.append(
            f"The board is bent by {board.bend_mm:.2f} ± {board.bend_sigma_mm:.2f} mm, fitted along with the camera."
        )
    return " ".join(said)


def frame_axes(calibration: Calibration) -> Axes:
    """Return the axes of the camera's frame: pixels, the first one's centre at 0."""
    width, height = calibration.image_size
    k = SIDE / max(width, height)
    return Axes(LEFT, TOP, round(k * width), round(k * height), (-0.5, width - 0.5), (height - 0.5, -0.5))


def residual_drawing(calibration: Calibration) -> str:
    """Draw where each tag was seen and, as a line from there, where the camera puts it, enlarged.

    Thick: the means of cells, which have no common direction where the lens model fits.
    """
    axes, evidence = frame_axes(calibration), calibration.evidence
    (left, _), (right, bottom) = axes.corners
    seen, off = np.array(evidence.seen), np.array(evidence.residuals)
    longest = max(calibration.image_size)
    size = float(np.quantile(np.linalg.norm(off, axis=1), 0.95)) or 1.0
    by = round_down(LONGEST_SHARE * longest / size)
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
        words(f"mean of a cell of {FEWEST_TAGS} tags or more", (left + 176, y), 11),
    ]
    if len(some) < len(seen):
        shapes.append(words(f"{len(some)} of {len(seen)} tags", (right, 12), 11, anchor="end"))
    return drawing(right + LEFT, y + 12, title, shapes)


def cell_means(seen: np.ndarray, off: np.ndarray, longest: int) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Return (middle of its tags, mean residual, tags) of each square cell that has FEWEST_TAGS tags."""
    cells = np.floor((seen + 0.5) * CELLS_ACROSS / longest).astype(int)
    keys, which, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    return [
        (seen[which == i].mean(axis=0), off[which == i].mean(axis=0), int(count))
        for i, count in enumerate(counts[: len(keys)])
        if count >= FEWEST_TAGS
    ]
