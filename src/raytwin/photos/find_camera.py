"""Photos of a board -> the camera that took one of them.

OpenCV is loaded where photos are: a scene whose camera is given needs none.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from raytwin.errors import InputError, check_one_of
from raytwin.images.photo_files import list_photos
from raytwin.progress import Progress, silent
from raytwin.scene import Scene
from raytwin.scene.scene_files import scene_and_photos
from raytwin.scene_folders import find_scene

if TYPE_CHECKING:
    from raytwin.photos.camera import Calibration, PoseReport


def find_camera(
    path: str | Path | Scene, photo: str | None = None, progress: Progress = silent
) -> "tuple[Scene, Path | None, Calibration | None, PoseReport | None]":
    """What is to be rendered, its camera found: calibrated from its photos, standing where `photo` was taken.

    A scene whose file gives its camera, or made in Python, needs no photo. Returns the scene, the photo's path,
    calibration and pose.
    """
    scene, asked = scene_and_photos(path)
    if asked is None or isinstance(path, Scene):
        if photo is not None:
            raise InputError("--photo", "a scene whose camera is calibrated from photos", f"{scene.name}'s is given")
        return scene, None, None, None
    from raytwin.photos import boards
    from raytwin.photos.camera import calibrate, camera_at, pose_of_photo

    folder = find_scene(path).parent
    board = boards.read_board(folder / asked.board)
    taken = list_photos(folder / asked.photos)
    name = photo or asked.photo
    where = "--photo" if photo else f"{folder / 'scene.toml'}: camera.photo"
    check_one_of(where, name, (p.name for p in taken))
    calibration = calibrate(taken, board, model=asked.model, progress=progress)
    pose = pose_of_photo(calibration, folder / asked.photos / name, board)
    camera = camera_at(calibration, pose.refined)
    return scene.with_camera(camera), folder / asked.photos / name, calibration, pose
