"""A scene as a Mitsuba 3 file: the board's frame, metres; what the file cannot say is told, not dropped in silence."""

from collections.abc import Sequence

import numpy as np

from raytwin.errors import InputError
from raytwin.rungs import RUNGS
from raytwin.scene import Rectangle, Scene, Shape
from raytwin.scene.lens import newton

SAMPLES = 64
"""A pixel, unless the renderer is told otherwise (`mitsuba -D spp=256`)."""

FOUND = "a rung that Mitsuba's integrators have: sky or path"


def mitsuba_xml(scene: Scene, rung: str = "path") -> str:
    """The text of a file that `mitsuba` and `mi.load_file` take: the rung's depth, a box filter, 32-bit floats.

    Mitsuba's perspective camera has one focal length and no distortion: fx is taken, and `moved_by` says what is lost.
    Raises InputError for a rung without a depth, for a map in the place of the sky, and for highlights.
    """
    scene.check_lambertian("a file of Mitsuba's")
    if rung not in RUNGS or RUNGS[rung].depth is None:
        raise InputError("--rung", FOUND, rung)
    lines = [
        "<?xml version='1.0' encoding='utf-8'?>",
        "<!-- The board's frame in metres, z out of its printed face; colours are linear Rec. 709. -->",
        '<scene version="3.0.0">',
        f'  <default name="spp" value="{SAMPLES}"/>',
        f'  <integrator type="path"><integer name="max_depth" value="{RUNGS[rung].depth}"/>',
        f'    <integer name="rr_depth" value="{RUNGS[rung].depth}"/></integrator>',
        *_sensor(scene),
        *(line for i, thing in enumerate(scene.objects) for line in _shape(f"object-{i}", thing, _apart(scene, i))),
    ]
    if any(scene.sun.irradiance):
        direction = _vector("direction", -np.array(scene.sun.to_light))
        lines.append(f'  <emitter type="directional">{direction}{_rgb("irradiance", scene.sun.irradiance)}</emitter>')
    if any(scene.sky.radiance):
        lines.append(f'  <emitter type="constant">{_rgb("radiance", scene.sky.radiance)}</emitter>')
    return "\n".join((*lines, "</scene>", ""))


def moved_by(scene: Scene) -> float:
    """Pixels: how far, at most, the file's camera sees something from where the scene's camera does."""
    camera = scene.camera
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0, camera.width - 1, 33), np.linspace(0, camera.height - 1, 33)))
    x, y = newton((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, camera.coefficients)
    return float(np.hypot(camera.fx * x + camera.cx - u, camera.fx * y + camera.cy - v).max())


def _sensor(scene: Scene) -> list[str]:
    """Mitsuba's camera looks along +z with x to the left and y up."""
    camera = scene.camera
    R = np.array(camera.R_cam_board)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R.T * [-1, -1, 1], camera.eye
    fov = np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))
    numbers = {
        "fov": fov,
        "near_clip": 1e-3,
        "far_clip": 1e4,
        "principal_point_offset_x": (camera.width / 2 - (camera.cx + 0.5)) / camera.width,
        "principal_point_offset_y": (camera.height / 2 - (camera.cy + 0.5)) / camera.height,
    }
    return [
        '  <sensor type="perspective">',
        '    <string name="fov_axis" value="x"/>',
        *(f'    <float name="{name}" value="{float(value)!r}"/>' for name, value in numbers.items()),
        f"    {_matrix(pose)}",
        '    <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>',
        '    <film type="hdrfilm">',
        f'      <integer name="width" value="{camera.width}"/><integer name="height" value="{camera.height}"/>',
        '      <string name="pixel_format" value="rgb"/><string name="component_format" value="float32"/>',
        '      <rfilter type="box"/>',
        "    </film>",
        "  </sensor>",
    ]


def _apart(scene: Scene, i: int) -> tuple[float, ...]:
    """The object's albedo; where an earlier rectangle has the same, its red moved by 1e-7.

    Mitsuba merges rectangles of one material as it loads a file, and leaves them out of the scene's bounding box, so
    that the sky leaks through walls (3.9).
    """
    thing = scene.objects[i]
    red, *others = thing.material.albedo
    same = sum(t.material.albedo == thing.material.albedo for t in scene.objects[:i] if isinstance(t, Rectangle))
    moved = same * 1e-7 if isinstance(thing, Rectangle) else 0.0
    return (red - moved if red > 0.5 else red + moved, *others)


def _shape(name: str, thing: Shape, albedo: Sequence[float]) -> list[str]:
    if isinstance(thing, Rectangle):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = np.stack([thing.half_u, thing.half_v, thing.normal], axis=1), thing.center
        kind, place = "rectangle", _matrix(pose)
    else:
        kind, place = "sphere", f'{_vector("center", thing.center)}<float name="radius" value="{thing.radius!r}"/>'
    bsdf = f'<bsdf type="twosided"><bsdf type="diffuse">{_rgb("reflectance", albedo)}</bsdf></bsdf>'
    return [f'  <shape type="{kind}" id="{name}">', f"    {place}", f"    {bsdf}", "  </shape>"]


def _vector(name: str, v: Sequence[float] | np.ndarray) -> str:
    x, y, z = (repr(float(c)) for c in v)
    tag = "point" if name == "center" else "vector"
    return f'<{tag} name="{name}" x="{x}" y="{y}" z="{z}"/>'


def _rgb(name: str, v: Sequence[float]) -> str:
    return f'<rgb name="{name}" value="{" ".join(repr(float(c)) for c in v)}"/>'


def _matrix(m: np.ndarray) -> str:
    """By rows."""
    return f'<transform name="to_world"><matrix value="{" ".join(repr(float(x)) for x in m.ravel())}"/></transform>'
