"""scene.toml and camera.toml: read, checked, written."""

import math
import os
from typing import Any

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.files.limits import MAX_PIXELS
from raytwin.files.records import plain, read_toml, to_record, write_toml
from raytwin.files.shipped import find_scene
from raytwin.scene import Camera, PhotoCamera, Plane, Pyramid, Scene, Sky, Sphere, Sun, Tolerance


class _SceneFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    camera: dict[str, Any]
    spheres: tuple[Sphere, ...] = ()
    planes: tuple[Plane, ...] = ()
    pyramids: tuple[Pyramid, ...] = ()
    sun: Sun = Sun(to_light=(0.0, 0.0, 1.0), irradiance=(0.0, 0.0, 0.0))
    sky: Sky = Sky()
    tolerance: Tolerance = Tolerance()


def read_scene(path: str | os.PathLike) -> Scene:
    """A scene by its folder, scene.toml or name; its camera stays a PhotoCamera where it is to be calibrated."""
    file = find_scene(path)
    data = read_toml(file)
    parts = to_record(file, data, _SceneFile)
    kind = PhotoCamera if "photos" in parts.camera else Camera
    camera = to_record(file, parts.camera, kind, "camera")
    if isinstance(camera, Camera):
        check_camera(camera, f"{file}: camera.")
    if not math.hypot(*parts.sun.to_light) > 0:
        raise InputError(f"{file}: sun.to_light", "a direction", "the zero vector")
    for i, plane in enumerate(parts.planes):
        u, v = np.asarray(plane.half_u), np.asarray(plane.half_v)
        lengths = np.linalg.norm(u) * np.linalg.norm(v)
        if not lengths > 0:
            raise InputError(
                f"{file}: planes[{i}]", "half_u and half_v longer than 0 m", f"{plane.half_u}, {plane.half_v}"
            )
        if abs(u @ v) > 1e-6 * lengths:
            degrees = math.degrees(math.acos(np.clip(u @ v / lengths, -1, 1)))
            raise InputError(
                f"{file}: planes[{i}].half_v", "a vector perpendicular to half_u", f"{degrees:.4g} degrees"
            )
    name = file.resolve().parent.name + ("" if file.name == "scene.toml" else f"-{file.stem}")
    lights = parts.sun, parts.sky
    return Scene(name, camera, parts.spheres, parts.planes, *lights, parts.tolerance, str(file.parent), parts.pyramids)


def check_camera(camera: Camera, where: str) -> None:
    """Raise InputError unless K is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive foci and R is a rotation.

    `where` is put before the field's name: `scenes/desk/scene.toml: camera.`.
    """
    if camera.width * camera.height > MAX_PIXELS:
        raise InputError(
            f"{where}image_size", f"at most {MAX_PIXELS / 1e6:.0f} megapixels", f"{camera.width} x {camera.height}"
        )
    if not (camera.fx > 0 and camera.fy > 0):
        raise InputError(f"{where}K", "focal lengths > 0 px", f"{camera.fx}, {camera.fy}")
    if camera.K[0][1] != 0 or camera.K[1][0] != 0 or tuple(camera.K[2]) != (0, 0, 1):
        raise InputError(f"{where}K", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]", camera.K)
    R = np.asarray(camera.R_cam_board)
    off = float(np.abs(R @ R.T - np.eye(3)).max())
    if off > 1e-6 or np.linalg.det(R) < 0:
        found = "a mirroring" if off <= 1e-6 else f"R R^T off the identity by {off:.2g}"
        raise InputError(f"{where}R_cam_board", "a rotation matrix", found)


def read_camera(path: str | os.PathLike) -> Camera:
    """A camera.toml, as `raytwin calibrate -o` writes it."""
    camera = to_record(path, read_toml(path), Camera)
    check_camera(camera, f"{path}: ")
    return camera


def write_camera(path: str | os.PathLike, camera: Camera, comment: str = "") -> None:
    write_toml(path, plain(camera), comment)
