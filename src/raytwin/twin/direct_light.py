"""Direct light by NumPy: where Mitsuba's compiled kernels do not compute it, and where float64 decided the hit."""

from math import pi

import numpy as np

from raytwin.scene import Scene
from raytwin.twin.phong import highlights, pi_f
from raytwin.twin.sky import sky_of


def albedos(scene: Scene) -> np.ndarray:
    """Each object's albedo, by id (n + 1, 3): the last row, which id -1 finds, is the black of no object."""
    return np.array([*(thing.material.albedo for thing in scene.objects), (0.0, 0.0, 0.0)])


def sunlight(scene: Scene, normal: np.ndarray, blocker: np.ndarray) -> np.ndarray:
    """E/π V max(0, n·l), (k, 3), for normals (k, 3) in the board frame and the ids (k,) of what hides the sun."""
    cosine = np.maximum(normal @ np.asarray(scene.sun.to_light), 0)
    return np.asarray(scene.sun.irradiance) / pi * np.where(blocker < 0, cosine, 0)[:, None]


def first_light(
    scene: Scene,
    ids: np.ndarray,
    albedo: np.ndarray,
    normal: np.ndarray,
    d: np.ndarray,
    blocker: np.ndarray,
    sky_at_hit: bool,
) -> np.ndarray:
    """f E V max(0, n·l) (+ (albedo + specular) Ls) where rays along d hit something, Ls elsewhere: (k, 3)."""
    colour = pi_f(scene, ids, albedo, normal, d, scene.sun.to_light) * sunlight(scene, normal, blocker)
    if sky_at_hit:
        colour = colour + (albedo + highlights(scene)[ids, :3]) * sky_of(scene).diffuse_irradiance(normal)
    missed = ids < 0
    colour[missed] = sky_of(scene).radiance(d[missed])
    return colour
