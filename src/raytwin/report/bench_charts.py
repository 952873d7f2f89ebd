"""What the bench's charts hold: error against seconds, seconds against pixels."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from raytwin.bench import RENDERERS, Bench, Measurement, fit_power, on_frontier, staircase
from raytwin.compare import METRICS
from raytwin.report.charts.chart import Chart, Line, Point, by_family, family_chart
from raytwin.report.charts.svg import INK, SOFT, Range
from raytwin.report.numbers import seconds, short, shown

AXES = {m.name: f"{m.title}, {m.unit or m.formula}" for m in (METRICS[n] for n in ("relmse", "rmse", "p999_abs"))}
"""A metric -> what its chart's axis says: a chart each, in this order."""

TRUTHS = {
    "lambert-center": "lambert, through pixel centres",
    "shadow-center": "shadow, through pixel centres",
    "lambert-area": "lambert, over whole pixels",
    "shadow-area": "shadow, over whole pixels",
    "sky-area": "sky, over whole pixels",
    "path-area": "global illumination (path), over whole pixels",
}

COLOURS = {
    "fill": "#6b7280", "Python loop": "#7c4a21", "numpy32": "#3b82c4", "numpy64": "#174a7c", "drjit32": "#e07b00",
    "drjit64": "#a34700", "cuda32": "#2e9e44", "cuda64": "#12612a", "speculation": "#8e44ad", "twin": "#0f8b8d",
    "Mitsuba": "#c02f4a",
}  # fmt: skip
"""By the family's first word."""

OWN_COLOUR = "#111827"
"""Colour of renderers that are no methods of the table."""

PALETTE = "#0f8b8d", "#e07b00", "#8e44ad", "#c02f4a", "#3b82c4", "#a16207", "#2e9e44", "#111827", "#d455a5", "#5a6575"
"""Colours of lines that are no family of methods: one each, in turn."""

MARKERS = {"lambert": "square", "shadow": "circle", "sky": "triangle", "path": "diamond"}

GUIDE = "#b9c0ca"


def family_of(method: str) -> str:
    return RENDERERS[method].family if method in RENDERERS else method


def colour_of(method: str) -> str:
    if method not in RENDERERS:
        return OWN_COLOUR
    return next((c for start, c in COLOURS.items() if RENDERERS[method].family.startswith(start)), SOFT)


def sizes_of(bench: Bench) -> list[tuple[int, int]]:
    return list(dict.fromkeys((t.width, t.height) for t in bench.truths))


def megapixels(size: tuple[int, int]) -> str:
    return f"{size[0] * size[1] / 1e6:.2g} MP"


# ------------------------------------------------------------------------------------------ error against seconds


def error_chart(bench: Bench, size: tuple[int, int], truth: str, metric: str) -> Chart | None:
    """Return every method's error against its seconds; None where nothing was measured."""
    found = measured(bench, size, truth, metric)
    if not found:
        return None
    floor = next(t for t in bench.truths if (t.width, t.height, t.name) == (*size, truth)).floor.get(metric) or 0.0
    times, errors = [r.seconds_median for r, _ in found], [value for _, value in found]
    order = {name: i for i, name in enumerate(RENDERERS)}
    rows = zip(found, raised(errors, floor), on_frontier(times, errors, floor), strict=True)
    points = [
        Point(
            r.seconds_median,
            y,
            r.method,
            family_of(r.method),
            colour_of(r.method),
            MARKERS.get(r.rung, "circle"),
            value <= floor,
            strong,
            row_tip(r),
            r.method if strong or r.method in bench.subjects else "",
            strong,
        )
        for (r, value), y, strong in rows
    ]
    groups = by_family(sorted(points, key=lambda p: (p.family, order.get(p.name, 0))))
    named = [p for group in groups for p in (*group[:-1], group[-1] if group[-1].label else rest_of(group))]
    drawn = family_chart(
        f"{size[0]}x{size[1]}/{truth}/{metric}",
        f"{bench.scene}, {megapixels(size)}, against {TRUTHS.get(truth, truth)}",
        "seconds per frame (median)",
        AXES[metric],
        named,
        floor or None,
    )
    slope, in_words = (-1.0, "−1") if metric == "relmse" else (-0.5, "−1/2")
    stairs = steps([points[i] for i in staircase(times, errors, floor)], drawn.x_range[1])
    lines = *drawn.lines, *guides(drawn.x_range, drawn.y_range, slope), stairs
    return replace(drawn, lines=lines, notes=(f"thin grey lines: slope {in_words}, Monte Carlo's",))


def rest_of(family: Sequence[Point]) -> Point:
    """Return the last point of a family, labelled with the family's name, or its own where it is the only one."""
    return replace(family[-1], label=family[-1].family if len(family) > 1 else family[-1].name)


