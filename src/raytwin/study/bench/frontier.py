"""The frontier of speed and accuracy."""

from collections.abc import Sequence

import numpy as np

NEAR_TIME, NEAR_ERROR = 1.1, 1.05
"""Times within this ratio, or errors, are a tie: another run might turn them round."""


def on_frontier(seconds: Sequence[float], errors: Sequence[float], floor: float = 0.0) -> list[bool]:
    """Which methods no other clearly beats: none is as accurate and clearly faster, or as fast and clearly better.

    Errors below `floor` count as `floor`: the truth cannot tell them apart. Ties share the frontier, so that noise of a
    few per cent does not push a method off it.
    """
    t, e = np.asarray(seconds, float), np.maximum(np.asarray(errors, float), floor)
    e = np.where(np.isfinite(e), e, np.inf)
    faster = (t[None] * NEAR_TIME < t[:, None]) & (e[None] <= e[:, None] * NEAR_ERROR)
    better = (e[None] * NEAR_ERROR < e[:, None]) & (t[None] <= t[:, None] * NEAR_TIME)
    return [bool(b) for b in ~(faster | better).any(axis=1) & np.isfinite(e)]


def staircase(seconds: Sequence[float], errors: Sequence[float], floor: float = 0.0) -> list[int]:
    """Indices of the methods that no other beats at all, from the fastest to the most accurate: the line to draw."""
    found, best = [], np.inf
    for i in sorted(range(len(seconds)), key=lambda i: (seconds[i], errors[i])):
        if max(errors[i], floor) < best:
            best = max(errors[i], floor)
            found.append(i)
    return found
