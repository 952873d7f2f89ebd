"""The parts that a failure needs: ddmin.

Zeller and Hildebrandt, "Simplifying and isolating failure-inducing input", 2002.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")


def minimized(parts: Sequence[T], fails: Callable[[list[T]], bool]) -> list[T]:
    """Return parts, in their order, that still fail together, and of which no single one can be left out.

    `fails(parts)` must hold of all. With n parts of which k must stay it is asked some k log n times at best and n² at
    worst; where it does not depend on one part alone, another answer may be as small.

    >>> minimized(range(8), lambda kept: {2, 5} <= set(kept))
    [2, 5]
    """
    kept = list(parts)
    if kept and fails([]):
        return []
    pieces = 2
    while len(kept) > 1:
        pieces = min(pieces, len(kept))
        ends = [round(i * len(kept) / pieces) for i in range(pieces + 1)]
        spans = list(pairwise(ends))
        alone = [kept[a:b] for a, b in spans]
        rest = [kept[:a] + kept[b:] for a, b in spans] if pieces > 2 else []
        if (found := next(filter(fails, alone), None)) is not None:
            kept, pieces = found, 2
        elif (found := next(filter(fails, rest), None)) is not None:
            kept, pieces = found, pieces - 1
        elif pieces == len(kept):
            break
        else:
            pieces = 2 * pieces
    return kept
