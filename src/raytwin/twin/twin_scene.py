"""A scene record as a Mitsuba scene, placed so that float32 holds it. Axes are the board's.

Float32 keeps 2⁻²⁴ of a coordinate. So the origin lies where the scene is: at the eye, or before a scene that is small
beside its distance, where the rays then begin, too. The unit is a power of two, which rounds nothing, that makes the
scene some 1024 units large: Mitsuba lifts secondary rays by 9e-5 (1 + max|p|), whose 1 would be coarse in metres.
"""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from raytwin.errors import InputError
from raytwin.scene import Environment, Scene, Sphere
from raytwin.twin import phong

SIZE = 1024
"""Mitsuba's lengths in the scene's size, to a factor of two."""

SHADOW_OFFSET = 4e-6
"""How far off the surface the sun's shadow rays start, as a part of the distance from the origin: 64 float32 steps.

Random scenes shade themselves at 1e-7, and no longer at 3e-7. Mitsuba's own 9e-5 moves edges by 0.04 px: in 4 of 8
random scenes, and in `eclipse` at 160 x 120, more than 1e-4 of the pixels were off.
"""

SPHERE_OFFSET = 2.0**-22
"""The same as a part of the largest radius, whose square float32 rounds: grounds of 10 and 100 km shade themselves in
894 and 8770 of 19 200 pixels by Mitsuba's own offset, in 4 and 12 with this one."""

MAX_CORNER_RATIO = 100.0
"""Largest distance to a rectangle's corner over that to its nearest point: beyond it a rectangle is divided.

Float32 keeps a rectangle's points to 2⁻²⁴ of its size, so that bounced rays may start behind it: 5 mm beside the edge
of two sheets of 1 km they brought 11 % too little light, undivided.
"""

SMALLEST_GAP = 1e-9
"""The same the other way round, below which the eye lies in the rectangle, and no division helps."""

TO_ENVMAP = np.array(((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)))
"""The map's axes to those of Mitsuba's `envmap`, whose y is up and whose middle is along +z, with +x to the left."""


class Place(NamedTuple):
    """Where the scene lies in Mitsuba's world: `at` takes points of the board there.

    `origin` (3,): metres, board axes. `unit`: Mitsuba's lengths per metre. `eye` (3,): in Mitsuba's world, exact in
    float32. `start`: how far from the eye rays begin, in Mitsuba's lengths, where no object can be.
    """

    origin: np.ndarray
    unit: float
    eye: np.ndarray
    start: float

    def at(self, point: Any) -> np.ndarray:
        """The point (3,) in Mitsuba's world, float64."""
        return np.asarray((np.asarray(point) - self.origin) * self.unit)


def place_of(scene: Scene) -> Place:
    """The origin before the scene, as far as the scene is large, or at the eye where the eye is within that."""
    eye = np.asarray(scene.camera.eye)
    if not scene.objects:
        return Place(eye, 1.0, np.zeros(3), 0.0)
    away, extent = (
        [],
        [ball.radius for ball in scene.spheres],
    )  # from the eye to each object's nearest point, and beyond
    for ball in scene.spheres:
        middle = np.asarray(ball.center) - eye
        away.append(middle * (1 - ball.radius / (float(np.linalg.norm(middle)) or 1.0)))
    for flat in scene.planes:
        middle, edges = np.asarray(flat.center) - eye, np.stack([flat.half_u, flat.half_v])
        away.append(middle + np.clip(-(edges @ middle) / np.square(edges).sum(axis=1), -1, 1) @ edges)
        extent.append(float(np.linalg.norm(edges)))
    distance, middle = np.linalg.norm(away, axis=1), np.mean(away, axis=0)
    # What of an object is further off than the eye is from it counts for no more than that.
    size = float((np.linalg.norm(away - middle, axis=1) + np.minimum(extent, distance)).max()) or 1.0
    far = float(np.linalg.norm(middle))
    unit = 2.0 ** np.floor(np.log2(SIZE / size))
    moved = -middle * max(0.0, 1 - size / far) * unit if far else np.zeros(3)
    rounded = moved.astype(np.float32).astype(float)
    start = max(0.0, float(distance.min()) - size) if rounded.any() else 0.0
    return Place(eye - rounded / unit, unit, rounded, start * unit)


def load(world: dict[str, Any]) -> Any:
    """The Mitsuba object, without `optimize`.

    That would merge rectangles of one albedo: ids are lost, and the merged mesh is missing from the scene's bounding
    box, so that the sky's shadow rays are too short and light leaks through walls (Mitsuba 3.9).
    """
    import mitsuba as mi

    return mi.load_dict(world, optimize=False)


