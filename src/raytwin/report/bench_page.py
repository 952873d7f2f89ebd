"""A bench's page, its folder, its few lines for the terminal."""

import math
import os
from collections.abc import Iterator
from pathlib import Path

from raytwin.bench import RENDERERS, Bench, Changes, Converged, MethodChange, write_bench
from raytwin.errors import InputError
from raytwin.report.bench_charts import AXES, COLOURS, TRUTHS, error_chart, growth_charts, megapixels, sizes_of
from raytwin.report.charts.chart import Chart, chart_html, write_charts
from raytwin.report.numbers import seconds, shown
from raytwin.report.page import write_page

FIRST = "path-area/relmse"
"""What the page shows when it opens."""

IN_TERMINAL = ("shadow-center", "path-area")
"""The frontiers that the terminal shows; the page has all."""


def write_bench_all(bench: Bench, folder: str | os.PathLike[str], changes: Changes | None = None) -> None:
    """bench.html, bench.json, and each chart as SVG: the frontiers by relMSE, and growth."""
    folder = made_folder(folder)
    write_bench(bench, folder / "bench.json")
    write_bench_page(bench, folder / "bench.html", changes)
    write_charts([c for c in error_charts(bench) if c.key.endswith("/relmse")] + growth_charts(bench), folder)


def made_folder(folder: str | os.PathLike[str]) -> Path:
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "a folder to write to", error.strerror) from None
    return folder


# ------------------------------------------------------------------------------------------ the page


def write_bench_page(bench: Bench, path: str | os.PathLike[str], changes: Changes | None = None) -> None:
    """One file that opens offline. Every chart of every size, truth and metric lies in it, drawn."""
    charts = error_charts(bench)
    first = next((c.key for c in charts if c.key.endswith("/" + FIRST)), charts[0].key if charts else "")
    write_page(
        path, "bench.html.j2", ("bench.css",), ("charts.js",),
        b=bench,
        changes=changes,
        charts=[(c, chart_html(c), frontier_rows(c)) for c in charts],
        growth=[(c, chart_html(c)) for c in growth_charts(bench)],
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


def bench_summary(bench: Bench, changes: Changes | None = None) -> str:
    """What is on each frontier, what was left out, and what has changed."""
    count = len(bench.rows) + len(bench.growth)
    lines = [f"{bench.scene}: {count} measurements in {seconds(bench.seconds)}"]
    for truth in (t for t in bench.truths if t.name in IN_TERMINAL):
        lines += frontier_lines(bench, truth)
    for e in bench.equal:
        first = next(o for o in bench.equal if (o.truth, o.width, o.height) == (e.truth, e.width, e.height))
        if e is first:
            lines.append(f"  to relMSE {e.relmse:g} against {e.truth}, {e.width} x {e.height}:")
        beyond = "" if e.measured else ", beyond what was measured"
        lines.append(f"    {e.family:<30} {seconds(e.seconds):>10}   {e.seconds / first.seconds:5.3g} x{beyond}")
    if bench.left_out:
        lines.append(f"  left out: {len(bench.left_out)}, named with their reasons in bench.html")
    return "\n".join([*lines, *(change_lines(changes) if changes else ())])


def frontier_lines(bench: Bench, truth: Converged) -> Iterator[str]:
    size, floor = (truth.width, truth.height), truth.floor["rmse"] or 0.0
    time_of = {r.method: r.seconds_median for r in bench.rows if (r.width, r.height) == size}
    on = [e for e in bench.errors if e.on_frontier and (e.truth, e.width, e.height) == (truth.name, *size)]
    yield f"  frontier against {truth.name}, {truth.width} x {truth.height}:"
    for e in sorted(on, key=lambda e: time_of[e.method]):
        value = ("<= " if e.rmse <= floor else "   ") + shown(max(e.rmse, floor))
        yield f"    {e.method:<30} {seconds(time_of[e.method]):>10}   rmse {value}"


def change_lines(changes: Changes) -> Iterator[str]:
    yield from (f"  against the earlier run: {doubt}" for doubt in changes.doubts)
    yield f"  the median method takes {changes.drift:.3f} times what it took"
    yield from (change_line(c) for c in changes.changes if c.verdict)
    seen = sorted(c.seen for c in changes.changes)
    if changes.undecided:
        worst = max(changes.undecided, key=lambda c: c.seen)
        yield f"  undecided for {len(changes.undecided)} of {len(seen)} methods: too few repeats, or too much noise"
        yield f"  would have seen a slowdown by {at_least(seen[len(seen) // 2])} in half of the methods,"
        yield f"  and by {at_least(worst.seen)} in {worst.method}"
    elif not changes.worse:
        yield f"  nothing became slower or less accurate (would have seen a slowdown by {at_least(seen[-1])})"


def at_least(factor: float) -> str:
    return f"{factor:.3g} times" if math.isfinite(factor) else "no factor at all"


def change_line(c: MethodChange) -> str:
    ratios = " and ".join(
        f"{what} {ratio:.3f} times ({low:.3f} to {high:.3f})"
        for what, (ratio, low, high) in (("seconds", c.seconds), ("rmse", c.error))
    )
    return f"  {c.method}, {c.width} x {c.height}: {c.verdict}: {ratios}"
