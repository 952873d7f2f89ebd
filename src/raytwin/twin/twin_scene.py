"""A scene record as a Mitsuba scene. Mitsuba's world is the camera's frame (OpenCV's, the eye at 0) in 1/1024 m.

Why there: float32 coordinates relative to the eye keep outlines in place to about 1e-4 px. Why so small a unit:
Mitsuba moves the start of every secondary ray off the surface by 9e-5 (1 + max|p|), which in metres would be 0.1 mm
everywhere; in these units it is 9e-5 of the distance from the eye. A power of two scales without rounding.
"""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.scene import Rectangle, Scene
from raytwin.twin import phong
from raytwin.twin.sky import sky_of

UNIT = 1024.0
"""Mitsuba's lengths per metre."""

SHADOW_OFFSET = 4e-6
"""How far off the surface the sun's shadow rays start, as a part of the distance from the eye: 64 float32 steps.

A table of 3 m under a camera at 0.3 m shaded itself in places at 1e-6 and nowhere at 2e-6; this is twice that, and
moves a shadow's edge by less than 0.01 px.
"""


def load(world: dict[str, Any]) -> Any:
    """The Mitsuba object, without `optimize`.

    That would merge rectangles of one albedo: ids are lost, and the merged mesh is missing from the scene's bounding
    box, so that the sky's shadow rays are too short and light leaks through walls (Mitsuba 3.9).
    """
    import mitsuba as mi

    return mi.load_dict(world, optimize=False)


def translate(scene: Scene, textures: Mapping[int, np.ndarray], without: Collection[int] = ()) -> dict[str, Any]:
    """The dictionary for `load`: object i is called `object-i`, everything is two-sided, diffuse or Phong's."""
    import mitsuba as mi

    if scene.glossy:
        phong.register()
    R, t = np.asarray(scene.camera.R_cam_board), np.asarray(scene.camera.t_cam_board)
    world: dict[str, Any] = {"type": "scene"}
    for i, thing in enumerate(scene.objects):
        if i in without:
            continue
        center = (R @ thing.center + t) * UNIT
        if isinstance(thing, Rectangle):
            matrix = np.eye(4)
            matrix[:3, :3] = R @ np.stack([thing.half_u, thing.half_v, thing.normal], axis=1) * UNIT
            matrix[:3, 3] = center
            shape = {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix)}
        else:
            shape = {"type": "sphere", "center": center.tolist(), "radius": thing.radius * UNIT}
        shape["bsdf"] = {"type": "twosided", "bsdf": phong.bsdf(thing, _albedo(thing, textures.get(i)))}
        world[f"object-{i}"] = shape
    if any(scene.sun.irradiance):
        from_light = (-R @ scene.sun.to_light).tolist()
        world["sun"] = {"type": "directional", "direction": from_light, "irradiance": _rgb(scene.sun.irradiance)}
    if sky := sky_of(scene).emitter(R):
        world["sky"] = sky
    return world


def _rgb(values: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


def _albedo(thing: Any, texture: np.ndarray | None) -> dict[str, Any]:
    """A colour, or a bilinear texture: Mitsuba's first row lies at -half_v, ours at +half_v."""
    if texture is None:
        return _rgb(thing.material.albedo)
    import mitsuba as mi

    bitmap = mi.Bitmap(np.ascontiguousarray(texture[::-1]))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "bilinear", "wrap_mode": "clamp"}


def check_textures(scene: Scene, textures: Mapping[int, np.ndarray] | None) -> dict[int, np.ndarray]:
    """The textures as float32 (h, w, 1 or 3) by object id; InputError where one does not fit."""
    checked, flat = {}, [i for i, thing in enumerate(scene.objects) if isinstance(thing, Rectangle)]
    for i, texture in sorted((textures or {}).items()):
        where = f"textures[{i}]"
        if i not in flat:
            raise InputError(where, "the id of a rectangle", f"{i}, where these are {flat}")
        a = np.asarray(texture, np.float32)
        grey = a.ndim == 2
        if (not grey and (a.ndim != 3 or a.shape[2] != 3)) or 0 in a.shape:
            raise InputError(where, "an array (h, w) or (h, w, 3)", a.shape)
        a = a[..., None] if grey else a
        for axis in (0, 1):  # Mitsuba wants 2 x 2
            a = np.repeat(a, 2, axis) if a.shape[axis] == 1 else a
        if not (a.min() >= 0 and a.max() <= 1):
            raise InputError(where, "albedo from 0 to 1", f"{a.min()} to {a.max()}")
        checked[i] = a
    return checked