def translate(scene: Scene, place: Place, textures: Mapping[int, np.ndarray]) -> dict[str, Any]:
    """The dictionary for `load`: object i is `object-i`, or its parts `object-i-0` and so on (`number_of`).

    Everything is two-sided, diffuse or Phong's.
    """
    import mitsuba as mi

    if scene.glossy:
        phong.register()
    world: dict[str, Any] = {"type": "scene"}
    for i, thing in enumerate(scene.objects):
        bsdf = {"type": "twosided", "bsdf": phong.bsdf(thing, _albedo(thing, textures.get(i)))}
        if isinstance(thing, Sphere):
            center, radius = place.at(thing.center).tolist(), thing.radius * place.unit
            world[f"object-{i}"] = {"type": "sphere", "center": center, "radius": radius, "bsdf": bsdf}
            continue
        half = np.array([np.linalg.norm(edge) for edge in (thing.half_u, thing.half_v)])
        axes = np.stack([thing.half_u / half[0], thing.half_v / half[1], thing.normal], axis=1)
        whole, to_eye = np.array((-1, 1)) * half[:, None], (np.asarray(scene.camera.eye) - thing.center) @ axes
        for k, sides in enumerate([whole] if i in textures else _divided(whole, to_eye)):
            # A rotation, then a scale: the inverse of their product is coarse where the edges are unlike.
            turn = np.eye(4)
            turn[:3, :3], turn[:3, 3] = axes, place.at(thing.center + axes[:, :2] @ sides.mean(axis=1))
            scale = mi.ScalarTransform4f().scale([*(np.ptp(sides, axis=1) / 2 * place.unit), 1.0])
            to_world = mi.ScalarTransform4f(turn) @ scale
            world[f"object-{i}-{k}"] = {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}
    if any(scene.sun.irradiance):
        direction = [-x for x in scene.sun.to_light]
        world["sun"] = {"type": "directional", "direction": direction, "irradiance": rgb(scene.sun.irradiance)}
    if scene.environment:
        world["sky"] = _envmap(scene.environment)
    elif any(scene.sky.radiance):
        world["sky"] = {"type": "constant", "radiance": rgb(scene.sky.radiance)}
    return world


def _divided(sides: np.ndarray, eye: np.ndarray) -> Iterator[np.ndarray]:
    """Parts of a rectangle from sides[0] to sides[1] (2, 2), metres along its edges, each within MAX_CORNER_RATIO.

    `eye` (3,): in the rectangle's axes. The part about the nearest point is small, those around it are large and far.
    """
    nearest = np.clip(eye[:2], sides[:, 0], sides[:, 1])
    gap = float(np.linalg.norm([*(nearest - eye[:2]), eye[2]]))
    corner = float(np.linalg.norm(np.abs(sides - nearest[:, None]).max(axis=1)))
    if corner <= MAX_CORNER_RATIO * gap or gap < SMALLEST_GAP * corner:
        yield sides
        return
    cuts = [np.unique(np.clip([low, at - MAX_CORNER_RATIO / 4 * gap, at + MAX_CORNER_RATIO / 4 * gap, high], low, high))
            for at, (low, high) in zip(nearest, sides, strict=True)]  # fmt: skip
    for u in pairwise(cuts[0]):
        for v in pairwise(cuts[1]):
            yield from _divided(np.array([u, v]), eye)


def number_of(name: str) -> int:
    """The object's id by the name of its shape."""
    return int(name.split("-")[1])


def rgb(values: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


def _envmap(environment: Environment) -> dict[str, Any]:
    """Mitsuba's columns are as ours (`scene.Environment`), but its first and last row lie on the poles.

    A map of 2 h + 1 rows, with what is midway between ours in between, is the same function.
    """
    import mitsuba as mi

    radiance = environment.radiance
    padded = np.concatenate([radiance[:1], radiance, radiance[-1:]]).astype(np.float64)
    rows = np.empty((2 * len(radiance) + 1, *radiance.shape[1:]), np.float32)
    rows[1::2], rows[::2] = radiance, (padded[:-1] + padded[1:]) / 2
    matrix = np.eye(4)
    matrix[:3, :3] = (TO_ENVMAP @ np.asarray(environment.R_map_board)).T
    return {"type": "envmap", "bitmap": mi.Bitmap(rows), "to_world": mi.ScalarTransform4f(matrix)}


def _albedo(thing: Any, texture: np.ndarray | None) -> dict[str, Any]:
    """A colour, or a bilinear texture: Mitsuba's first row lies at -half_v, ours at +half_v."""
    if texture is None:
        return rgb(thing.material.albedo)
    import mitsuba as mi

    bitmap = mi.Bitmap(np.ascontiguousarray(texture[::-1]))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "bilinear", "wrap_mode": "clamp"}


def check_textures(scene: Scene, textures: Mapping[int, np.ndarray] | None) -> dict[int, np.ndarray]:
    """The textures as float32 (h, w, 1 or 3) by object id; InputError where one does not fit."""
    checked, flat = {}, range(len(scene.spheres), len(scene.objects))
    for i, texture in sorted((textures or {}).items()):
        where, a = f"textures[{i}]", np.asarray(texture, np.float32)
        if i not in flat:
            raise InputError(where, "the id of a rectangle", f"{i}, where these are {[*flat]}")
        a = a[..., None] if a.ndim == 2 else a
        if a.ndim != 3 or a.shape[2] not in (1, 3) or 0 in a.shape:
            raise InputError(where, "an array (h, w) or (h, w, 3)", np.shape(texture))
        if not (a.min() >= 0 and a.max() <= 1):
            raise InputError(where, "albedo from 0 to 1", f"{a.min()} to {a.max()}")
        checked[i] = np.repeat(np.repeat(a, 1 + (a.shape[0] == 1), 0), 1 + (a.shape[1] == 1), 1)  # Mitsuba wants 2 x 2
    return checked
