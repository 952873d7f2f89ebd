"""Print tables of what `raytwin bench` and `raytwin stability` wrote; with `--record` store them for docs/measured.

python -m measure.bench_tables FILE...    in tests/; each a bench.json or atlas.json

Seconds are given as ratios of methods that were timed in turn, which another machine or another load changes little.
"""

from collections.abc import Iterable
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import msgspec
from measure import record

from raytwin.show.atlas_page import edge, fate
from raytwin.show.numbers import shown
from raytwin.study.atlas import EXPERIMENTS, Atlas, Curve, Found
from raytwin.study.bench import Bench

FRONTIER = "raytwin bench scenes/desk --sizes 0.05 --budget 300 --methods 'numpy32-*-conic,drjit32-*,twin-llvm-*'"
EDGES = "raytwin stability"
"""What makes each file again."""


def frontier_rows(bench: Bench) -> Iterable[list[str]]:
    """Yield the methods on the frontier against all light: size, name, seconds over the fastest's, error."""
    chosen = [e for e in bench.errors if e.on_frontier]
    for (w, h), of_size in groupby(chosen, attrgetter("width", "height")):
        ranked = sorted((e.seconds_median, e.rmse, e.method) for e in of_size)
        for taken, rmse, method in ranked:
            yield [f"{w} x {h}", method, shown(taken / ranked[0][0]), shown(rmse)]


def edge_row(f: Found) -> list[str]:
    """Return an experiment's row: which other method fails first, where, where theory says so, and raytwin's own."""
    down = -1 if f.values[0] > f.values[-1] else 1
    own = EXPERIMENTS[f.name].ours
    failing = {n: c for n, c in f.methods.items() if n not in own and c.breaks_at is not None}
    first = min(failing, key=lambda n: down * (failing[n].breaks_at or 0), default="none")
    at = failing.get(first, Curve((), None, None))
    ours = "; ".join(sorted({fate(f, name).partition(";")[0] for name in own}))
    return [f"`{f.name}`", f.parameter, first, edge(at.breaks_at), edge(at.predicted), ours or "none can hold"]


def main(*paths: str) -> None:
    for path in map(Path, paths):
        if path.name == "atlas.json":
            found = msgspec.json.decode(path.read_bytes(), type=Atlas)
            columns = ["experiment", "parameter", "fails first", "at", "predicted", "raytwin's own"]
            record.table("atlas", "edges", columns, map(edge_row, found.experiments), EDGES)
        else:
            bench = msgspec.json.decode(path.read_bytes(), type=Bench)
            columns = ["pixels", "method", "seconds over the fastest's", "RMSE against all light"]
            record.table("bench", "frontier", columns, frontier_rows(bench), FRONTIER)


if __name__ == "__main__":
    main(*record.arguments())
