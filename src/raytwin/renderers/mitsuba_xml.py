"""A scene as a Mitsuba 3 file, which Mitsuba renders as the twin does; what the file cannot say is reported.

Its world has the board's axes, so that sheets along them are not tilted by rounding; the eye is at 0 and the unit is
1/1024 m, because Mitsuba lifts secondary rays by an amount that is coarse in metres.
"""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from raytwin.errors import InputError
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Rectangle, Scene, Shape
from raytwin.scene.lens import newton

SAMPLES = 64
"""A pixel, unless the renderer is asked for others (`mitsuba -D spp=256`)."""

UNIT = 1024.0
"""Mitsuba's lengths per metre."""

LARGE = 100.0
"""Size over distance from the eye, from which on Mitsuba's float32 may shade an object with itself."""

NEAR, FAR = 1e-3, 1e6
"""Metres: the camera sees from here to there, and further where an object lies further."""

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
        f"<!-- The board's axes, z out of its printed face; the eye at 0; 1/{UNIT:g} m; linear Rec. 709. -->",
        '<scene version="3.0.0">',
        f'  <default name="spp" value="{SAMPLES}"/>',
        f'  <integrator type="path"><integer name="max_depth" value="{RUNGS[rung].depth}"/>',
        f'    <integer name="rr_depth" value="{RUNGS[rung].depth}"/></integrator>',
        *_sensor(scene),
        *_shapes(scene),
    ]
    if any(scene.sun.irradiance):
        direction = _vector("direction", -np.array(scene.sun.to_light))
        lines.append(f'  <emitter type="directional">{direction}{_rgb("irradiance", scene.sun.irradiance)}</emitter>')
    if any(scene.sky_radiance):
        lines.append(f'  <emitter type="constant">{_rgb("radiance", scene.sky_radiance)}</emitter>')
    return "\n".join((*lines, "</scene>", ""))


def moved_by(scene: Scene) -> float:
    """Pixels: how far, at most, the file's camera sees something from where the scene's camera does."""
    camera = scene.camera
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0, camera.width - 1, 33), np.linspace(0, camera.height - 1, 33)))
    x, y = newton((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, camera.coefficients)
    return float(np.hypot(camera.fx * x + camera.cx - u, camera.fx * y + camera.cy - v).max())


def too_large_for_mitsuba(scene: Scene) -> list[int]:
    """The ids of the objects that float32 cannot hold: Mitsuba may shade these with themselves; the twin does not."""
    eye = np.array(scene.camera.eye)
    found = []
    for i, thing in enumerate(scene.objects):
        away = np.array(thing.center) - eye
        gap = away @ thing.normal if isinstance(thing, Rectangle) else np.linalg.norm(away) - thing.radius
        if _size(thing) > LARGE * abs(gap):
            found.append(i)
    return found


def _sensor(scene: Scene) -> list[str]:
    """Mitsuba's camera looks along +z with x to the left and y up. It sees nothing beyond `far_clip`."""
    camera = scene.camera
    pose = np.eye(4)
    pose[:3, :3] = np.array(camera.R_cam_board).T * [-1, -1, 1]
    fov = np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))
    numbers = {
        "fov": fov,
        "near_clip": NEAR * UNIT,
        "far_clip": max(FAR, 2 * _reach(scene)) * UNIT,
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


def _reach(scene: Scene) -> float:
    """Metres from the eye to the furthest point of any object."""
    eye = np.array(scene.camera.eye)
    return max((float(np.linalg.norm(thing.center - eye)) + _size(thing) for thing in scene.objects), default=0.0)


def _size(thing: Shape) -> float:
    """Metres from an object's centre to its furthest point, at most."""
    if isinstance(thing, Rectangle):
        return float(np.linalg.norm(thing.half_u) + np.linalg.norm(thing.half_v))
    return thing.radius


def _shapes(scene: Scene) -> Iterator[str]:
    """The objects; of rectangles of the same albedo each one's red is moved by another 1e-7.

    Mitsuba merges rectangles of one material as it loads a file, and leaves them out of the scene's bounding box, so
    that the sky leaks through walls (3.9).
    """
    same: Counter[Sequence[float]] = Counter()
    for i, thing in enumerate(scene.objects):
        red, *others = albedo = thing.material.albedo
        if isinstance(thing, Rectangle):
            moved = same[albedo] * 1e-7
            same[albedo] += 1
            red = red - moved if red > 0.5 else red + moved
        yield from _shape(f"object-{i}", thing, (red, *others), scene.camera)


def _shape(name: str, thing: Shape, albedo: Sequence[float], camera: Camera) -> list[str]:
    center = (np.array(thing.center) - camera.eye) * UNIT
    if isinstance(thing, Rectangle):
        pose = np.eye(4)
        pose[:3, :3] = np.stack([thing.half_u, thing.half_v, thing.normal], axis=1) * UNIT
        pose[:3, 3] = center
        kind, place = "rectangle", _matrix(pose)
    else:
        kind, place = "sphere", f'{_vector("center", center)}<float name="radius" value="{thing.radius * UNIT!r}"/>'
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
