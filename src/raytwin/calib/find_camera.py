"""Photos of a board -> the camera that took one of them.

OpenCV is loaded where photos are: a scene whose camera is given needs none.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from raytwin import files
from raytwin.errors import InputError, check_one_of
from raytwin.progress import Progress, silent
from raytwin.scene import Scene, SceneFile

if TYPE_CHECKING:
    from raytwin.calib import photos


def find_camera(
    written: SceneFile, photo: str | None = None, progress: Progress = silent
) -> "tuple[Scene, Path | None, photos.Calibration | None, photos.PoseReport | None]":
    """What is to be rendered, its camera found: calibrated from its photos, standing where `photo` was taken.

    A scene with an explicit camera comes back as it is. Returns the scene, the photo's path, calibration and pose.
    """
    asked = written.photos
    if asked is None:
        if photo is not None:
            raise InputError(
                "--photo", "a scene whose camera is calibrated from photos", f"{written.name}, whose is given"
            )
        return written.scene, None, None, None
    from raytwin.calib import boards, photos

    folder = Path(written.folder)
    board = boards.read_board(folder / asked.board)
    taken = files.list_photos(folder / asked.photos)
    name = photo or asked.photo
    where = "--photo" if photo else f"{folder / 'scene.toml'}: camera.photo"
    check_one_of(where, name, (p.name for p in taken))
    calibration = photos.calibrate(taken, board, model=asked.model, progress=progress)
    pose = photos.pose_of_photo(calibration, folder / asked.photos / name, board)
    camera = photos.camera_at(calibration, pose.refined)
    return written.at(camera), folder / asked.photos / name, calibration, pose
