"""Lambert's law under sun and open sky: L = albedo/π E max(0, n·l) + albedo Lₛ."""

import numpy as np

from raytwin.explain import textbook
from raytwin.teach.contract.stage import Arrays, Case, Stage, quiet, textbook_variants, unit

shade = quiet(textbook.shade)


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
