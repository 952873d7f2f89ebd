"""Pixels to rays: u = fx x' + cx, v = fy y' + cy, where (x', y') is (x, y) as the lens distorts it."""

from typing import Any

import numpy as np

from raytwin.explain.textbook import tracer_with
from raytwin.scene.lens import undone
from raytwin.teach.contract.stage import Arrays, Case, Stage, textbook_variants
from raytwin.tracer import undistort

back_project = tracer_with({"undistort": undistort}).back_project
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


def cases(seed: int) -> list[Case]:
    """Each kind of lens before frames of some 20 x 15 pixels that see about 35 degrees to each side; and the first
    again with another K: what was kept for a size is of no use there."""
    rng = np.random.default_rng(seed)
    made = [_case(shows, dist, rng) for shows, dist in LENSES.items()]
    K, dist, width, height = made[0].args
    args = (K * [[1.2, 1, 0.9], [1, 1.1, 1.05], [1, 1, 1]], dist, width, height)
    return [*made, Case("another camera of the same size", args, (back_project(*args),))]


def _case(shows: str, dist: Any, rng: np.random.Generator) -> Case:
    while True:
        width, height = int(rng.integers(18, 25)), int(rng.integers(11, 17))
        fx = width * (rng.uniform(0.5, 0.54) if shows == [*LENSES][-1] else rng.uniform(0.65, 0.8))
        K = np.array([[fx, 0, width * rng.uniform(0.4, 0.46)], [0, fx * rng.uniform(1.03, 1.08), 0], [0, 0, 1]])
        K[1, 2] = height * rng.uniform(0.53, 0.6)
        varied = np.array(dist, float) * rng.uniform(0.75, 1.25, 5)
        if not undone(K, varied.tolist(), (width, height)).fault:
            args = (K, varied, width, height)
            return Case(shows, args, (back_project(*args),))


def errors(case: Case, got: Arrays) -> np.ndarray:
    """The distance of each ray's tip from where it should be: radians, where the rays are unit."""
    return np.asarray(np.linalg.norm(case.expected[0] - got[0], axis=-1))


STAGE = Stage(back_project, ("rays",), cases, errors, 2e-5, "radians", textbook_variants("back_project"))
