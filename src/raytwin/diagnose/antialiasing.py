"""Pixels that show the mean of several rays."""

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from raytwin.diagnose.changes import SAMPLING, row
from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import Pipeline, replaced


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
