"""Photos of a board -> the camera that took one of them, beside the truth where there is one.

OpenCV is loaded where photos are: a scene whose camera is given needs none.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from raytwin import files
from raytwin.errors import InputError, check_one_of
from raytwin.progress import Progress, silent
from raytwin.scene import Camera, Scene

if TYPE_CHECKING:
    from raytwin.calib import photos, synthetic_photos


@dataclass(frozen=True)
class TruthRow:
    """One calibrated quantity beside the truth that the synthetic photographer wrote down."""

    name: str
    truth: float
    found: float
    sigma: float | None
    unit: str


def find_camera(
    path: str | Path | Scene, photo: str | None = None, progress: Progress = silent
) -> "tuple[Scene, Path | None, photos.Calibration | None, photos.PoseReport | None]":
    """What is to be rendered, its camera found: calibrated from its photos, standing where `photo` was taken.

    A scene whose file gives its camera, or made in Python, needs no photo. Returns the scene, the photo's path,
    calibration and pose.
    """
    scene, asked = files.scene_and_photos(path)
    if asked is None or isinstance(path, Scene):
        if photo is not None:
            raise InputError(
                "--photo", "a scene whose camera is calibrated from photos", f"{scene.name}, whose is given"
            )
        return scene, None, None, None
    from raytwin.calib import boards, photos

    folder = files.find_scene(path).parent
    board = boards.read_board(folder / asked.board)
    taken = files.list_photos(folder / asked.photos)
    name = photo or asked.photo
    where = "--photo" if photo else f"{folder / 'scene.toml'}: camera.photo"
    check_one_of(where, name, (p.name for p in taken))
    calibration = photos.calibrate(taken, board, model=asked.model, progress=progress)
    pose = photos.pose_of_photo(calibration, folder / asked.photos / name, board)
    camera = photos.camera_at(calibration, pose.refined)
    return scene.with_camera(camera), folder / asked.photos / name, calibration, pose


def compare_truth(
    truth: "synthetic_photos.Truth",
    calibration: "photos.Calibration",
    camera: Camera,
    photo: str,
    pose: "photos.PoseReport | None" = None,
) -> tuple[TruthRow, ...]:
    """Found beside true: focal lengths and centre in pixels, the compared photo's pose in degrees and millimetres."""
    from raytwin.calib import photos

    places = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}
    rows = [
        TruthRow(name, truth.K[i][j], camera.K[i][j], calibration.sigma.get(name), "px")
        for name, (i, j) in places.items()
    ]
    if photo in truth.photos:
        R, t = (np.asarray(a) for a in truth.photos[photo])
        angle = photos.rotation_degrees(np.asarray(camera.R_cam_board), R)
        turned = None if pose is None else pose.sigma_degrees
        rows.append(TruthRow("rotation off by", 0.0, angle, turned, "degrees"))
        apart = 1e3 * np.linalg.norm(np.asarray(camera.eye) - (-R.T @ t))
        away = None if pose is None or pose.sigma_metres is None else 1e3 * pose.sigma_metres
        rows.append(TruthRow("eye off by", 0.0, float(apart), away, "mm"))
    return tuple(rows)
