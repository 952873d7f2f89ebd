"""Seconds to one error: where a family of methods, of more and more samples, falls to a given relMSE."""

from collections.abc import Sequence
from math import inf, log

from raytwin.bench.bench_record import Converged, Equal, Measurement
from raytwin.bench.bench_reference import truth_of
from raytwin.renderers.renderer_table import RENDERERS

TARGET = 1e-3
"""relMSE: a picture in which noise can hardly be seen."""
FARTHEST = 8.0
"""Times the samples of the last measured point: the fall of the error is not carried on beyond it."""


def equal_error(rows: Sequence[Measurement], truths: Sequence[Converged]) -> tuple[Equal, ...]:
    """Return the seconds to one error of each family with several sample counts; by size and reference, then seconds.

    What the truth's own noise adds to each relMSE is taken away.
    """
    floor_of = {(t.name, t.width, t.height): t.floor["relmse"] or 0.0 for t in truths}
    groups: dict[tuple[int, int, str, str], list[tuple[float, float, int]]] = {}
    for r in rows:
        if (method := RENDERERS.get(r.method)) is None:
            continue  # a function of the caller's own has one sample count
        if (floor := floor_of.get((truth := truth_of(method), r.width, r.height))) is not None:
            own = r.seconds_median, r.relmse - floor, r.samples
            groups.setdefault((r.width, r.height, truth, method.family), []).append(own)
    found = [
        Equal(name, truth, w, h, TARGET, *at)
        for (w, h, truth, name), points in groups.items()
        if len({samples for *_, samples in points}) > 1 and (at := passed(points)) is not None
    ]
    return tuple(sorted(found, key=lambda e: (e.width * e.height, e.truth, e.seconds)))


def passed(points: Sequence[tuple[float, float, int]], target: float = TARGET) -> tuple[float, float, bool] | None:
    """Return (seconds, samples, measured) where the error falls to `target`, interpolated in logarithms between points
    (seconds, error, samples); the first point if its error is below `target` already.

    Beyond the last point, up to FARTHEST times its samples, it is extrapolated (not `measured`) if the error falls
    as Monte Carlo's does; else None.
    """
    ranked = sorted(points, key=lambda p: p[2])
    if ranked[0][1] <= target:
        return ranked[0][0], float(ranked[0][2]), True
    after = next((i for i, point in enumerate(ranked) if point[1] <= target), len(ranked) - 1)
    (t0, e0, n0), (t1, e1, n1) = ranked[after - 1], ranked[after]
    falls = log(e0 / max(e1, 1e-30)) / log(n1 / n0)
    share = log(e0 / target) / (falls * log(n1 / n0)) if falls > 0 else inf
    samples = n0 * (n1 / n0) ** min(share, 99.0)
    if share > 1 and (abs(falls - 1) > 0.3 or samples > FARTHEST * n1):
        return None
    return t0 * (t1 / t0) ** share, samples, share <= 1
