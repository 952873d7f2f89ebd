"""Lambert's law under sun and open sky: L = albedo/π E max(0, n·l) + albedo Lₛ."""

from typing import Any

import numpy as np

from raytwin.teach.contract.stage import Arrays, Case, Stage, textbook_variants, unit
from raytwin.tracer import lambert


def shade(points: Any, normals: Any, albedo: Any, to_light: Any, irradiance: Any, sky: Any) -> Any:
    """The radiance (N, 3) of each point: albedo / pi * irradiance * max(0, n·l) + albedo * sky.

    points: (N, 3), metres, never (H, W, 3); the sun is so far away that they do not matter.
    normals: (N, 3), unit, on the side from which the point is seen.
    albedo: (N, 3), or (3,) for all points.
    to_light: (3,), unit, from the surface to the sun.
    irradiance: (3,), never (N, 3): what a surface that faces the sun receives. In shadow, call it with zeros.
    sky: (3,), the sky's radiance, the same in every direction.
    """
    n, to_sun = tuple(np.asarray(normals, float).T), tuple(to_light)
    channels = np.broadcast_to(albedo, np.shape(normals)).T
    L = [lambert(a, n, to_sun, E, 1.0, s) for a, E, s in zip(channels, irradiance, sky, strict=True)]
    return np.stack(L, axis=-1)


def cases(seed: int) -> list[Case]:
    """24 points of each kind, with numbers that make every factor show."""
    rng = np.random.default_rng(seed)
    to_light = unit(rng.uniform([0.2, -0.8, 0.5], [0.8, -0.2, 0.9]))
    E, sky = rng.uniform([2.0, 2.6, 3.2], [2.4, 3.0, 3.8]), rng.uniform([0.1, 0.2, 0.3], [0.15, 0.26, 0.4])
    normals = unit(rng.normal(size=(200, 3)))
    cosine = normals @ to_light
    lit, away = normals[(cosine > 0.15) & (cosine < 0.9)][:24], normals[cosine < -0.1][:24]
    points, each, one = rng.uniform(-0.2, 0.2, (24, 3)), rng.uniform(0.1, 0.95, (24, 3)), rng.uniform(0.2, 0.9, 3)
    dark = np.zeros(3)
    drawn = (
        ("surfaces that face the sun, no sky", (points, lit, each, to_light, E, dark)),
        ("the sky alone", (points, lit, each, to_light, dark, sky)),
        ("surfaces that face the sun", (points, lit, each, to_light, E, sky)),
        ("surfaces turned away from the sun", (points, away, each, to_light, E, sky)),
        ("one albedo for all", (points, np.concatenate([lit[:12], away[:12]]), one, to_light, E, sky)),
        ("one point", (points[:1], lit[:1], each[:1], to_light, E, sky)),
        ("light brighter than 1", (points, lit, each, to_light, 4 * E, 3 * sky)),
    )
    return [Case(shows, args, (shade(*args),)) for shows, args in drawn]


def errors(case: Case, got: Arrays) -> np.ndarray:
    """|L - L₀| by the largest L₀ of the case."""
    return np.asarray(np.abs(got[0] - case.expected[0]) / np.abs(case.expected[0]).max())


STAGE = Stage(shade, ("radiance",), cases, errors, 1e-5, "of the brightest", textbook_variants("shade"))
