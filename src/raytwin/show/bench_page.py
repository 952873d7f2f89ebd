"""A bench's page with its charts of error against seconds, its folder, its few lines for the terminal."""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from raytwin.images.image import Image
from raytwin.images.packing import binned
from raytwin.show.charts.chart import Chart, Line, Point, chart_html, family_chart, write_charts
from raytwin.show.charts.svg import INK, SOFT, Range
from raytwin.show.numbers import seconds, shown
from raytwin.show.page import write_page
from raytwin.show.picture_pair import SCRIPTS, STYLES, picture_pair
from raytwin.show.terminal_text import counted
from raytwin.study.bench import RENDERERS, Bench, Measurement, staircase, write_bench

FIRST_TRUTH = "path-area"
"""The reference of the chart shown when the page opens; with subjects, that of the first one's light level."""

IN_TERMINAL = ("shadow-center", "path-area")
"""The frontiers that the terminal shows; the page has all."""

SIGNS = {"pass": "✓", "differs": "≈", "fail": "✗", "undecided": "?"}

TRUTHS = {
    "lambert-center": "lambert, through pixel centres",
    "shadow-center": "shadow, through pixel centres",
    "lambert-area": "lambert, over whole pixels",
    "shadow-area": "shadow, over whole pixels",
    "sky-area": "sky, over whole pixels",
    "path-area": "global illumination (path), over whole pixels",
}

COLOURS = {
    "fill": "#6b7280", "careful": "#8e44ad", "paper": "#8e44ad", "numpy32": "#3b82c4",
    "numpy64": "#174a7c", "drjit32": "#e07b00", "drjit64": "#a34700", "cuda32": "#2e9e44", "cuda64": "#12612a",
    "twin": "#0f8b8d",
}  # fmt: skip
"""By the first of these that is a part of the family's name."""

OWN_COLOUR = "#111827"
"""Colour of renderers that are no methods of the table."""

MARKERS = {"lambert": "square", "shadow": "circle", "sky": "triangle", "path": "diamond"}

MOST_PICTURES, WIDE = 9, 240
"""Pictures in the page, a key each, and their most pixels across: nine weigh about two megabytes."""


def write_bench_all(
    benches: Sequence[Bench], folder: str | os.PathLike[str], images: Mapping[str, Image] = MappingProxyType({})
) -> None:
    """bench.html, bench.json, and each frontier as SVG: of several scenes in a folder of each scene's name.

    `images`: of the first scene at its first size, by the names of methods and references.
    """
    folder = Path(folder)
    write_bench(benches, folder / "bench.json")
    write_bench_page(benches, folder / "bench.html", images)
    for bench in benches:
        write_charts(error_charts(bench), folder / bench.scene if len(benches) > 1 else folder)


# ------------------------------------------------------------------------------------------ the page


def write_bench_page(
    benches: Sequence[Bench], path: str | os.PathLike[str], images: Mapping[str, Image] = MappingProxyType({})
) -> None:
    """One file that opens offline. Every chart of every scene, size and reference lies in it, drawn."""
    chosen = pictures_of(benches[0], images)
    names = list(chosen)
    pair = picture_pair(chosen, (names[0], names[1]), names[1]) if len(names) > 1 else {"pictures": {}}
    write_page(
        path, "bench.html.j2", ("bench.css", *(STYLES if names else ())), SCRIPTS if names else ("charts.js",),
        **pair,
        scenes=[scene_part(bench) for bench in benches],
        subjects=benches[0].subjects,
        verdicts=[line for bench in benches if bench.subjects for line in verdict_lines(bench)],
        signs=SIGNS,
    )  # fmt: skip


