"""A scene record as a Mitsuba scene, placed so that float32 holds it. Axes are the board's.

Float32 keeps 2⁻²⁴ of a coordinate. So the origin lies where the scene is: at the eye, or before a scene that is small
beside its distance, where the rays then begin, too. The unit is a power of two, which rounds nothing, that makes the
scene some 1024 units large: Mitsuba lifts secondary rays by 9e-5 (1 + max|p|), whose 1 would be coarse in metres.
"""

from collections.abc import Iterator, Mapping
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from raytwin.scene import Environment, Scene, Sphere
from raytwin.twin import phong

SIZE = 1024
"""The scene's size in Mitsuba's unit, to a factor of two."""

SHADOW_OFFSET = 4e-6
"""Shadow rays start so far off the surface, as a share of the distance from the origin: 64 float32 steps.

Mitsuba's own 9e-5 moves edges by 0.04 px: in `eclipse` at 160 x 120 more than 1e-4 of the pixels were off.
"""

SPHERE_OFFSET = 2.0**-22
"""The same as a share of the largest radius, whose square float32 rounds: a ground of 100 km shades itself in 8770 of
19 200 pixels with Mitsuba's own offset, in 12 with this one."""

MAX_CORNER_RATIO = 100.0
"""A rectangle is divided where its corners are so many times farther from the eye than its nearest point.

Float32 keeps a rectangle's points to 2⁻²⁴ of its size, so that bounced rays may start behind it: 5 mm beside the edge
of two sheets of 1 km they brought 11 % too little light, undivided.
"""
MOST_STEPS = 4
"""Divisions to each side: the last is at 1e8 times the distance."""

TO_ENVMAP = np.array(((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)))
"""The map's axes -> those of Mitsuba's `envmap`, whose y is up and whose middle is along +z, with +x to the left."""


class Place(NamedTuple):
    """Mitsuba's world. Its axes are the board's.

    `origin` (3,): in the board's frame, metres. `unit`: Mitsuba's lengths per metre. `eye` (3,): in Mitsuba's world,
    exact in float32. `start`: distance from the eye at which rays begin, in Mitsuba's lengths; no object is nearer.
    """

    origin: np.ndarray
    unit: float
    eye: np.ndarray
    start: float

    def at(self, point: Any) -> np.ndarray:
        """A point (3,) of the board's frame in Mitsuba's world, float64."""
        return np.asarray((np.asarray(point) - self.origin) * self.unit)


def place_of(scene: Scene) -> Place:
    """The origin before the scene, as far as the scene is large, or at the eye where the eye is within that."""
    eye = np.asarray(scene.camera.eye)
    if not scene.objects:
        return Place(eye, 1.0, np.zeros(3), 0.0)
    nearest, extent = [], []  # from the eye to each object's nearest point, and how large the object is
    for ball in scene.spheres:
        middle = np.asarray(ball.center) - eye
        nearest.append(middle * (1 - ball.radius / (float(np.linalg.norm(middle)) or 1.0)))
        extent.append(ball.radius)
    for flat in scene.planes:
        middle, edges = np.asarray(flat.center) - eye, np.stack([flat.half_u, flat.half_v])
        nearest.append(middle + np.clip(-(edges @ middle) / np.square(edges).sum(axis=1), -1, 1) @ edges)
        extent.append(float(np.linalg.norm(edges)))
    distance, middle = np.linalg.norm(nearest, axis=1), np.mean(nearest, axis=0)
    # An object that is larger than it is far from the eye counts as large as that.
    size = float((np.linalg.norm(nearest - middle, axis=1) + np.minimum(extent, distance)).max()) or 1.0
    unit = 2.0 ** np.floor(np.log2(SIZE / size))
    if (far := float(np.linalg.norm(middle))) <= size:
        return Place(eye, unit, np.zeros(3), 0.0)
    rounded = (-middle * (1 - size / far) * unit).astype(np.float32).astype(float)
    return Place(eye - rounded / unit, unit, rounded, max(0.0, float(distance.min()) - size) * unit)


def load(world: dict[str, Any]) -> Any:
    """The Mitsuba object, without `optimize`.

    That would merge rectangles of one albedo: ids are lost, and the merged mesh is missing from the scene's bounding
    box, so that the sky's shadow rays are too short and light leaks through walls (Mitsuba 3.9).
    """
    import mitsuba as mi

    return mi.load_dict(world, optimize=False)


def translate(scene: Scene, place: Place, textures: Mapping[int, np.ndarray]) -> dict[str, Any]:
    """The dictionary for `load`: object i is `object-i`, or its parts `object-i-0` and so on (`number_of`)."""
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
        to_eye = (np.asarray(scene.camera.eye) - thing.center) @ axes
        for k, sides in enumerate([np.stack([-half, half], axis=1)] if i in textures else _divided(half, to_eye)):
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


def _divided(half: np.ndarray, eye: np.ndarray) -> Iterator[np.ndarray]:
    """Parts of the rectangle that reaches `half` (2,) to either side: (2, 2), from and to along each edge, metres.

    `eye` (3,): in the rectangle's axes. The part about its nearest point is small, those around it are large and far.
    """
    nearest = np.clip(eye[:2], -half, half)
    gap = float(np.linalg.norm([*(nearest - eye[:2]), eye[2]])) or np.inf  # no division helps an eye in the rectangle
    steps = gap * MAX_CORNER_RATIO ** np.arange(1, MOST_STEPS + 1)
    for u, v in product(*(pairwise(np.unique([-h, *np.clip([*(at - steps), *(at + steps)], -h, h), h]))
                          for at, h in zip(nearest, half, strict=True))):  # fmt: skip
        yield np.array([u, v])


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
        return rgb(thing.albedo)
    import mitsuba as mi

    bitmap = mi.Bitmap(np.ascontiguousarray(texture[::-1]))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "bilinear", "wrap_mode": "clamp"}


def read_textures(textures: Mapping[int, np.ndarray] | None) -> dict[int, np.ndarray]:
    """The textures as float32 (h, w, 1 or 3) by object id. Mitsuba takes no fewer than 2 x 2 texels."""
    read = {}
    for i, texture in sorted((textures or {}).items()):
        a = np.atleast_3d(np.asarray(texture, np.float32))
        read[i] = np.repeat(np.repeat(a, 1 + (a.shape[0] == 1), 0), 1 + (a.shape[1] == 1), 1)
    return read
