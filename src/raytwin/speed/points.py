"""The tracer at any points of the image plane: what speculation and drawing into photos ask for."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec
import numpy as np

from raytwin.array_types import Bool, Float32, Int32
from raytwin.arrays import Vec, dot, integers, select
from raytwin.image import BACKGROUND
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, Shape
from raytwin.scene.lens import has_no_ray
from raytwin.speed.boxes import trim_boxes
from raytwin.speed.engine import ENGINES, evaluate, from_numpy, to_numpy
from raytwin.speed.fast_world import FastWorld, Ray
from raytwin.speed.frame import EyeScene
from raytwin.tracer.hit import Hit
from raytwin.tracer.pixel_to_ray import to_board
from raytwin.tracer.render_image import EYE
from raytwin.tracer.shading import RADIANCE
from raytwin.tracer.world import first_hit, hides

CHUNK = 1 << 14
"""Points that NumPy traces at a time: they stay in the cache."""


LIT, AWAY = -1, -2
"""Values of `blocker`: nothing hides the sun; the surface is turned away from it, or there is no surface."""


class Points(NamedTuple):
    """Per ray (m,): `colour` (m, 3), `ids`, `blocker`: id of an object that hides the sun there, LIT or AWAY; `point`
    (m, 3): from the eye, board's axes."""

    colour: Float32[np.ndarray, "m 3"]
    ids: Int32[np.ndarray, " m"]
    blocker: Int32[np.ndarray, " m"]
    point: Float32[np.ndarray, "m 3"] | None

    @property
    def lit(self) -> Bool[np.ndarray, " m"]:
        """(m,): the sun reaches it."""
        return np.asarray(self.blocker == LIT)


def trace_points(
    scene: Scene, u: np.ndarray, v: np.ndarray, rung: str, engine: str, light: bool = True, point: bool = False
) -> Points:
    """What the rays through pixels (u, v) (m,) see; `blocker` is found where `light` asks for it, `point` likewise."""
    view, m = EyeScene(scene, ENGINES[engine]), len(u)
    colour, ids, blocker = np.empty((m, 3), np.float32), np.empty(m, np.int32), np.full(m, AWAY, np.int32)
    place = np.empty((m, 3), np.float32) if point else None
    shaded = RUNGS[rung].shadows
    for part, world in _parts(view, u, v):
        with np.errstate(all="ignore"):
            hit = first_hit(world, EYE, view.ray(*(from_numpy(view.engine, a[part]) for a in (u, v))))
            layers = [(colour[part], RADIANCE[rung](hit, view.light, world, view.camera)), (ids[part], (hit.ids,))]
            if light:
                facing = (hit.ids >= 0) & (dot(hit.normal, view.light.to_sun) > 0)
                blocked_by = _blocker(hit, view.light.to_sun, world) if shaded else integers(hit.t, LIT)
                layers.append((blocker[part], (select(facing, blocked_by, AWAY),)))
            if place is not None:
                layers.append((place[part], to_board(hit.point, view.camera)))
        evaluate(view.engine, [values for _, values in layers])
        for out, values in layers:
            columns = out.reshape(len(out), -1)
            for c, value in enumerate(values):
                columns[:, c] = to_numpy(value, (len(out),))
    lost = has_no_ray(scene.camera, u, v)
    colour[lost], ids[lost], blocker[lost] = 0, BACKGROUND, AWAY
    return Points(colour, ids, blocker, place)


def _blocker(hit: Hit, to_sun: Vec, world: FastWorld) -> Any:
    """The id of the last object in the world's order that hides the sun, by the test of `World.blocked`; else LIT."""

    def block(state: Any, ray: Any, index: Any, thing: Shape) -> Any:
        return (select(hides(ray.start, ray.d, thing, index, world.stages), index, state[0]),)

    none = (select(hit.inside, hit.ids, LIT),)
    return world.casters.fold(Ray(hit.point, to_sun, hit), none, block)[0]


def _parts(view: EyeScene, u: np.ndarray, v: np.ndarray) -> Iterator[tuple[slice, FastWorld]]:
    """The points in portions, each with the objects that it may see; any object may shade these."""
    if len(u) and view.engine.is_numpy:
        camera = view.local.camera  # the lattice's last points may lie beyond its frame
        size = max(camera.width, int(u.max()) + 2), max(camera.height, int(v.max()) + 2)
        x0, y0, x1, y1 = trim_boxes(view.local.objects, msgspec.structs.replace(camera, image_size=size)).T
        for start in range(0, len(u), CHUNK):
            part = slice(start, start + CHUNK)
            x, y = u[part], v[part]
            near = (x0 - 1 < x.max()) & (x.min() < x1) & (y0 - 1 < y.max()) & (y.min() < y1)
            yield part, view.near(np.flatnonzero(near).tolist())
    elif len(u):
        yield slice(None), view.everywhere
