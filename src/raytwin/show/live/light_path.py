"""The light path of a pixel: the eye's ray, what it hits, the ray to the sun, and each bounce.

`tracer.path.bounce` takes each step, with the random numbers that `tracer.trace_paths` draws: the mean of `light` over
a pixel's samples is the pixel.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from raytwin.fast.sampling import BATCHES, sobol_pair
from raytwin.images.image import BACKGROUND
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Scene, to_camera_frame
from raytwin.scene.lens import distort
from raytwin.tracer import STAGES
from raytwin.tracer.arrays import Vec, dot
from raytwin.tracer.hit import Hit, World
from raytwin.tracer.lights import lighting
from raytwin.tracer.path import bounce, sample_environment, sunlight
from raytwin.tracer.render_image import EYE
from raytwin.tracer.shading import RADIANCE
from raytwin.tracer.world import PlainWorld, first_hit

Pixel = tuple[float, float]
SEED = 0
"""Seed of the random numbers, as in the tracer's first pass."""
NEAR_METRES = 1e-3
"""Metres: lines are cut this far before the eye, since what lies behind it has no place in the picture."""


class Leg(NamedTuple):
    """A straight piece of the path from one pixel to another, and its light: `kind` is eye, bounce, sun, shadow (a
    ray to the sun that is blocked) or sky (from one place to itself: all of it, unhidden)."""

    kind: str
    start: Pixel
    end: Pixel
    light: tuple[float, float, float]


class LightPath(NamedTuple):
    """`legs` from the eye on; `met`: the names of what was hit; `light`: the sum over the legs."""

    legs: tuple[Leg, ...]
    met: tuple[str, ...]
    light: tuple[float, float, float]


def light_path(scene: Scene, x: int, y: int, rung: str, depth: int, sample: int) -> LightPath:
    """Return the path of pixel (x, y) at a light level, in float64: of one sample, where the level is sampled."""
    row = RUNGS[rung]
    local = to_camera_frame(scene)
    world, light = PlainWorld(local.objects, STAGES), lighting(local)
    project = partial(_project, scene.camera)
    u, v = np.array([float(x)]), np.array([float(y)])
    numbers = partial(sobol_pair, u, np.array([y * scene.camera.width + x]), sample % BATCHES, sample // BATCHES, SEED)
    if row.noisy:
        a, b = numbers(0)
        u, v = u + a - 0.5, v + b - 0.5
    far = 4 * max((float(np.linalg.norm(thing.center)) for thing in local.objects), default=1.0)
    with np.errstate(all="ignore"):
        d = STAGES.back_project(u, v, scene.camera)
        hit = first_hit(world, EYE, d)
        at = (float(u[0]), float(v[0]))
        if int(hit.ids[0]) == BACKGROUND:
            sky = _three(_colour(light.sky.radiance(d)) if row.background else EYE)
            return LightPath((Leg("eye", at, at, sky),), ("the sky",), sky)
        legs, met = [Leg("eye", at, at, (0.0, 0.0, 0.0))], [scene.names[int(hit.ids[0])]]
        if not row.noisy:
            colour = _colour(RADIANCE[rung](hit, light, world, scene.camera))
            if row.lit:
                ambient = _colour(hit.albedo) * _colour(light.sky.diffuse_irradiance(hit.normal))
                rays = _to_sun(hit, world, light.to_sun, far, project, row.shadows)
                legs += [leg._replace(light=_three(colour - ambient)) for leg in rays]
                legs.append(Leg("sky", at, at, _three(ambient)))
            return LightPath(tuple(legs), tuple(met), _three(colour))
        weight = np.ones(3)
        for k in range((2 if row.depth == 2 else depth) - 1):
            direct, there, share = bounce(k, hit, light, world, numbers)
            sun = weight * _colour(sunlight(hit, light, world))
            sky = weight * _colour(direct) - sun
            legs += [leg._replace(light=_three(sun)) for leg in _to_sun(hit, world, light.to_sun, far, project, True)]
            if light.sky.sampled:
                drawn = weight * _colour(sample_environment(hit, light, world, *numbers(~k)))
                sky -= drawn
                legs.append(Leg("sky", project(hit.point), project(hit.point), _three(drawn)))
            if int(there.ids[0]) == BACKGROUND:
                end = project([p + far * c for p, c in zip(hit.point, there.d, strict=True)], hit.point)
                legs.append(Leg("sky", project(hit.point), end, _three(sky)))
                met.append("the sky")
                break
            legs.append(Leg("bounce", project(hit.point), project(there.point, hit.point), (0.0, 0.0, 0.0)))
            met.append(scene.names[int(there.ids[0])])
            hit, weight = there, weight * _colour(share)
    return LightPath(tuple(legs), tuple(met), _three(np.sum([leg.light for leg in legs], axis=0)))


def _to_sun(
    hit: Hit, world: World, to_sun: Vec, far: float, project: Callable[..., Pixel], shadows: bool
) -> Iterator[Leg]:
    """The ray to the sun, where the surface faces it."""
    if _one(dot(hit.normal, to_sun)) <= 0:
        return
    blocked = shadows and bool(_one(world.blocked(hit, to_sun)))
    reach = far
    if blocked:
        x, y, z = (np.full(1, _one(c)) for c in to_sun)
        t, _ = world.closest_hit(hit.point, (x, y, z), hit)
        reach = float(t[0]) if np.isfinite(t[0]) else far
    end = [p + reach * _one(c) for p, c in zip(hit.point, to_sun, strict=True)]
    yield Leg("shadow" if blocked else "sun", project(hit.point), project(end, hit.point), (0.0, 0.0, 0.0))


def _project(camera: Camera, point: Sequence[Any], start: Sequence[Any] | None = None) -> Pixel:
    """Where the camera sees a point of its own frame; of the line from `start`, the last place before the eye."""
    p = np.array([_one(c) for c in point])
    if p[2] < NEAR_METRES:
        q = np.array([_one(c) for c in start or point])
        p = q + (p - q) * max(0.0, (q[2] - NEAR_METRES) / max(q[2] - p[2], 1e-12)) if q[2] > NEAR_METRES else q
        p[2] = max(p[2], NEAR_METRES)
    x, y = distort(p[0] / p[2], p[1] / p[2], camera.coefficients)
    return float(camera.fx * x + camera.cx), float(camera.fy * y + camera.cy)


def _one(value: Any) -> float:
    return float(np.asarray(value).reshape(-1)[0])


def _colour(values: Sequence[Any]) -> np.ndarray:
    return np.array([_one(value) for value in values])


def _three(colour: Sequence[Any] | np.ndarray) -> tuple[float, float, float]:
    r, g, b = (float(c) for c in colour)
    return r, g, b
