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
    from raytwin.photos.camera import Calibration, View


def find_camera(
    path: str | Path | Scene, photo: str | None = None, progress: Progress = silent
) -> "tuple[Scene, Path | None, Calibration | None, View | None]":
    """Return the scene with its camera, calibrated from its photos, where `photo` was taken.

    Returns the photo's path, calibration and pose, too: None for a scene whose file gives its camera or that was made
    in Python.
    """
    scene, asked = scene_and_photos(path)
    if asked is None or isinstance(path, Scene):
        if photo is not None:
            raise InputError("--photo", "a scene whose camera is calibrated from photos", f"{scene.name}'s is given")
        return scene, None, None, None
    from raytwin.photos import boards
    from raytwin.photos.camera import calibrate, camera_at

    folder = find_scene(path).parent
    taken, name = list_photos(folder / asked.photos), photo or asked.photo
    where = "--photo" if photo else f"{folder / 'scene.toml'}: camera.photo"
    check_one_of(where, name, (p.name for p in taken))
    calibration = calibrate(taken, boards.read_board(folder / asked.board), model=asked.model, progress=progress)
    used = {view.photo: view for view in calibration.views}
    check_one_of(where, name, used)
    return scene.with_camera(camera_at(calibration, used[name])), folder / asked.photos / name, calibration, used[name]
