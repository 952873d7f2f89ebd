"""The whole tracer: for every pixel a ray, for every ray the nearest object, for every hit its radiance."""

import numpy as np

from raytwin.errors import InputError
from raytwin.image import BACKGROUND, Image, Surface
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, seen_from_eye
from raytwin.scene.lens import check_lens
from raytwin.tracer.camera import back_project, to_board, undistort
from raytwin.tracer.hit import Every, Stages, World, nearer, normal
from raytwin.tracer.light import RADIANCE, lambert, lighting, sun_visible
from raytwin.tracer.rectangle import intersect_rectangle
from raytwin.tracer.sphere import intersect_sphere

EYE = (0.0, 0.0, 0.0)
STAGES = Stages(undistort, back_project, intersect_sphere, intersect_rectangle, nearer, normal, lambert, sun_visible)


def trace(scene: Scene, rung: str = "shadow", stages: Stages = STAGES) -> Image:
    """Radiance and surface of what each pixel's centre sees, in float64 and without any shortcut.

    `raytwin.speed.trace` gives the same, fast. Raises InputError for an unknown rung, or a lens that cannot be undone.
    """
    if rung not in RADIANCE:
        raise InputError("rung", f"one of {', '.join(RADIANCE)}", rung)
    check_lens(camera := scene.camera)
    local = seen_from_eye(scene)
    every, light = Every(local.objects), lighting(local)
    world = World(every, every, lambda: every, stages)
    sky = light.sky if RUNGS[rung].background else (0.0, 0.0, 0.0)
    with np.errstate(all="ignore"):  # infinities and NaN of missed rays are selected away
        u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
        hit = world.nearest(EYE, stages.back_project(u, v, camera, stages.undistort))
        seen = hit.ids > BACKGROUND
        radiance = RADIANCE[rung](hit, light, world, camera)
        mean = np.stack([np.where(seen, L, Ls) for L, Ls in zip(radiance, sky, strict=True)], axis=-1)
        normal = np.stack([np.where(seen, n, 0) for n in to_board(hit.normal, camera)], axis=-1)
        depth = np.where(seen, hit.t, 0)
    surface = Surface(hit.ids.astype(np.int32), depth.astype(np.float32), normal.astype(np.float32))
    return Image(mean.astype(np.float32), surface=surface)
