"""The three functions that a picture is made with: pixels to rays, rays to spheres, light at what they meet."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from raytwin.explain import textbook
from raytwin.scene.lens import undone
from raytwin.teach.contract.stage import Arrays, Case, Stage, quiet, textbook_variants, unit
from raytwin.tracer import undistort

back_project = textbook.tracer_with({"undistort": undistort}).back_project
"""The textbook's, with a lens undone to the last digit."""

LENSES = {
    "a pinhole": (0, 0, 0, 0, 0),
    "the radial distortion k1 and k2": (-0.22, 0.09, 0, 0, 0),
    "the tangential distortion p1 and p2": (0, 0, 0.012, -0.007, 0),
    "the radial distortion k3": (0.06, -0.04, 0, 0, 0.08),
    "all five coefficients": (-0.18, 0.07, -0.006, 0.011, 0.04),
    "a wide and strong lens": (-0.22, 0.045, 0.0012, -0.0008, -0.0035),
}
"""What it shows -> coefficients, which the seed varies by a quarter; the last before a frame of 45 degrees a side."""


def lens_cases(seed: int) -> list[Case]:
    """Each kind of lens before frames of some 20 x 15 pixels that see about 35 degrees to each side; and the first
    again with another K: what was kept for a size is of no use there."""
    rng = np.random.default_rng(seed)
    made = [_lens_case(shows, dist, rng) for shows, dist in LENSES.items()]
    K, dist, width, height = made[0].args
    args = (K * [[1.2, 1, 0.9], [1, 1.1, 1.05], [1, 1, 1]], dist, width, height)
    return [*made, Case("another camera of the same size", args, (back_project(*args),))]


def _lens_case(shows: str, dist: Any, rng: np.random.Generator) -> Case:
    while True:
        width, height = int(rng.integers(18, 25)), int(rng.integers(11, 17))
        fx = width * (rng.uniform(0.5, 0.54) if shows == [*LENSES][-1] else rng.uniform(0.65, 0.8))
        K = np.array([[fx, 0, width * rng.uniform(0.4, 0.46)], [0, fx * rng.uniform(1.03, 1.08), 0], [0, 0, 1]])
        K[1, 2] = height * rng.uniform(0.53, 0.6)
        varied = np.array(dist, float) * rng.uniform(0.75, 1.25, 5)
        if not undone(K, varied.tolist(), (width, height)).fault:
            args = (K, varied, width, height)
            return Case(shows, args, (back_project(*args),))


def ray_errors(case: Case, got: Arrays) -> np.ndarray:
    """The distance of each ray's tip from where it should be: radians, where the rays are unit."""
    return np.asarray(np.linalg.norm(case.expected[0] - got[0], axis=-1))


BACK_PROJECT = Stage(
    back_project, ("rays",), lens_cases, ray_errors, 2e-5, "radians", textbook_variants("back_project")
)


intersect_sphere = quiet(textbook.intersect_sphere)


def sphere_cases(seed: int) -> list[Case]:
    """32 rays of each kind, then all together, none of them near the outline, where rounding decides."""
    rng = np.random.default_rng(seed)
    center, radius = rng.uniform([-0.1, -0.4, 0.6], [0.5, 0.2, 1.2]), float(rng.uniform(0.15, 0.3))
    out = unit(rng.normal(size=(32, 3)))
    outside = center + radius * rng.uniform(1.5, 4, (32, 1)) * out
    inside = center + radius * rng.uniform(0.1, 0.8, (32, 1)) * out
    aim = center + 0.8 * radius * unit(rng.normal(size=(32, 3))) * rng.uniform(0, 1, (32, 1))
    towards = unit(aim - outside)
    side = unit(np.cross(out, rng.normal(size=(32, 3))))
    sine = radius * rng.uniform(1.1, 1.4, (32, 1)) / np.linalg.norm(outside - center, axis=-1, keepdims=True)
    past = sine * side - np.sqrt(1 - sine**2) * out
    lengths = np.concatenate([rng.uniform(0.3, 0.8, (16, 1)), rng.uniform(1.3, 4, (16, 1))])
    anywhere = unit(rng.normal(size=(32, 3)))
    axes = np.eye(3)[[0, 1, 2]]
    drawn = (
        ("rays that meet it from outside", outside, towards),
        ("directions that are not unit", outside, towards * lengths),
        ("rays that start inside", inside, anywhere),
        ("rays that start inside, with directions that are not unit", inside, anywhere * lengths),
        ("a sphere behind the ray", outside, -towards),
        ("rays that miss", outside, past * lengths),
        ("rays that start inside, level with the centre", center + 0.5 * radius * axes, axes[[1, 2, 0]]),
        ("a ray alone", outside[:1], towards[:1] * 2),
        ("rays of which every other misses", outside, np.where(np.arange(32)[:, None] % 2, past, towards) * lengths),
    )
    order = rng.permutation(sum(len(o) for _, o, _ in drawn))
    starts, ways = np.concatenate([o for _, o, _ in drawn]), np.concatenate([d for *_, d in drawn])
    made = []
    for shows, o, d in (*drawn, ("many rays of all kinds", starts[order], ways[order])):
        args = (o, d, center, radius)
        made.append(Case(shows, args, (intersect_sphere(*args),)))
    return made


def t_errors(case: Case, got: Arrays) -> np.ndarray:
    """|t - t₀| / t₀; 1 where a hit is missed or made up, infinity for NaN."""
    right, t = case.expected[0], got[0]
    with np.errstate(all="ignore"):
        off = np.abs(t - right) / right
    off = np.where(np.isinf(right) & np.isinf(t), np.where(t > 0, 0.0, 1.0), off)
    return np.where(np.isnan(t), np.inf, np.where(np.isinf(right) != np.isinf(t), 1.0, off))


def marked_misses(drawn: Sequence[Case], got: Sequence[Arrays]) -> tuple[str, str] | None:
    """The mistake of marking misses by other numbers, where all is correct once these are read as infinity.

    One number, or one for rays that pass the sphere and one for a sphere behind the ray.
    """
    misses = np.concatenate([t[np.isinf(case.expected[0])] for case, (t,) in zip(drawn, got, strict=True)])
    marks = np.unique(misses[misses != np.inf])  # to which all NaN are one
    if len(marks) not in (1, 2):
        return None
    for case, (t,) in zip(drawn, got, strict=True):
        if (t_errors(case, (np.where(np.isinf(case.expected[0]), np.inf, t),)) > T_TOLERANCE).any():
            return None
    named = " or ".join(f"{mark:.5g}" for mark in marks)
    said = f"a miss has to be np.inf, not {named}: where the discriminant is negative, and where t is not positive"
    return "misses-not-infinite", said


T_TOLERANCE = 1e-4
"""Of t."""
INTERSECT_SPHERE = Stage(
    intersect_sphere, ("t",), sphere_cases, t_errors, T_TOLERANCE, "of t", textbook_variants("intersect_sphere"),
    by_values=marked_misses,
)  # fmt: skip


shade = quiet(textbook.shade)


def light_cases(seed: int) -> list[Case]:
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


def light_errors(case: Case, got: Arrays) -> np.ndarray:
    """|L - L₀| by the largest L₀ of the case."""
    return np.asarray(np.abs(got[0] - case.expected[0]) / np.abs(case.expected[0]).max())


SHADE = Stage(shade, ("radiance",), light_cases, light_errors, 1e-5, "of the brightest", textbook_variants("shade"))
