"""Light followed by random walks from what the eye sees: what mistakes of sampling change is predicted from them."""

from math import pi
from typing import NamedTuple

import numpy as np

from raytwin.diagnose.predict import RIGHT, Array, Predictor
from raytwin.tracer import sample_cosine_hemisphere


class Walks(NamedTuple):
    """Light followed from S random walks a pixel, by the surfaces k = 0, 1, ... that each met.

    `weight` (K, 3, N, S): the product of the albedos up to k; `cos` (K, N, S): of the direction that leaves k; `sun`
    (K, 3, N, S): E/π V max(0, n·l) there; `sky` (K, 3, N, S): its radiance where the walk leaves the scene.
    """

    weight: Array
    cos: Array
    sun: Array
    sky: Array


def gathered(walks: Walks) -> Array:
    """Σ weight (sun + sky), the mean over walks: (N, 3). Directions have density cos/π, which cancels cosine and π."""
    return np.asarray((walks.weight * (walks.sun + walks.sky)).sum(axis=0).mean(axis=-1).T)


def walk(start: Predictor, samples: int, depth: int, seed: int = 1) -> Walks:
    """Random walks of the right tracer, up to so many surfaces."""
    rng, seen, scene, space = np.random.default_rng(seed), start.seen(), start.described(RIGHT), start.functions(RIGHT)
    things, sun, sky = scene["things"], scene["sun"], scene["sky"]["radiance"]
    albedos = np.array([*(thing["albedo"] for thing in things), np.zeros(3)])
    eye = -scene["R_cam_board"].T @ scene["t_cam_board"]
    points, normals, ids = (np.repeat(x, samples, axis=0) for x in (seen.points, seen.normals, seen.ids))
    weight, rows = np.ones(points.shape), []
    for _ in range(depth):
        weight = weight * albedos[ids]
        cos, visible, met = normals @ sun["to_light"], np.zeros(ids.size, bool), ids >= 0
        if met.any():
            visible[met] = space["sun_visible"](points[met], normals[met], ids[met], sun["to_light"], eye, things)
        lit = sun["irradiance"] / pi * (visible * np.maximum(cos, 0))[:, None]
        d = np.stack(sample_cosine_hemisphere(tuple(normals.T), *rng.random((2, ids.size))), axis=-1)
        t = np.array(space["intersect_all"](points, d, things))
        t[np.maximum(ids, 0), np.arange(ids.size)] = np.inf  # convex: not met again from outside
        which, reach = space["nearest"](t)
        after = np.where(met, which, -1)
        rows.append((weight, np.maximum((normals * d).sum(axis=-1), 0), lit, sky * ((after < 0) & met)[:, None]))
        eyes, points = points, points + np.where(after >= 0, reach, 0)[:, None] * d
        ids, normals = after, space["normals_at"](points, after, eyes, things)
    size = seen.ids.size, samples
    weights, cosines, suns, skies = (np.stack(column) for column in zip(*rows, strict=True))
    colours = (x.reshape(depth, *size, 3).transpose(0, 3, 1, 2) for x in (weights, suns, skies))
    weights, suns, skies = colours
    return Walks(weights, cosines.reshape(depth, *size), suns, skies)