def pictures_of(bench: Bench, images: Mapping[str, Image]) -> dict[str, Image]:
    """The subjects' images, the reference with all light, and those of methods on a frontier, the fastest first."""
    rows = [row for row in (*bench.rows, *bench.errors) if row.on_frontier]
    fast = [row.method for row in sorted(rows, key=lambda row: row.seconds_median)]
    names = [*bench.subjects, f"reference {FIRST_TRUTH}", *dict.fromkeys(fast)]
    chosen = [name for name in dict.fromkeys(names) if name in images][:MOST_PICTURES]
    step = max((-(-images[name].shape[1] // WIDE) for name in chosen), default=1)
    return {name: binned(images[name], step) if step > 1 else images[name] for name in chosen}


def scene_part(bench: Bench) -> dict[str, Any]:
    """What the page shows of one scene."""
    charts = error_charts(bench)
    return {
        "b": bench,
        "charts": [(c, chart_html(c), frontier_rows(c)) for c in charts],
        "sizes": [(f"{w}x{h}", f"{w} × {h}, {megapixels((w, h))}") for w, h in bench.sizes],
        "truths": [(t, TRUTHS.get(t, t)) for t in truths_of(bench)],
        "first": first_shown(bench, charts),
        "kinds": kinds(bench),
    }


def truths_of(bench: Bench) -> list[str]:
    """Return the names of the references that methods were compared with."""
    return list(dict.fromkeys(row.truth for row in (*bench.rows, *bench.errors)))


def first_shown(bench: Bench, charts: Sequence[Chart]) -> list[str]:
    """Size and reference of the chart that is shown when the page opens."""
    truths = [*(row.truth for row in bench.rows if row.method in bench.subjects), FIRST_TRUTH]
    found = next((c.key for truth in truths for c in charts if c.key.endswith(f"/{truth}")), None)
    return (found or (charts[0].key if charts else "/")).split("/")


def verdict_lines(bench: Bench) -> Iterator[tuple[str, str, list[tuple[Measurement | None, str]]]]:
    """Yield (scene, size, cells) per size; a cell per subject: its row, or None and why it was not measured."""
    rows = {(r.method, r.width, r.height): r for r in bench.rows}
    for w, h in bench.sizes:
        cells = [(rows.get((s, w, h)), bench.left_out.get(s, "")) for s in bench.subjects]
        yield bench.scene, f"{w} × {h}", cells


def error_charts(bench: Bench) -> list[Chart]:
    charts = (error_chart(bench, size, truth) for size in bench.sizes for truth in truths_of(bench))
    return [chart for chart in charts if chart is not None]


def frontier_rows(chart: Chart) -> list[tuple[str, str, str]]:
    """(method, seconds, error) of the frontier's methods, the fastest first."""
    on = sorted((p for p in chart.points if p.strong), key=lambda p: p.x)
    return [(p.name, seconds(p.x), ("≤ " if p.hollow else "") + shown(p.y)) for p in on]


def kinds(bench: Bench) -> list[tuple[str, str]]:
    """(part of names, colour) of what was measured, for the key."""
    used = {colour_of(r.method) for r in bench.rows if r.method in RENDERERS}
    listed = [(part, colour) for part, colour in COLOURS.items() if colour in used]
    own = any(r.method not in RENDERERS for r in bench.rows)
    return [*([("yours", OWN_COLOUR)] if own else []), *listed]


# ------------------------------------------------------------------------------------------ error against seconds


def colour_of(method: str) -> str:
    if method not in RENDERERS:
        return OWN_COLOUR
    return next((colour for part, colour in COLOURS.items() if part in method), SOFT)


def megapixels(size: tuple[int, int]) -> str:
    return f"{size[0] * size[1] / 1e6:.2g} MP"


def error_chart(bench: Bench, size: tuple[int, int], truth: str) -> Chart | None:
    """Return every method's RMSE against its seconds, with the standard errors; None where no RMSE is a number."""
    found = [r for r in measured(bench, size, truth) if math.isfinite(r.rmse)]
    if not found:
        return None
    floor = found[0].truth_floor
    times, errors = [r.seconds_median for r in found], [r.rmse for r in found]
    order = {name: i for i, name in enumerate(RENDERERS)}
    points = [
        Point(
            r.seconds_median,
            y,
            name=r.method,
            family=RENDERERS[r.method].family if r.method in RENDERERS else r.method,
            colour=colour_of(r.method),
            marker=MARKERS.get(r.rung, "circle"),
            hollow=r.rmse <= floor,
            strong=r.on_frontier,
            tip=row_tip(r),
            label=r.method if r.on_frontier or r.method in bench.subjects else "",
            left=r.on_frontier,
        )
        for r, y in zip(found, raised(errors, floor), strict=True)
    ]
    drawn = family_chart(
        f"{size[0]}x{size[1]}/{truth}",
        f"{bench.scene}, {megapixels(size)}, against {TRUTHS.get(truth, truth)}",
        "seconds per frame (median)",
        "RMSE",
        sorted(points, key=lambda p: (p.family, order.get(p.name, 0))),
        floor or None,
    )
    stairs = steps([points[i] for i in staircase(times, errors, floor)], drawn.x_range[1])
    bars = [error_bar(r, p.colour, drawn.y_range) for r, p in zip(found, points, strict=True) if r.rmse_sigma]
    lines = *drawn.lines, *bars, stairs
    return replace(drawn, lines=lines, notes=("Upright lines are two standard errors either way.",))


def error_bar(r: Measurement, colour: str, y_range: Range) -> Line:
    """Return the upright of two standard errors either way, as far as it lies within the chart."""
    reach = 2 * (r.rmse_sigma or 0.0)
    ends = max(r.rmse - reach, y_range[0]), min(max(r.rmse + reach, y_range[0]), y_range[1])
    return Line((r.seconds_median,) * 2, ends, colour)


def measured(bench: Bench, size: tuple[int, int], truth: str) -> list[Measurement]:
    """Return each measurement at this size against the reference `truth`: of all methods, if it has all light."""
    of_all = [e for e in bench.errors if (e.width, e.height, e.truth) == (*size, truth)]
    return of_all or [r for r in bench.rows if (r.width, r.height, r.truth) == (*size, truth)]


def raised(errors: Sequence[float], floor: float) -> list[float]:
    """Return what is drawn: nothing below the floor, and no 0, which has no place on a logarithmic axis."""
    bottom = floor or min((v for v in errors if v > 0), default=1e-16)
    return [max(v, bottom) for v in errors]


def row_tip(r: Measurement) -> str:
    """A row's numbers, a line each."""
    return "\n".join(
        (
            r.method,
            f"{seconds(r.seconds_median)}, quartiles {seconds(r.seconds_iqr)} apart",
            f"first calls {seconds(r.compile_seconds)} more",
            f"{counted(r.samples, 'sample')} per pixel",
            f"{r.verdict} beside the twin",
            f"RMSE {with_sigma(r)}, relMSE {shown(r.relmse)}, 99.9 % {shown(r.p999_abs)}",
        )
    )


def with_sigma(r: Measurement) -> str:
    """Return the RMSE with its standard error, where it is known."""
    return shown(r.rmse) + ("" if r.rmse_sigma is None else f" ± {shown(r.rmse_sigma, 2)}")


def steps(stairs: Sequence[Point], end: float) -> Line:
    """The frontier: what the best method so far has, from its seconds to the next one's."""
    until = [p.x for p in stairs[1:]] + [end]
    xs = tuple(x for p, stop in zip(stairs, until, strict=True) for x in (p.x, stop))
    return Line(xs, tuple(p.y for p in stairs for _ in range(2)), INK, 2.5, strength=0.35)


# ------------------------------------------------------------------------------------------ the terminal


def bench_summary(bench: Bench) -> str:
    """The subjects' verdicts, what is on each frontier, and what was left out."""
    measured = f"{counted(len(bench.rows), 'measurement')} in {seconds(bench.seconds)}"
    lines = [f"{bench.scene}: {measured}", *subject_lines(bench)]
    for size in bench.sizes:
        for truth in IN_TERMINAL:
            lines += frontier_lines(bench, size, truth)
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


def frontier_lines(bench: Bench, size: tuple[int, int], truth: str) -> Iterator[str]:
    on = [row for row in measured(bench, size, truth) if row.on_frontier]
    if on:
        yield f"  frontier against {truth}, {size[0]} x {size[1]}:"
    for row in sorted(on, key=lambda row: row.seconds_median):
        error = ("<= " if row.rmse <= row.truth_floor else "   ") + shown(max(row.rmse, row.truth_floor))
        yield f"    {row.method:<30} {seconds(row.seconds_median):>10}   rmse {error}"
