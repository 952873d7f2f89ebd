"""The sky's occlusion by spheres: each takes (r/d)² cos θ of the light (Quilez, "Sphere ambient occlusion")."""

from typing import Any

import numpy as np

from raytwin.teach.contract.stage import Arrays, Case, Stage, text_variants, unit


def sky_visible(points: Any, normals: Any, centers: Any, radii: Any) -> Any:
    """The share (N,) of an even sky's light that reaches each surface element past the spheres."""
    f = np.asarray(centers)[None] - np.asarray(points)[:, None]
    d = np.linalg.norm(f, axis=-1)
    cosine = (f * np.asarray(normals)[:, None]).sum(-1) / d
    hidden = (np.asarray(radii) / d) ** 2 * np.maximum(cosine, 0)
    return np.asarray(1 - hidden.sum(axis=1))


def cases(seed: int) -> list[Case]:
    rng = np.random.default_rng(seed)
    ball = np.array([0.1, -0.1, 0.6]) + rng.uniform(-0.05, 0.05, 3), float(rng.uniform(0.15, 0.25))
    made = []
    for shows, side, centers, radii in (
        ("one sphere above a floor", 0.8, [ball[0]], [ball[1]]),
        ("two spheres", 0.12, [[-1.0, 0.2, 0.7], [0.9, 0.1, 0.8]], [0.3, 0.4]),
        ("a sphere below the horizon", 0.3, [[0.0, 0.0, -1.0]], [0.4]),
    ):
        points = rng.uniform(-side, side, (16, 3)) * [1, 1, 0]
        args = (points, np.tile([0.0, 0.0, 1.0], (16, 1)), np.array(centers), np.array(radii))
        made.append(Case(shows, args, (sky_visible(*args),)))
    tilted = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.25, 0.25, (16, 3))
    args = np.zeros((16, 3)), unit(tilted), np.array([[0.2, 0.1, 1.0]]), np.array([0.3])
    return [*made, Case("tilted surfaces", args, (sky_visible(*args),))]


def errors(case: Case, got: Arrays) -> np.ndarray:
    return np.asarray(np.abs(got[0] - case.expected[0]))


STAGE = Stage(sky_visible, ("share",), cases, errors, 1e-6, "of 1", text_variants(sky_visible))
