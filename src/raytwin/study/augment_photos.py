"""Photos of a board -> the same photos with a scene's objects in them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin import twin
from raytwin.errors import InputError
from raytwin.images.photo_files import photo_exif, read_photo, write_picture
from raytwin.photos import boards, camera
from raytwin.photos.augment import augment, draw_boxes, draw_pyramid, printed
from raytwin.photos.find_camera import find_camera
from raytwin.photos.lighting.light_file import photo_exposure, read_light
from raytwin.progress import Progress, silent
from raytwin.renderers.subject_renderers import fast_engine
from raytwin.safe_write import replacing_files
from raytwin.scene.scene_files import read_camera, scene_and_photos
from raytwin.scene_folders import find_scene
from raytwin.study.settings import AugmentSettings


def augment_photos(
    taken: list[Path],
    scene_path: str | Path,
    out: str | Path,
    settings: AugmentSettings | None = None,
    *,
    progress: Progress = silent,
    **options: Any,
) -> list[dict[str, Any]]:
    """Draw the scene's objects into each photo and write it to `out` under its own name, as JPEG or else as PNG.

    Where one photo fails, nothing is written.
    `options` are fields of AugmentSettings. Returns a row per photo: its name and its pose's rms in pixels. The photo's
    EXIF is kept as it is, its orientation with it, and its colours become sRGB.
    """
    chosen = replace(settings or AugmentSettings(), **options)
    scene, asked = scene_and_photos(scene_path)
    light = read_light(chosen.light) if chosen.light is not None else None
    scene = light.on(scene) if light is not None else scene
    if chosen.board is None and asked is None:
        raise InputError("--board", "is missing. It names the board's TOML file, since the scene names none.")
    definition = boards.read_board(chosen.board or find_scene(scene_path).parent / (asked.board if asked else ""))
    if chosen.camera is None:
        placed, _, calibration, _ = find_camera(scene_path, progress=progress)
        lens = placed.camera
        definition = calibration.shaped(definition) if calibration is not None else definition
    else:
        lens = read_camera(chosen.camera)
        definition = camera.with_shape(definition, chosen.camera)
    out = Path(out)
    names = [p.name if p.suffix.lower() in (".jpg", ".jpeg", ".png") else f"{p.stem}.png" for p in taken]
    if repeated := sorted(n for n in {*names} if names.count(n) > 1):
        raise InputError("photos", "names that differ, since each is written under its own", ", ".join(repeated))
    if any((out / p.name).exists() and (out / p.name).samefile(p) for p in taken):
        raise InputError("--out", "another folder than the photos'", out)
    engine = fast_engine(twin.chosen().variant)
    rows = []
    with replacing_files(out) as made:
        for done, (path, name) in enumerate(zip(taken, names, strict=True)):
            progress("augment", done, len(taken))
            pixels = read_photo(path)
            if pixels.shape[1::-1] != lens.image_size:
                turned = ": the same, turned by a quarter" if pixels.shape[:2] == lens.image_size else ""
                found = f"{pixels.shape[1]} x {pixels.shape[0]}{turned}"
                raise InputError(path, f"{lens.width} x {lens.height} pixels, as the camera's", found)
            tags = camera.detect_photo(path, definition.family)
            pose = camera.pose_of_tags(lens.K, lens.dist, tags, definition, path.name)
            stand = msgspec.structs.replace(lens, R_cam_board=pose.R_cam_board, t_cam_board=pose.t_cam_board)
            here = scene.with_camera(stand)
            exposure: float | np.ndarray = 1.0 if chosen.exposure is None else chosen.exposure
            if light is not None and chosen.exposure is None:
                exposure = photo_exposure(path, stand, definition, light)
            options = {"engine": engine, "exposure": exposure}
            drawn = augment(pixels, printed(here, definition), **options).pixels
            for pyramid in scene.pyramids:
                drawn = draw_pyramid(drawn, stand, pyramid)
            if chosen.boxes:
                drawn = draw_boxes(drawn, here)
            write_picture(made / name, drawn, quality=95, exif=photo_exif(path))
            rows.append({"photo": path.name, "pose_rms_px": pose.rms_px})
    progress("augment", len(taken), len(taken))
    return rows
