"""Print tables of what `raytwin bench` wrote, and with `--record` store them for docs/measured/bench.md and paper.md.

python -m measure.bench_tables out/bench.json [out/paper.json]
"""

import json
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import msgspec
from measure import record

from raytwin.bench.bench_record import Growth
from raytwin.bench.frontier import fit_power
from raytwin.paper.paper_record import Paper
from raytwin.paper.paper_tables import tables
from raytwin.report.numbers import seconds

GROWTH = (
    "raytwin bench scenes/single --spheres 1,3,10,30,100,300,1000"
    " --methods 'numpy32-*-conic,drjit32-*-conic,mitsuba-llvm-direct-1' --budget 1800"
)
"""What docs/measured/bench.md names for seconds against spheres."""


def growth_rows(growth: list[Growth]) -> list[list[str]]:
    """Return a row per method: the fitted exponent, its standard error, and the seconds at the most spheres."""
    rows = []
    for method, points in groupby(sorted(growth, key=attrgetter("method", "spheres")), attrgetter("method")):
        found = list(points)
        if law := fit_power([p.spheres for p in found], [p.seconds_median for p in found]):
            rows.append([method, f"{law.exponent:.2f} ± {law.sigma:.2f}", seconds(found[-1].seconds_median)])
    return rows


def main(*paths: str) -> None:
    for path in map(Path, paths):
        if path.name == "paper.json":
            figures = tables(msgspec.json.decode(path.read_bytes(), type=Paper))[0]
            columns = [column.head for column in figures.columns]
            record.table("paper", "figures", columns, figures.texts(), "raytwin bench paper --budget 1200")
        else:
            growth = msgspec.convert(json.loads(path.read_text(encoding="utf-8"))["growth"], list[Growth])
            most = f"at {max(point.spheres for point in growth)} spheres"
            record.table("bench", "spheres", ["method", "exponent", most], growth_rows(growth), GROWTH)


if __name__ == "__main__":
    main(*record.arguments())
