"""scene.toml and camera.toml: read, checked, written."""

import base64
import math
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
from raytwin.images.limits import MAX_PIXELS
from raytwin.safe_write import write_text
from raytwin.scene import NOWHERE, Camera, PhotoCamera, Scene, Sky, Tolerance
from raytwin.scene.look_at import camera_table
from raytwin.scene.toml_json import plain, read_toml, to_record, unknown_key, write_toml
from raytwin.scene_folders import find_scene

MOST_COLUMNS = 4096
"""Columns of an environment map: 100 MB of floats. Light from the sky is smooth, so a smaller map serves as well."""


ROUNDED = 2e-3
"""R R^T is off by less where a rotation was rounded to three decimals or more."""


def read_scene(path: str | os.PathLike[str] | Scene) -> Scene:
    """Read and check a scene, given the `path` of its folder or scene.toml, or its name; or check one made in Python.

    Raises InputError that names file and field, also where the camera is yet to be calibrated from photos. Lengths are
    metres; see the page on scene.toml for its keys.
    """
    scene, photos = scene_and_photos(path)
    if photos is not None:
        raise InputError(f"scene {scene.name}: camera", "a calibrated camera", "photos to calibrate it from")
    return scene


def scene_and_photos(path: str | os.PathLike[str] | Scene) -> tuple[Scene, PhotoCamera | None]:
    """Read and check a scene and, where its camera is to be found in photos, which; till then that is NOWHERE."""
    if isinstance(path, Scene):
        check_camera(path.camera, f"scene {path.name}: camera.")
        check_contents(path, f"scene {path.name}: ")
        return path, None
    file = find_scene(path)
    if file.suffix.lower() == ".xml":
        raise InputError(file, "a scene.toml: only compare, reference and shrink take a Mitsuba file", "XML")
    data = read_toml(file)
    if "name" in data:  # of the record, not of the file
        raise unknown_key(file, "name")
    if "camera" not in data:
        raise InputError(f"{file}: camera", "is missing. Write a table [camera] with image_size and look_at.")
    table, photos, data["camera"] = data["camera"], None, NOWHERE
    if isinstance(table, dict) and "photos" in table:
        photos = to_record(file, table, PhotoCamera, "camera")
    else:
        if isinstance(table, dict) and "look_at" in table:
            table = camera_table(file, table)
        data["camera"] = to_record(file, table, Camera, "camera")
        check_camera(data["camera"], f"{file}: camera.")
    data["name"] = scene_name(file)
    read_sky_map(file, data)
    scene = to_record(file, data, Scene)
    check_contents(scene, f"{file}: ")
    _check_map(scene.sky, f"{file}: ")
    return scene, photos


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
    if tables["tolerance"] == plain(Tolerance()):
        del tables["tolerance"]
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    text = tomli_w.dumps(tables)
    for _ in range(2):  # vectors, then matrices, on one line
        text = re.sub(r"\[\n\s+([^{}=]*?),\n\s*\]", lambda found: "[" + re.sub(r",\s+", ", ", found[1]) + "]", text)
    return f"{head}\n{text}"


def check_contents(scene: Scene, where: str) -> None:
    """Raise InputError unless planes are rectangles, materials are whole and names differ.

    `where` is put before the field's name: `scenes/desk/scene.toml: `.
    """
    fields = [f"{kind}[{i}]" for kind in ("spheres", "planes") for i in range(len(getattr(scene, kind)))]
    for i, plane in enumerate(scene.planes):
        _check_edges(f"{where}planes[{i}]", np.asarray(plane.half_u), np.asarray(plane.half_v))
    for field, thing in zip(fields, scene.objects, strict=True):
        try:
            _ = thing.material
        except InputError as error:
            raise InputError(f"{where}{field}", *error.fields[1:]) from None
    taken: set[str] = set()
    for field, name in zip(fields, scene.names, strict=True):
        if name in taken:
            raise InputError(f"{where}{field}.name", "a name that no other object has", repr(name))
        taken.add(name)


