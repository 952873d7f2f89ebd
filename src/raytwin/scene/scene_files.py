"""scene.toml and camera.toml: read, checked, written."""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from msgspec import UNSET, structs

from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.images.image_formats import read_image, write_image
from raytwin.safe_write import write_text
from raytwin.scene.camera import NOWHERE, Camera, LookAtCamera
from raytwin.scene.lights import Environment
from raytwin.scene.scene import PhotoCamera, Scene, Tolerance
from raytwin.scene.toml_json import comment_lines, plain, read_toml, to_record
from raytwin.scene_folders import find_scene

MAX_MAP_COLUMNS = 4096
"""Columns of an environment map: 100 MB of floats. Light from the sky is smooth, so a smaller map serves as well."""


def read_scene(path: str | os.PathLike[str] | Scene) -> Scene:
    """Read a scene, given the `path` of its folder or scene.toml, or its name; one made in Python is returned.

    Raises InputError that names file and field, also where the camera is yet to be calibrated from photos. Lengths are
    metres; see the page on scene.toml for its keys.
    """
    scene, photos = scene_and_photos(path)
    if photos is not None:
        raise InputError(f"scene {scene.name}: camera", "a calibrated camera", "photos to calibrate it from")
    return scene


def scene_and_photos(path: str | os.PathLike[str] | Scene) -> tuple[Scene, PhotoCamera | None]:
    """Read a scene and, where its camera is to be found in photos, which; till then that is NOWHERE."""
    if isinstance(path, Scene):
        return path, None
    file = find_scene(path)
    if file.suffix.lower() == ".xml":
        raise InputError(file, "a scene.toml: only compare, reference and shrink take a Mitsuba file", "XML")
    data = read_toml(file)
    if "name" in data:  # of the record, not of the file
        raise InputError(f"{file}: name", "is no known key.")
    camera, photos = data.get("camera"), None
    if isinstance(camera, dict) and "photos" in camera:
        photos = to_record(file, camera, PhotoCamera, "camera")
        data["camera"] = NOWHERE
    elif isinstance(camera, dict) and "look_at" in camera:
        data["camera"] = to_record(file, camera, LookAtCamera, "camera").camera()
    read_sky_map(file, data)
    return to_record(file, data | {"name": scene_name(file)}, Scene), photos


def scene_name(path: str | os.PathLike[str]) -> str:
    """Return the name of a scene: its folder's, with the file's where that is not scene.toml."""
    file = find_scene(path)
    return file.resolve().parent.name + ("" if file.name == "scene.toml" else f"-{file.stem}")


def write_scene(path: Path, scene: Scene, comment: str = "") -> Path:
    """Write a scene, with its sky's map beside it as an EXR; return `path`."""
    if (texels := scene.sky.texels) is not UNSET:
        name = Path("sky.exr" if scene.sky.map is UNSET else scene.sky.map).with_suffix(".exr").name
        write_image(path.parent / name, Image(texels.radiance, samples=0))
        scene = structs.replace(scene, sky=structs.replace(scene.sky, map=name))
    write_text(path, scene_text(scene, comment))
    return path


def scene_text(scene: Scene, comment: str = "") -> str:
    """Return the scene.toml of a scene: without defaults, vectors and matrices on one line."""
    tables = {k: v for k, v in plain(scene).items() if k != "name" and v}
    for table in (tables["camera"], *tables.get("spheres", ()), *tables.get("planes", ())):
        for key in [key for key in ("dist", "in_photo") if not table.get(key)]:
            table.pop(key, None)
    if scene.sky.map is not UNSET:
        tables["sky"] = {k: v for k, v in tables["sky"].items() if k not in ("texels", "radiance")}
    if scene.tolerance == Tolerance():
        del tables["tolerance"]
    text = tomli_w.dumps(tables)
    for _ in range(2):  # vectors, then matrices, on one line
        text = re.sub(r"\[\n\s+([^{}=]*?),\n\s*\]", lambda found: "[" + re.sub(r",\s+", ", ", found[1]) + "]", text)
    return f"{comment_lines(comment)}\n{text}"


def read_sky_map(file: Path, data: dict[str, Any]) -> None:
    """Put the pixels of [sky] map into the table that the record is made from."""
    if not isinstance(sky := data.get("sky"), dict):
        return
    if "texels" in sky:  # of the record, not of the file
        raise InputError(f"{file}: sky.texels", "is no known key.")
    if not isinstance(sky.get("map"), str):
        return
    path = file.parent / sky["map"]
    pixels = read_image(path).mean
    h, w = pixels.shape[:2]
    if w != 2 * h or not 4 <= w <= MAX_MAP_COLUMNS:
        expected = f"an equirectangular map, twice as wide as high, of 4 to {MAX_MAP_COLUMNS} columns"
        raise InputError(f"{file}: sky.map: {path}", expected, f"{w} x {h} pixels")
    if not (np.isfinite(pixels).all() and pixels.min() >= 0):
        found = f"{pixels.min():g}" if np.isfinite(pixels).all() else "NaN or infinity"
        raise InputError(f"{file}: sky.map: {path}", "radiance of 0 or more everywhere", found)
    data["sky"] = sky | {"texels": Environment((w, h), np.ascontiguousarray(pixels, "<f4").tobytes())}


def read_camera(path: str | os.PathLike[str]) -> Camera:
    """Read a camera.toml, as `raytwin photo calibrate -o` writes it; the board in it is passed over."""
    data = read_toml(path)
    data.pop("board", None)
    return to_record(path, data, Camera)
