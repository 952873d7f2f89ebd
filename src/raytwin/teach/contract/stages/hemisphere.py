"""A bounce's direction, drawn as often as Lambert's law weighs it: density max(0, n·ω) / π.

A sampler is judged by what it draws, not by the formula: every map of the unit square that gives this density is
correct, Malley's, Shirley and Chiu's concentric one, or one with a and b swapped.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import chi2

from raytwin.teach.contract.stage import Arrays, Case, Stage, Variant, instead, slips

DRAWS = 16384
"""Directions per case."""
CELLS = 8, 16
"""Cells of equal probability, along z² and along the angle about the normal: 128 draws in each."""
FALSE_ALARMS = 1e-6
"""Share of the cases that a correct sampler fails by chance."""
UNIT = 1e-5
"""Largest error of a direction's length."""


def hemisphere(a: Any, b: Any) -> Any:
    """Unit directions (N, 3) about the normal (0, 0, 1), with density cos θ / π.

    A point of the unit disk, even over its area, raised to the hemisphere (Malley): at the radius √a and the angle
    2πb, so that z = cos θ = √(1 - a).

    a, b: (N,), numbers in [0, 1).
    """
    radius, angle = np.sqrt(a), 2 * np.pi * np.asarray(b)
    z = np.sqrt(np.maximum(1 - radius**2, 0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)


def cases(seed: int) -> list[Case]:
    a, b = np.random.default_rng(seed).uniform(size=(2, DRAWS))
    return [Case("numbers at random", (a, b), (hemisphere(a, b),))]


def errors(expected: Arrays, got: Arrays) -> np.ndarray:
    """Return each direction's error: of its length, what is below the surface, and the excess density of its cell.

    Under the density cos θ / π, z² and the angle about the normal are even and independent. Densities count only if a
    chi-square test over the cells refuses them.
    """
    d = got[0]
    off = np.abs(np.linalg.norm(d, axis=-1) - 1)
    off = np.maximum(np.where(off > UNIT, off, 0), np.maximum(-d[:, 2], 0))
    if not np.isfinite(d).all() or off.any():
        return np.asarray(off)
    rows, columns = CELLS
    row = np.minimum(d[:, 2] ** 2 * rows, rows - 1).astype(int)
    column = np.minimum(_turn(d) * columns, columns - 1).astype(int)
    cell = row * columns + column
    counts = np.bincount(cell, minlength=rows * columns)
    excess = counts * (rows * columns / len(d)) - 1
    refused = chi2.sf((excess**2).sum() * len(d) / (rows * columns), rows * columns - 1) < FALSE_ALARMS
    return np.asarray(np.abs(excess)[cell] if refused else off)


def _turn(d: np.ndarray) -> np.ndarray:
    """The angle about the normal, 0 to 1."""
    return np.asarray(np.arctan2(d[:, 1], d[:, 0]) / (2 * np.pi) % 1)


# ------------------------------------------------------------------------------------------ typical mistakes


OTHER_DENSITIES = {
    "even over the hemisphere": ("the directions are even over the hemisphere, density 1 / 2π; Lambert's law wants "
                                 "cos θ / π, as z = √(1 - a) gives", lambda d: d[:, 2]),
    "no root": ("the disk's radius is even: its middle gets too many points; √a is even over the area",
                lambda d: np.hypot(d[:, 0], d[:, 1])),
    "angle even": ("θ itself is even: too many near the normal; sin² θ = a",
                   lambda d: np.arccos(np.clip(d[:, 2], -1, 1)) * 2 / np.pi),
}  # fmt: skip
"""A density that is drawn by mistake -> its sentence, and what is even from 0 to 1 under it."""


def by_density(cases: Sequence[Case], got: Sequence[Arrays]) -> Variant | None:
    """Return the mistake whose density the directions have, whatever the formula; None if none fits."""
    d = np.concatenate([directions for (directions,) in got])
    if not np.abs(np.linalg.norm(d, axis=-1) - 1).max() <= UNIT:
        return None
    if (below := (d[:, 2] < -UNIT).mean()) > 0:
        said = f"{100 * below:.0f} % of the directions point below the surface: the normal is (0, 0, 1), so z ≥ 0"
        return Variant("below the surface", said, instead(hemisphere))
    for name, (sentence, even) in OTHER_DENSITIES.items():
        counts = np.histogram(even(d), 32, (0, 1))[0]
        expected = len(d) / len(counts)
        if counts.sum() == len(d) and chi2.sf(((counts - expected) ** 2).sum() / expected, len(counts) - 1) > 1e-3:
            return Variant(name, sentence, instead(hemisphere))
    return None


VARIANTS = slips(hemisphere, (
    ("half a turn", "b goes half around only: the angle is 2πb", "2 * np.pi", "np.pi"),
    ("b in radians", "b is taken for radians: the angle is 2πb", "2 * np.pi * ", ""),
    ("not unit", "the directions are not unit: z = 1 - a is not √(1 - x² - y²)",
     "np.sqrt(np.maximum(1 - radius**2, 0))", "1 - np.asarray(a)"),
))  # fmt: skip

STAGE = Stage(hemisphere, ("directions",), cases, errors, UNIT, "of 1", VARIANTS, by_values=by_density)
