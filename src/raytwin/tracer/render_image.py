"""The whole tracer: for every pixel a ray, for every ray the closest hit, for every hit its radiance."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.images.image import BACKGROUND, Image, Surface
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, to_camera_frame
from raytwin.scene.lens import check_lens, without_ray
from raytwin.tracer.arrays import Vec
from raytwin.tracer.hit import Stages
from raytwin.tracer.lights import Lighting, lighting
from raytwin.tracer.path import Draw, radiance_along_path
from raytwin.tracer.pixel_to_ray import back_project, to_board, undistort
from raytwin.tracer.rectangle import intersect_rectangle
from raytwin.tracer.shading import RADIANCE, lambert, sun_visible
from raytwin.tracer.sphere import intersect_sphere
from raytwin.tracer.world import PlainWorld, first_hit, nearer, normal

EYE = (0.0, 0.0, 0.0)
STAGES = Stages(undistort, back_project, intersect_sphere, intersect_rectangle, nearer, normal, lambert, sun_visible)


def trace(scene: Scene, rung: str = "shadow", stages: Stages = STAGES) -> Image:
    """Return radiance and surface of what each pixel's centre sees of `scene`, in float64 and without any shortcut.

    `rung`: surface, lambert or shadow. `stages`: the tracer's functions, of which one may be replaced.

    `raytwin.fast.trace` gives the same pixels faster. Pixels to which the lens assigns no ray are black. Raises
    InputError for an unknown rung, or for a lens that can be inverted on less than half of the frame.
    """
    if rung not in RADIANCE:
        raise InputError("rung", f"one of {', '.join(RADIANCE)}", rung)
    u, v, light, world = _set_up(scene, stages)
    with np.errstate(all="ignore"):  # infinities and NaN of missed rays are selected away
        hit = first_hit(world, EYE, stages.back_project(u, v, scene.camera, stages.undistort))
        seen = hit.ids > BACKGROUND
        sky = light.sky.radiance(hit.d) if RUNGS[rung].background else EYE
        mean = _picture(seen, RADIANCE[rung](hit, light, world, scene.camera), sky)
        normal = _picture(seen, to_board(hit.normal, scene.camera), EYE)
        depth = np.where(seen, hit.t, 0)
    surface = Surface(hit.ids.astype(np.int32), depth.astype(np.float32), normal.astype(np.float32))
    return Image(mean.astype(np.float32), surface=surface).blacken(without_ray(scene.camera))


def trace_paths(scene: Scene, draws: Sequence[Draw], depth: int = 8, stages: Stages = STAGES) -> Image:
    """Return the mean radiance over each pixel's area by paths of up to `depth` - 1 surfaces; float64, no shortcut.

    One path per pixel for each of `draws`, whose numbers are (H, W). `raytwin.fast.walk` gives the same, fast, and its
    variance, with the numbers of `raytwin.fast.sampling`.
    """
    u, v, light, world = _set_up(scene, stages)
    total = np.zeros((*u.shape, 3))
    with np.errstate(all="ignore"):
        for draw in draws:
            a, b = draw(0)
            d = stages.back_project(u + a - 0.5, v + b - 0.5, scene.camera, stages.undistort)
            hit = first_hit(world, EYE, d)
            L = radiance_along_path(hit, light, world, draw, depth)
            total += _picture(hit.ids > BACKGROUND, L, light.sky.radiance(d))
    samples = len(draws)
    return Image((total / samples).astype(np.float32), samples=samples).blacken(without_ray(scene.camera))


def _set_up(scene: Scene, stages: Stages) -> tuple[np.ndarray, np.ndarray, Lighting, PlainWorld]:
    """Pixel centres u, v (h, w); light and world in the camera's frame."""
    check_lens(scene.camera)
    local = to_camera_frame(scene)
    u, v = np.meshgrid(*(np.arange(side, dtype=float) for side in scene.camera.image_size))
    return u, v, lighting(local), PlainWorld(local.objects, stages)


def _picture(seen: Any, colour: Vec, otherwise: Vec) -> np.ndarray:
    return np.stack([np.where(seen, c, o) for c, o in zip(colour, otherwise, strict=True)], axis=-1)
