"""The whole tracer: for every pixel a ray, for every ray the nearest object, for every hit its radiance."""

from functools import partial
from typing import Any

import numpy as np

from raytwin.arrays import Vec
from raytwin.errors import InputError
from raytwin.image import BACKGROUND, Image, Surface
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, to_camera_frame
from raytwin.scene.lens import check_lens, without_ray
from raytwin.tracer.hit import Every, Stages, World, nearer, normal
from raytwin.tracer.path import follow
from raytwin.tracer.pixel_to_ray import back_project, to_board, undistort
from raytwin.tracer.random import draw, places
from raytwin.tracer.rectangle import intersect_rectangle
from raytwin.tracer.shading import RADIANCE, Lighting, lambert, lighting, sun_visible
from raytwin.tracer.sphere import intersect_sphere

EYE = (0.0, 0.0, 0.0)
STAGES = Stages(undistort, back_project, intersect_sphere, intersect_rectangle, nearer, normal, lambert, sun_visible)


def trace(scene: Scene, rung: str = "shadow", stages: Stages = STAGES) -> Image:
    """Radiance and surface of what each pixel's centre sees, in float64 and without any shortcut.

    `raytwin.speed.trace` gives the same, fast. Pixels that the lens gives no ray are black. Raises InputError for an
    unknown rung, or a lens that can be undone over less than half of the frame.
    """
    if rung not in RADIANCE:
        raise InputError("rung", f"one of {', '.join(RADIANCE)}", rung)
    u, v, light, world = _look(scene, stages)
    with np.errstate(all="ignore"):  # infinities and NaN of missed rays are selected away
        hit = world.nearest(EYE, stages.back_project(u, v, scene.camera, stages.undistort))
        seen = hit.ids > BACKGROUND
        sky = light.toward(hit.d) if RUNGS[rung].background else EYE
        mean = _picture(seen, RADIANCE[rung](hit, light, world, scene.camera), sky)
        normal = _picture(seen, to_board(hit.normal, scene.camera), EYE)
        depth = np.where(seen, hit.t, 0)
    surface = Surface(hit.ids.astype(np.int32), depth.astype(np.float32), normal.astype(np.float32))
    return Image(mean.astype(np.float32), surface=surface).blacken(without_ray(scene.camera))


def trace_paths(scene: Scene, depth: int = 8, samples: int = 16, seed: int = 0, stages: Stages = STAGES) -> Image:
    """The mean radiance over each pixel's area by random walks of up to `depth` - 1 surfaces; float64, no shortcut.

    `raytwin.speed.walk` gives the same, fast, and its variance.
    """
    u, v, light, world = _look(scene, stages)
    pixel, total = np.arange(u.size).reshape(u.shape), np.zeros((*u.shape, 3))
    with np.errstate(all="ignore"):
        for batch, place in places(samples):
            numbers = partial(draw, u, pixel, batch, place, seed & 0xFFFFFFFF)
            a, b = numbers(0)
            hit = world.nearest(EYE, stages.back_project(u + a - 0.5, v + b - 0.5, scene.camera, stages.undistort))
            found = follow(hit, light, world, numbers, depth)
            total += _picture(hit.ids > BACKGROUND, found[0], light.toward(hit.d))
    return Image((total / samples).astype(np.float32), samples=samples).blacken(without_ray(scene.camera))


def _look(scene: Scene, stages: Stages) -> tuple[np.ndarray, np.ndarray, Lighting, World]:
    """Pixel centres u, v (h, w); light and world as the eye has them."""
    check_lens(camera := scene.camera)
    local = to_camera_frame(scene)
    every = Every(local.objects)
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    return u, v, lighting(local), World(every, every, lambda: every, stages)


def _picture(seen: Any, colour: Vec, otherwise: Vec) -> np.ndarray:
    return np.stack([np.where(seen, c, o) for c, o in zip(colour, otherwise, strict=True)], axis=-1)
