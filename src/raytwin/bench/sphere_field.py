"""A picture full of small spheres: what a method's cost per object shows itself on."""

import msgspec
import numpy as np

from raytwin.scene import Lambert, Scene, Sphere
from raytwin.tracer.pixel_to_ray import back_project, to_board

RADIUS = 0.006
"""Radius of each sphere's image, as a share of the picture's width."""


COLOURS = ((0.8, 0.3, 0.2), (0.2, 0.5, 0.8), (0.3, 0.7, 0.3), (0.8, 0.7, 0.2))


def crowded(scene: Scene, count: int, seed: int = 1) -> Scene:
    """The scene with `count` small spheres, evenly strewn over the picture, in the place of its objects.

    They stand about as far away as the scene's first object; light and camera stay. The colours are few, since Mitsuba
    merges equal materials, and would otherwise choose at each hit among as many as there are spheres.
    """
    camera, rng = scene.camera, np.random.default_rng(seed)
    eye = np.array(camera.eye)
    away = float(np.linalg.norm(np.array(scene.objects[0].center) - eye)) if scene.objects else 1.0
    # The R2 sequence leaves fewer gaps and overlaps than random places.
    at = (0.5 + np.arange(1, count + 1)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])) % 1
    spheres = []
    for (x, y), depth, colour in zip(at, rng.uniform(0.9, 1.1, count), rng.choice(COLOURS, count), strict=True):
        ray = back_project(float(x * camera.width - 0.5), float(y * camera.height - 0.5), camera)
        d = to_board(ray, camera)
        center = eye + away * depth * np.array(d, float)
        radius = RADIUS * camera.width / camera.fx * away * depth
        spheres.append(Sphere(tuple(center.tolist()), radius, Lambert(tuple(colour.tolist()))))
    name = f"{scene.name}-{count}-spheres"
    return msgspec.structs.replace(scene, name=name, objects=tuple(spheres))
