"""A bench's folder, and its few lines for the terminal."""

import os
from pathlib import Path

from raytwin.bench import Bench, Changes, write_bench
from raytwin.errors import InputError
from raytwin.report.bench_html import write_bench_page
from raytwin.report.bench_static import write_static
from raytwin.report.charts import error_chart, side_charts, sizes_of
from raytwin.report.numbers import seconds, shown

TOLD = ("shadow-center", "path-area")
"""The frontiers that the terminal shows; the page has all."""


def write_bench_all(bench: Bench, folder: str | os.PathLike, changes: Changes | None = None) -> None:
    """bench.html, bench.json, and each chart as SVG and PNG: the frontiers by relMSE, and growth."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "a folder to write to", error.strerror) from None
    write_bench(bench, folder / "bench.json")
    write_bench_page(bench, folder / "bench.html", changes)
    charts = [
        error_chart(bench, size, truth.name, "relmse")
        for size in sizes_of(bench)
        for truth in bench.truths
        if (truth.width, truth.height) == size
    ]
    write_static([c for c in charts if c is not None] + side_charts(bench), folder)


def bench_summary(bench: Bench, changes: Changes | None = None) -> str:
    """What is on each frontier, what was left out, and what has changed."""
    lines = [f"{bench.scene}: {len(bench.rows)} measurements in {seconds(bench.seconds)}"]
    for truth in (t for t in bench.truths if t.name in TOLD):
        on = [
            e for e in bench.errors
            if e.on_frontier and (e.truth, e.width, e.height) == (truth.name, truth.width, truth.height)
        ]  # fmt: skip
        time_of = {r.method: r.seconds_median for r in bench.rows if (r.width, r.height) == (truth.width, truth.height)}
        lines.append(f"  frontier against {truth.name}, {truth.width} x {truth.height}:")
        for e in sorted(on, key=lambda e: time_of[e.method]):
            mark = "<= " if e.rmse <= (truth.floor["rmse"] or 0) else "   "
            value = shown(max(e.rmse, truth.floor["rmse"] or 0))
            lines.append(f"    {e.method:<30} {seconds(time_of[e.method]):>10}   rmse {mark}{value}")
    if bench.left_out:
        lines.append(f"  left out: {len(bench.left_out)}, named with their reasons in bench.html")
    if changes:
        lines += [f"  against the earlier run: {doubt}" for doubt in changes.doubts]
        lines.append(f"  the median method takes {changes.drift:.3f} times what it took")
        for c in changes.changes:
            if c.verdict:
                ratios = " and ".join(
                    f"{what} {r[0]:.3f} times ({r[1]:.3f} to {r[2]:.3f})"
                    for what, r in (("seconds", c.seconds), ("rmse", c.error))
                )
                lines.append(f"  {c.method}, {c.width} x {c.height}: {c.verdict}: {ratios}")
        if not changes.worse:
            lines.append("  nothing became slower or less accurate")
    return "\n".join(lines)