def measured(bench: Bench, size: tuple[int, int], truth: str, metric: str) -> list[tuple[Measurement, float]]:
    """Return each row that was compared with the reference `truth`, with its error."""
    row_of = {r.method: r for r in bench.rows if (r.width, r.height) == size}
    errors = (e for e in bench.errors if (e.width, e.height, e.truth) == (*size, truth))
    return [(row_of[e.method], value) for e in errors if (value := getattr(e, metric)) is not None]


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
            f"memory {shown(r.peak_mib)} MiB",
            f"{r.samples} sample{'s' * (r.samples != 1)} per pixel",
            f"{r.verdict} beside the twin",
            f"RMSE {shown(r.rmse)}, relMSE {shown(r.relmse)}, 99.9 % {shown(r.p999_abs)}",
        )
    )


def steps(stairs: Sequence[Point], end: float) -> Line:
    """The frontier: what the best method so far has, from its seconds to the next one's."""
    until = [p.x for p in stairs[1:]] + [end]
    xs = tuple(x for p, stop in zip(stairs, until, strict=True) for x in (p.x, stop))
    return Line(xs, tuple(p.y for p in stairs for _ in range(2)), INK, 2.5, strength=0.35)


def guides(x_range: Range, y_range: Range, slope: float) -> list[Line]:
    """Lines of one slope, some decades apart, through the frame."""
    (x0, x1), (y0, y1) = np.log10(x_range), np.log10(y_range)
    apart = max(1.0, (y1 - y0 - slope * (x1 - x0)) / 6)
    lines, height = [], y0 + apart / 2
    while height + slope * (x1 - x0) < y1:
        start, end = max(x0, x0 + (height - y1) / -slope), min(x1, x0 + (height - y0) / -slope)
        if end > start:
            ys = tuple(10 ** float(height + slope * (x - x0)) for x in (start, end))
            lines.append(Line((10 ** float(start), 10 ** float(end)), ys, GUIDE, 1.0, "dotted", 1.0))
        height += apart
    return lines


# ------------------------------------------------------------------------------------------ seconds against pixels

CHARTED_METHODS = 12
"""Methods in the chart of seconds against pixels: the quickest at the largest size."""
FEWEST_SIZES = 3
"""Sizes from which on seconds are charted against pixels."""


def pixels_chart(bench: Bench) -> Chart | None:
    """Return seconds against pixels with each method's fitted exponent; None below FEWEST_SIZES sizes."""
    if len(sizes_of(bench)) < FEWEST_SIZES:
        return None
    series: dict[str, list[tuple[float, float]]] = {}
    for r in bench.rows:
        series.setdefault(r.method, []).append((r.width * r.height / 1e6, r.seconds_median))
    quickest = sorted(series.items(), key=lambda item: item[1][-1][1])[:CHARTED_METHODS]
    points, lines = [], []
    for (name, found), colour in zip(quickest, PALETTE * 9, strict=False):
        if len(found) < 2:
            continue
        label = name
        if fit := fit_power(*zip(*found, strict=True)):
            label += f": {fit.exponent:.2f}" + ("" if math.isnan(fit.sigma) else f" ± {fit.sigma:.2f}")
            ends = fit.used[0], fit.used[-1]
            lines.append(Line(ends, tuple(fit.factor * x**fit.exponent for x in ends), colour, 1.2, "dashed"))
        points += [
            Point(x, s, name, name, colour, tip=f"{name}\n{short(x)} megapixels, {seconds(s)}")
            for x, s in sorted(found)
        ]
        points[-1] = replace(points[-1], label=label)
    if not points:
        return None
    title = f"{bench.scene}: seconds against pixels"
    note = "dashed and in numbers: the exponent fitted to the upper half of the points, with its standard error"
    drawn = family_chart("pixels", title, "megapixels", "seconds (median)", points, None, (note,), lines, 0.08)
    low, high = drawn.x_range
    return replace(drawn, x_range=(low, high * (high / low) ** 0.45))  # the labels stand to the right


# ------------------------------------------------------------------------------------------ any seconds and errors


@dataclass(frozen=True)
class Mark:
    """One point: `family` is what a line joins, `label` its place in it, `name` what the hover says."""

    family: str
    label: str
    name: str
    seconds: float
    error: float


def marks_chart(key: str, title: str, x_label: str, y_label: str, marks: Sequence[Mark], floor: float) -> Chart:
    """Return error against seconds: each family a line in its own colour, named at its first point.

    What is at or below `floor` is hollow and drawn there.
    """
    times, errors = [m.seconds for m in marks], [m.error for m in marks]
    families = list(dict.fromkeys(m.family for m in marks))
    palette = dict(zip(families, PALETTE * 9, strict=False))
    points: list[Point] = []
    for m, y, strong in zip(marks, raised(errors, floor), on_frontier(times, errors, floor), strict=True):
        first = all(p.family != m.family for p in points) and m.label != m.family
        label = f"{m.family}: {m.label}" if first else m.label
        tip = f"{m.name}\n{seconds(m.seconds)}, error {shown(m.error)}"
        points.append(
            Point(m.seconds, y, m.name, m.family, palette[m.family], "circle", m.error <= floor, strong, tip, label)
        )
    return family_chart(key, title, x_label, y_label, points, floor or None)
