"""Rays against a sphere: |o + t d - c|² = r², so a t² + 2 b t + c = 0: a = d·d, b = f·d, c = f·f - r², f = o - c."""

from collections.abc import Sequence

import numpy as np

from raytwin.explain import textbook
from raytwin.teach.contract.stage import Arrays, Case, Stage, quiet, textbook_variants, unit

intersect_sphere = quiet(textbook.intersect_sphere)


def cases(seed: int) -> list[Case]:
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


def errors(case: Case, got: Arrays) -> np.ndarray:
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
        read = np.where(np.isin(t, marks) | (np.isnan(t) & np.isnan(marks).any()), np.inf, t)
        if (errors(case, (read,)) > T_TOLERANCE).any():
            return None
    named = " or ".join(f"{mark:.5g}" for mark in marks)
    said = f"a miss has to be np.inf, not {named}: where the discriminant is negative, and where t is not positive"
    return "misses-not-infinite", said


T_TOLERANCE = 1e-4
"""Of t."""
HINTS = {2: "both roots, or t and a mask, are returned: one array t is wanted, np.inf for a miss"}
STAGE = Stage(
    intersect_sphere, ("t",), cases, errors, T_TOLERANCE, "of t", textbook_variants("intersect_sphere"), hints=HINTS,
    by_values=marked_misses,
)  # fmt: skip