def read_sky_map(file: Path, data: dict[str, Any]) -> None:
    """Put the pixels of [sky] map into the table, from which the record is made."""
    if not isinstance(sky := data.get("sky"), dict):
        return
    if "texels" in sky:
        raise unknown_key(file, "sky.texels")
    if "map" not in sky:
        if odd := sky.keys() & {"scale", "rotation"}:
            raise InputError(f"{file}: sky.{min(odd)}", "only where there is a map", sky[min(odd)])
        return
    if "radiance" in sky:
        raise InputError(f"{file}: sky", "radiance or map", "both")
    if not isinstance(sky["map"], str):
        raise InputError(f"{file}: sky.map", "an image file's name", repr(sky["map"]))
    path = file.parent / sky["map"]
    pixels = read_image(path).mean
    h, w = pixels.shape[:2]
    if w != 2 * h or w < 4 or w > MOST_COLUMNS:
        expected = f"an equirectangular map, twice as wide as high, of 4 to {MOST_COLUMNS} columns"
        raise InputError(f"{file}: sky.map: {path}", expected, f"{w} x {h} pixels")
    if not (np.isfinite(pixels).all() and pixels.min() >= 0):
        found = f"{pixels.min():g}" if np.isfinite(pixels).all() else "NaN or infinity"
        raise InputError(f"{file}: sky.map: {path}", "radiance of 0 or more everywhere", found)
    texels = base64.b64encode(np.ascontiguousarray(pixels, "<f4").tobytes()).decode()
    data["sky"] = sky | {"texels": {"size": [w, h], "texels": texels}}


def _check_map(sky: Sky, where: str) -> None:
    """Raise InputError where the map times its scale is more than float32 holds."""
    if sky.texels is UNSET or sky.scale is UNSET:
        return
    brightest = float(np.frombuffer(sky.texels.texels, "<f4").max())
    if sky.scale * brightest > float(np.finfo(np.float32).max):
        raise InputError(f"{where}sky.scale", "a radiance that float32 holds", f"{sky.scale:g} times {brightest:g}")


def _check_edges(where: str, u: np.ndarray, v: np.ndarray) -> None:
    lengths = np.linalg.norm(u) * np.linalg.norm(v)
    if not lengths > 0:
        raise InputError(where, "half_u and half_v longer than 0 m", f"{tuple(u.tolist())}, {tuple(v.tolist())}")
    if abs(u @ v) > 1e-6 * lengths:
        degrees = math.degrees(math.acos(np.clip(u @ v / lengths, -1, 1)))
        raise InputError(f"{where}.half_v", "a vector perpendicular to half_u", f"{degrees:.4g} degrees")


def check_camera(camera: Camera, where: str) -> None:
    """Raise InputError unless K is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive foci and R is a rotation.

    `where` is put before the field's name: `scenes/desk/scene.toml: camera.`.
    """
    if camera.width * camera.height > MAX_PIXELS:
        raise InputError(
            f"{where}image_size", f"at most {MAX_PIXELS / 1e6:.0f} megapixels", f"{camera.width} x {camera.height}"
        )
    for i, focus in enumerate((camera.fx, camera.fy)):
        if not focus > 0:
            raise InputError(f"{where}K[{i}][{i}]", "a focal length > 0 px", focus)
    if camera.K[0][1] != 0:
        raise InputError(f"{where}K[0][1]", "0 (cameras here have no skew: calibrate without it)", camera.K[0][1])
    for (i, j), wanted in {(1, 0): 0, (2, 0): 0, (2, 1): 0, (2, 2): 1}.items():
        if camera.K[i][j] != wanted:
            expected = f"{wanted}, since K is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
            raise InputError(f"{where}K[{i}][{j}]", expected, camera.K[i][j])
    if wrong := _no_rotation(np.asarray(camera.R_cam_board)):
        raise InputError(f"{where}R_cam_board", "a rotation matrix", wrong)


def _no_rotation(R: np.ndarray) -> str:
    """Why R is no rotation, and what to write instead; empty for one, to 1e-6.

    A rounded matrix is not mended in silence: the file, the scene's hash and the dict that a subject gets would each
    have another pose.
    """
    gram = R @ R.T
    i, j = sorted(int(k) for k in np.unravel_index(np.argmax(np.abs(gram - np.eye(3))), (3, 3)))
    off = abs(gram[i, j] - (i == j))
    if off <= 1e-6:
        return "" if np.linalg.det(R) > 0 else "a mirroring (determinant -1): negate an axis"
    what = f"row {i} of length {math.sqrt(gram[i, i]):.6g}" if i == j else f"rows {i} and {j} not perpendicular"
    u, _, v = np.linalg.svd(R)
    if off > ROUNDED or np.linalg.det(u @ v) < 0:
        return what
    return f"a rounded one ({what}). Write {(np.round(u @ v, 9) + 0.0).tolist()}"


def read_camera(path: str | os.PathLike[str]) -> Camera:
    """A camera.toml, as `raytwin photo calibrate -o` writes it; the board in it is passed over."""
    data = read_toml(path)
    data.pop("board", None)
    camera = to_record(path, data, Camera)
    check_camera(camera, f"{path}: ")
    return camera


def write_camera(path: str | os.PathLike[str], camera: Camera, comment: str = "") -> None:
    write_toml(path, plain(camera), comment)
