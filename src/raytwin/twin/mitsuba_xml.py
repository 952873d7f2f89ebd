"""A scene as a Mitsuba 3 file, which Mitsuba renders as the twin does.

The world is the twin's (`place_of`): the board's axes, an origin and a unit that suit float32.
"""

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from raytwin.errors import InputError, missing_package
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Scene
from raytwin.twin.twin_scene import SIZE, place_of, rgb, translate

SAMPLES = 64
"""Per pixel, unless the renderer is asked for others (`mitsuba -D spp=256`)."""
NEAR_CLIP, FAR_CLIP = 1e-6 * SIZE, 1e6 * SIZE
"""Mitsuba's lengths: the camera sees from here to there."""
TOLD_APART = 1e-7
"""Change of albedo from one rectangle to the next."""


def mitsuba_xml(scene: Scene, rung: str = "path") -> str:
    """The text of a file that `mitsuba` and `mi.load_file` take: the rung's depth, a box filter, 32-bit floats.

    Mitsuba's perspective camera has one focal length and no distortion: fx is taken.
    Raises InputError for a rung without a depth, for a map in the place of the sky, and for highlights.
    """
    scene.check_lambertian("a file of Mitsuba's")
    if rung not in RUNGS or RUNGS[rung].depth is None:
        raise InputError("--rung", "a light level that Mitsuba's integrators have: sky or path", rung)
    try:
        import mitsuba as mi
    except ModuleNotFoundError as error:
        raise missing_package("--mitsuba-xml", error) from None
    if mi.variant() is None:
        mi.set_variant("scalar_rgb")  # nothing is rendered: any will do
    camera, _ = scene.camera, scene.sky_radiance  # raises for a map
    place, depth = place_of(scene), RUNGS[rung].depth
    world = translate(scene, place, {})
    _tell_apart(world)
    world["integrator"] = {"type": "path", "max_depth": depth, "rr_depth": depth}
    world["sensor"] = perspective(camera, place.eye) | {"near_clip": max(NEAR_CLIP, place.start), "far_clip": FAR_CLIP}
    parsed = mi.parser.parse_dict(mi.parser.ParserConfig(mi.variant()), world)
    root = ET.fromstring(mi.parser.write_string(parsed))
    for element in root.iterfind("*[@type]"):
        element.set("id", name := element.get("name", ""))
        for transform in element.iterfind("transform"):  # the writer takes them apart in float32: sheets grow by 0.4 %
            numbers = np.array(world[name]["to_world"].matrix).ravel()
            transform[:] = [ET.Element("matrix", value=" ".join(repr(float(x)) for x in numbers))]
    ET.indent(root)
    return ET.tostring(root, "unicode") + "\n"


def perspective(camera: Camera, eye: np.ndarray) -> dict[str, Any]:
    """Mitsuba's own camera at `eye` (3,) of its world, with fx and no distortion; it looks along +z, x left, y up."""
    import mitsuba as mi

    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.transpose(camera.R_cam_board) * (-1, -1, 1), eye
    w, h = camera.image_size
    film = {"type": "hdrfilm", "width": w, "height": h, "pixel_format": "rgb", "component_format": "float32"}
    return {
        "type": "perspective", "fov_axis": "x", "fov": float(np.degrees(2 * np.arctan(w / (2 * camera.fx)))),
        "principal_point_offset_x": (w / 2 - (camera.cx + 0.5)) / w,
        "principal_point_offset_y": (h / 2 - (camera.cy + 0.5)) / h,
        "to_world": mi.ScalarTransform4f(pose),
        "film": film | {"rfilter": {"type": "box"}}, "sampler": {"type": "independent", "sample_count": SAMPLES},
    }  # fmt: skip


def _tell_apart(world: dict[str, Any]) -> None:
    """Give each rectangle an albedo of its own, by TOLD_APART.

    Mitsuba merges rectangles of one material as it loads a file, and leaves them out of the scene's bounding box, so
    that the sky leaks through walls (3.9).
    """
    sheets = [thing for thing in world.values() if isinstance(thing, dict) and thing["type"] == "rectangle"]
    for k, sheet in enumerate(sheets):
        red, green, blue = sheet["bsdf"]["bsdf"]["reflectance"]["value"]
        moved = rgb((red + k * TOLD_APART * (-1 if red > 0.5 else 1), green, blue))
        sheet["bsdf"] = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": moved}}
