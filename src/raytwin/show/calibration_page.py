"""The page of a calibration: its uncertainty, its photos, and its warnings."""

import os
from pathlib import Path
from typing import Any

from raytwin.photos.camera import Calibration
from raytwin.photos.camera.diagnostics import coverage
from raytwin.show.calibration_pictures import residual_drawing
from raytwin.show.page import write_page
from raytwin.show.terminal_text import intrinsics


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
        pictures=calibration_pictures(calibration),
        of_board=board_sentence(calibration),
    )


def calibration_tables(calibration: Calibration) -> dict[str, Any]:
    """Return the intrinsics with their standard deviations, the photos, worst first, and the models tried."""
    photos = sorted(calibration.views, key=lambda view: -view.rms_px)
    found = intrinsics(calibration).items()
    return {
        "intrinsics": [(n, v, calibration.sigma.get(n), "px" if n[0] in "fc" else "") for n, v in found],
        "photos": photos,
        # A calibration that was read back has no evidence any more.
        "tried": calibration.evidence if calibration.evidence.taken else None,
        "largest": max((view.rms_px for view in photos), default=1.0) or 1.0,
    }


def calibration_pictures(calibration: Calibration) -> list[tuple[str, str, str]]:
    """Return (title, SVG, what it tells); none of a calibration that was read back."""
    if not calibration.evidence.seen:
        return []
    return [
        ("What each tag is off by", residual_drawing(calibration),
         "Lines that point every way are noise. Neighbours that point one way show what the lens model lacks."),
    ]  # fmt: skip


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
