"""A bench's page, its folder, its few lines for the terminal."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from raytwin.bench import RENDERERS, Bench, Converged, Measurement, write_bench
from raytwin.errors import InputError
from raytwin.report.bench_charts import (
    AXES,
    COLOURS,
    OWN_COLOUR,
    TRUTHS,
    error_chart,
    megapixels,
    pixels_chart,
    sizes_of,
)
from raytwin.report.charts.chart import Chart, chart_html, write_charts
from raytwin.report.numbers import seconds, shown
from raytwin.report.page import write_page
from raytwin.report.terminal_text import counted

FIRST_TRUTH, FIRST_METRIC = "path-area", "relmse"
"""What a chart shows when the page opens; with subjects, the truth of the first one's light level."""

IN_TERMINAL = ("shadow-center", "path-area")
"""The frontiers that the terminal shows; the page has all."""

SIGNS = {"pass": "✓", "differs": "≈", "fail": "✗", "undecided": "?"}


def write_bench_all(benches: Sequence[Bench], folder: str | os.PathLike[str]) -> None:
    """bench.html, bench.json, and each chart as SVG: the frontiers by relMSE, and seconds against pixels.

    The charts of several scenes lie in a folder of each scene's name.
    """
    folder = made_folder(folder)
    write_bench(benches, folder / "bench.json")
    write_bench_page(benches, folder / "bench.html")
    for bench in benches:
        charts = [*(c for c in error_charts(bench) if c.key.endswith("/relmse")), pixels_chart(bench)]
        write_charts(filter(None, charts), folder / bench.scene if len(benches) > 1 else folder)


def made_folder(folder: str | os.PathLike[str]) -> Path:
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "a folder to write to", error.strerror) from None
    return folder


# ------------------------------------------------------------------------------------------ the page


def write_bench_page(benches: Sequence[Bench], path: str | os.PathLike[str]) -> None:
    """One file that opens offline. Every chart of every scene, size, truth and metric lies in it, drawn."""
    write_page(
        path, "bench.html.j2", ("bench.css",), ("charts.js",),
        scenes=[scene_part(bench) for bench in benches],
        subjects=benches[0].subjects,
        verdicts=[line for bench in benches if bench.subjects for line in verdict_lines(bench)],
        signs=SIGNS,
    )  # fmt: skip


def scene_part(bench: Bench) -> dict[str, Any]:
    """What the page shows of one scene."""
    charts = error_charts(bench)
    return {
        "b": bench,
        "charts": [(c, chart_html(c), frontier_rows(c)) for c in charts],
        "pixels": chart_html(pixels) if (pixels := pixels_chart(bench)) else "",
        "sizes": [(f"{w}x{h}", f"{w} × {h}, {megapixels((w, h))}") for w, h in sizes_of(bench)],
        "truths": [(t, TRUTHS.get(t, t)) for t in dict.fromkeys(t.name for t in bench.truths)],
        "metrics": [(m, words) for m, words in AXES.items() if any(c.key.endswith(f"/{m}") for c in charts)],
        "first": first_shown(bench, charts),
        "kinds": kinds(bench),
        "never": never(bench),
    }


def first_shown(bench: Bench, charts: Sequence[Chart]) -> list[str]:
    """Size, truth and metric of the chart that is shown when the page opens."""
    truths = [FIRST_TRUTH]
    if row := next((row for row in bench.rows if row.method in bench.subjects), None):
        of_subject = {e.truth for e in bench.errors if e.method == row.method}
        own = [name for name in (f"{row.rung}-center", f"{row.rung}-area") if name in of_subject]
        truths = [*own, FIRST_TRUTH]
    ends = [f"/{truth}/{FIRST_METRIC}" for truth in truths]
    found = next((c.key for end in ends for c in charts if c.key.endswith(end)), charts[0].key if charts else "//")
    return found.split("/")


def verdict_lines(bench: Bench) -> Iterator[tuple[str, str, list[tuple[Measurement | None, str]]]]:
    """Yield (scene, size, cells) per size; a cell per subject: its row, or None and why it was not measured."""
    rows = {(r.method, r.width, r.height): r for r in bench.rows}
    left = {(o.method, o.width, o.height): o.why for o in bench.left_out}
    sizes = [(r.width, r.height) for r in bench.rows] + [(o.width, o.height) for o in bench.left_out]
    for w, h in dict.fromkeys(sizes):
        cells = [(rows.get((s, w, h)), left.get((s, w, h), "")) for s in bench.subjects]
        yield bench.scene, f"{w} × {h}", cells


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
    listed = [(start, colour) for start, colour in COLOURS.items() if any(f.startswith(start) for f in measured)]
    own = any(r.method not in RENDERERS for r in bench.rows)
    return [*([("yours", OWN_COLOUR)] if own else []), *listed]


# ------------------------------------------------------------------------------------------ the terminal


def bench_summary(bench: Bench) -> str:
    """The subjects' verdicts, what is on each frontier, and what was left out."""
    lines = [
        f"{bench.scene}: {counted(len(bench.rows), 'measurement')} in {seconds(bench.seconds)}",
        *subject_lines(bench),
    ]
    for truth in (t for t in bench.truths if t.name in IN_TERMINAL):
        lines += frontier_lines(bench, truth)
    if bench.left_out:
        lines.append(f"  left out: {len(bench.left_out)}, named with their reasons in bench.html")
    return "\n".join(lines)


def subject_lines(bench: Bench) -> Iterator[str]:
    """Yield a line per subject and size, its verdict first."""
    for scene, size, cells in verdict_lines(bench) if bench.subjects else ():
        for name, (row, why) in zip(bench.subjects, cells, strict=True):
            where = f"{scene}, {size.replace('×', 'x')}: {name}"
            if row is None:
                yield f"UNDECIDED  {where}: not measured: {why}"
            else:
                said = "" if row.verdict == "pass" else f": {row.reason}"
                yield f"{row.verdict.upper()}  {where}: {seconds(row.seconds_median)}, rmse {shown(row.rmse)}{said}"


def frontier_lines(bench: Bench, truth: Converged) -> Iterator[str]:
    size, floor = (truth.width, truth.height), truth.floor["rmse"] or 0.0
    time_of = {r.method: r.seconds_median for r in bench.rows if (r.width, r.height) == size}
    on = [e for e in bench.errors if e.on_frontier and (e.truth, e.width, e.height) == (truth.name, *size)]
    yield f"  frontier against {truth.name}, {truth.width} x {truth.height}:"
    for e in sorted(on, key=lambda e: time_of[e.method]):
        value = ("<= " if e.rmse <= floor else "   ") + shown(max(e.rmse, floor))
        yield f"    {e.method:<30} {seconds(time_of[e.method]):>10}   rmse {value}"
