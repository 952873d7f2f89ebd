"""A bench's page, its folder, its few lines for the terminal."""

import os
from collections.abc import Iterator
from pathlib import Path

from raytwin.bench import RENDERERS, Bench, Converged, write_bench
from raytwin.errors import InputError
from raytwin.report.bench_charts import AXES, COLOURS, TRUTHS, error_chart, megapixels, side_charts, sizes_of
from raytwin.report.charts.chart import Chart, chart_html, write_charts
from raytwin.report.numbers import seconds, shown
from raytwin.report.page import write_page

FIRST = "path-area/relmse"
"""What the page shows when it opens."""

IN_TERMINAL = ("shadow-center", "path-area")
"""The frontiers that the terminal shows; the page has all."""


def write_bench_all(bench: Bench, folder: str | os.PathLike[str]) -> None:
    """bench.html, bench.json, and each chart as SVG: the frontiers by relMSE, and seconds against pixels."""
    folder = made_folder(folder)
    write_bench(bench, folder / "bench.json")
    write_bench_page(bench, folder / "bench.html")
    write_charts([c for c in error_charts(bench) if c.key.endswith("/relmse")] + side_charts(bench), folder)


def made_folder(folder: str | os.PathLike[str]) -> Path:
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "a folder to write to", error.strerror) from None
    return folder


# ------------------------------------------------------------------------------------------ the page


def write_bench_page(bench: Bench, path: str | os.PathLike[str]) -> None:
    """One file that opens offline. Every chart of every size, truth and metric lies in it, drawn."""
    charts = error_charts(bench)
    first = next((c.key for c in charts if c.key.endswith("/" + FIRST)), charts[0].key if charts else "")
    write_page(
        path, "bench.html.j2", ("bench.css",), ("charts.js",),
        b=bench,
        charts=[(c, chart_html(c), frontier_rows(c)) for c in charts],
        side=[(c, chart_html(c)) for c in side_charts(bench)],
        sizes=[(f"{w}x{h}", f"{w} × {h}, {megapixels((w, h))}") for w, h in sizes_of(bench)],
        truths=[(t, TRUTHS.get(t, t)) for t in dict.fromkeys(t.name for t in bench.truths)],
        metrics=[(m, words) for m, words in AXES.items() if any(c.key.endswith(f"/{m}") for c in charts)],
        first=first.split("/") if first else ["", "", ""],
        kinds=kinds(bench),
        never=never(bench),
    )  # fmt: skip


def error_charts(bench: Bench) -> list[Chart]:
    return [
        chart
        for size in sizes_of(bench)
        for truth in dict.fromkeys(t.name for t in bench.truths if (t.width, t.height) == size)
        for metric in AXES
        if (chart := error_chart(bench, size, truth, metric)) is not None
    ]


def frontier_rows(chart: Chart) -> list[tuple[str, str, str]]:
    """(method, seconds, error) of the frontier's methods, the fastest first."""
    on = sorted((p for p in chart.points if p.strong), key=lambda p: p.x)
    return [(p.name, seconds(p.x), ("≤ " if p.hollow else "") + shown(p.y)) for p in on]


def never(bench: Bench) -> list[str]:
    """The methods that were measured and are on no frontier, at no size and against no truth."""
    on = {e.method for e in bench.errors if e.on_frontier}
    return [m for m in dict.fromkeys(r.method for r in bench.rows) if m not in on]


def kinds(bench: Bench) -> list[tuple[str, str]]:
    """(first words of families, colour) of what was measured, for the key."""
    measured = {RENDERERS[r.method].family for r in bench.rows if r.method in RENDERERS}
    return [(start, colour) for start, colour in COLOURS.items() if any(f.startswith(start) for f in measured)]


# ------------------------------------------------------------------------------------------ the terminal


def bench_summary(bench: Bench) -> str:
    """What is on each frontier, and what was left out."""
    count = len(bench.rows) + len(bench.calibration)
    lines = [f"{bench.scene}: {count} measurements in {seconds(bench.seconds)}"]
    for truth in (t for t in bench.truths if t.name in IN_TERMINAL):
        lines += frontier_lines(bench, truth)
    lines += [
        f"  {c.source}: {c.setting}, scale {c.scale:g}: {seconds(c.seconds_median)}, held out {shown(c.heldout_px)} px"
        for c in bench.calibration
    ]
    if bench.left_out:
        lines.append(f"  left out: {len(bench.left_out)}, named with their reasons in bench.html")
    return "\n".join(lines)


def frontier_lines(bench: Bench, truth: Converged) -> Iterator[str]:
    size, floor = (truth.width, truth.height), truth.floor["rmse"] or 0.0
    time_of = {r.method: r.seconds_median for r in bench.rows if (r.width, r.height) == size}
    on = [e for e in bench.errors if e.on_frontier and (e.truth, e.width, e.height) == (truth.name, *size)]
    yield f"  frontier against {truth.name}, {truth.width} x {truth.height}:"
    for e in sorted(on, key=lambda e: time_of[e.method]):
        value = ("<= " if e.rmse <= floor else "   ") + shown(max(e.rmse, floor))
        yield f"    {e.method:<30} {seconds(time_of[e.method]):>10}   rmse {value}"
