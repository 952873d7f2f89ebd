"""Which generated slips explain the pictures: each is tried on a few pixels first, the least far-fetched first."""

from collections.abc import Sequence

import numpy as np

from raytwin.diagnose.budget import Budget
from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import Array, Pipeline
from raytwin.diagnose.slip_table import Slip, read

WRONG, RIGHT = 40, 24
"""Pixels of the first view that a slip is tried on: wrong ones, and right ones."""
SECONDS = 1.5
"""CPU seconds for the first trial of all slips."""
QUICK = ("nearest", "met", "normals_at", "shade", "radiance")
"""Functions whose slips leave alone which rays meet what, and take a tenth of the time: tried first."""
MOST = 16
"""Slips that are tried on all pixels."""
LEFT = 0.5
"""Share of the cost: a slip that leaves more on the first pixels is dropped."""


def likely_slips(sights: Sequence[PixelSample], before: Pipeline, budget: Budget) -> list[tuple[Slip, Pipeline]]:
    """The slips that leave least of what is wrong at a few pixels of the worst view, in the order of the table."""
    worst = max(sights, key=lambda s: s.cost(s.errors(before)))
    probe, other = _few(worst, before, 0), _few(worst, before, 1)
    limits = [LEFT * s.cost(s.errors(before)) for s in (probe, other)]
    found: list[tuple[float, int, Slip, Pipeline]] = []
    began, slips = budget.clock(), sorted(enumerate(read()), key=lambda slip: slip[1].function not in QUICK)
    for done, (k, one) in enumerate(slips):
        if budget.over or budget.clock() - began > SECONDS:
            budget.slips_left = len(slips) - done
            break
        steps = (*before, *one.way)
        cost = _cost(probe, steps)
        if cost < limits[0] and (more := _cost(other, steps)) < limits[1]:
            found.append((cost + more, k, one, steps))
    best = sorted(found, key=lambda x: x[:2])[:MOST]
    return [(one, steps) for _, _, one, steps in sorted(best, key=lambda x: x[1])]


def _few(sight: PixelSample, before: Pipeline, part: int) -> PixelSample:
    """The sight at some of its pixels; those of part 0 and of part 1 are others."""
    wrong = sight.errors(before) > sight.tau
    chosen: list[Array] = [
        np.flatnonzero(mask)[part * n : (part + 1) * n] for mask, n in ((wrong, WRONG), (~wrong, RIGHT))
    ]
    if not chosen[0].size:
        chosen = [np.flatnonzero(wrong)[:WRONG], np.flatnonzero(~wrong)[:RIGHT]]
    return sight.only(np.concatenate(chosen))


def _cost(sight: PixelSample, pipeline: Pipeline) -> float:
    """What a slip leaves."""
    return sight.cost(sight.errors(pipeline))
