"""A bounce's direction, drawn as often as Lambert's law weighs it: density max(0, n·ω) / π."""

from typing import Any

import numpy as np

from raytwin.contract.stage import Arrays, Case, Stage, slips


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
    a, b = np.random.default_rng(seed).uniform(0.02, 0.98, (2, 64))
    return [Case("numbers at random", (a, b), (hemisphere(a, b),))]


def errors(expected: Arrays, got: Arrays) -> np.ndarray:
    """How far the tips are apart."""
    return np.asarray(np.linalg.norm(got[0] - expected[0], axis=-1))


# ------------------------------------------------------------------------------------------ typical mistakes


VARIANTS = slips(hemisphere, (
    ("even over the hemisphere", "the directions are even over the hemisphere, density 1 / 2π: z = 1 - a; Lambert's "
     "law wants cos θ / π, z = √(1 - a)", "np.sqrt(a)", "np.sqrt(1 - (1 - a) ** 2)"),
    ("even over the hemisphere", "the directions are even over the hemisphere, density 1 / 2π: z = a; Lambert's law "
     "wants cos θ / π, z = √(1 - a)", "np.sqrt(a)", "np.sqrt(1 - a**2)"),
    ("no root", "the disk's radius is a: its middle gets too many points; √a is even over the area", "np.sqrt(a)", "a"),
    ("a reversed", "z = √a: that is as likely, but here a = 0 is to be the normal itself, z = √(1 - a)",
     "np.sqrt(a)", "np.sqrt(1 - a)"),
    ("angle even", "θ itself is even, θ = aπ/2: too many near the normal; sin² θ = a",
     "np.sqrt(a)", "np.sin(a * np.pi / 2)"),
    ("half a turn", "b goes half around only: the angle is 2πb", "2 * np.pi", "np.pi"),
    ("b in radians", "b is taken for radians: the angle is 2πb", "2 * np.pi * ", ""),
    ("not unit", "the directions are not unit: z = 1 - a is not √(1 - x² - y²)",
     "np.sqrt(np.maximum(1 - radius**2, 0))", "1 - np.asarray(a)"),
    ("a and b swapped", "a and b are swapped: a is the radius's, b the angle's",
     "np.sqrt(a), 2 * np.pi * np.asarray(b)", "np.sqrt(b), 2 * np.pi * np.asarray(a)"),
    ("x and y swapped", "x and y are swapped: x = √a cos 2πb",
     "radius * np.cos(angle), radius * np.sin(angle)", "radius * np.sin(angle), radius * np.cos(angle)"),
))  # fmt: skip

STAGE = Stage(hemisphere, ("directions",), cases, errors, 1e-5, "of 1", VARIANTS)
