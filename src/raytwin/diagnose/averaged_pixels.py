"""Several rays per pixel: tried only where outlines are wrong, and nothing else explains the pictures."""

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from raytwin.diagnose.changes import SAMPLING, Fault, row
from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import Pipeline, replaced

BLENDED = 0.03
"""Least share of the pixels beside outlines that is wrong if several rays per pixel are averaged."""


def averaging_faults(samples: Sequence[PixelSample]) -> tuple[Fault, ...]:
    """Return the ways to average a pixel, if enough pixels beside outlines are wrong."""
    if any(s.view.scene is None for s in samples):
        return ()
    return AVERAGED if along_outlines(samples) > BLENDED else ()


def mean_of(places: Iterable[tuple[float, float]]) -> Pipeline:
    """The mean of rays through several places about the pixel's centre."""
    chosen = tuple(places)
    return replaced(spread=lambda _: chosen)


def grid(n: int, low: float, high: float) -> Pipeline:
    """The mean of n x n rays from `low` to `high` in both directions, pixels."""
    return mean_of(product(np.linspace(low, high, n).tolist(), repeat=2))


BLENDS = "each pixel is the mean of several rays (anti-aliasing), which blends outlines and the edges of shadows"
ONE_RAY = "here a pixel shows what the one ray through its centre, (u, v), meets"
AVERAGED = (
    row("averaged-over-pixel", SAMPLING, f"{BLENDS}: {ONE_RAY}",
        *(grid(n, 0.5 / n - 0.5, 0.5 - 0.5 / n) for n in (2, 3, 4)), *(grid(n, -0.5, 0.5) for n in (2, 3))),
    row("averaged-from-corner", SAMPLING,
        f"{BLENDS}, and the rays are spread to one side of (u, v) as if that were the pixel's corner: {ONE_RAY}",
        *(grid(n, 0.5 / n, 1 - 0.5 / n) for n in (2, 3, 4)), *(grid(n, 0.0, 1 - 1 / n) for n in (2, 3, 4)),
        grid(2, 0.0, 1.0)),
)  # fmt: skip


def along_outlines(samples: Sequence[PixelSample]) -> float:
    """The share of the pixels beside outlines that is wrong; of points, which have none, 0."""
    seen = [s for s in samples if not s.view.points]
    edge = sum(float((s.weight * s.edge).sum()) for s in seen)
    return sum(float((s.weight * s.edge * s.wrong).sum()) for s in seen) / edge if edge else 0.0
