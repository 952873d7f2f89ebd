"""The bench's charts as plain data, laid out once: bench_html.py draws them with Bokeh, bench_static.py for paper."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import NamedTuple

import numpy as np

from raytwin.bench import GROWTH, METHODS, Bench, Calibrated, fit_power, on_frontier, staircase
from raytwin.report.labels import Label, place

FRAME = (740, 600)
"""Pixels of the charts' frames, on the page and on paper alike: labels are placed for this size."""

METRICS = {
    "relmse": "relMSE, mean((t − r)² / (r² + 0.01))",
    "rmse": "RMSE, radiance",
    "p999_abs": "99.9 % quantile of |t − r|, radiance",
    "flip": "mean HDR-FLIP",
}

TRUTHS = {
    "lambert-center": "lambert, through pixel centres",
    "shadow-center": "shadow, through pixel centres",
    "lambert-area": "lambert, over whole pixels",
    "shadow-area": "shadow, over whole pixels",
    "sky-area": "sky, over whole pixels",
    "path-area": "the whole light (path), over whole pixels",
}

COLOURS = {
    "fill": "#6b7280", "Python loop": "#7c4a21", "numpy32": "#3b82c4", "numpy64": "#174a7c", "drjit32": "#e07b00",
    "drjit64": "#a34700", "cuda32": "#2e9e44", "cuda64": "#12612a", "speculation": "#8e44ad", "twin": "#0f8b8d",
    "Mitsuba": "#c02f4a", "non-local": "#d455a5",
}  # fmt: skip
"""By the family's first word."""

MARKERS = {"lambert": "square", "shadow": "circle", "sky": "triangle", "path": "diamond"}

INK, SOFT = "#1b2330", "#5a6575"


@dataclass(frozen=True)
class Point:
    """`hollow`: at or below what the truth can tell, drawn at that floor."""

    x: float
    y: float
    method: str
    family: str
    colour: str
    marker: str
    hollow: bool
    frontier: bool


@dataclass(frozen=True)
class Text:
    """At (x, y), its left end's middle; `leader`: (x0, y0, x1, y1), all in the chart's units."""

    text: str
    x: float
    y: float
    colour: str
    bold: bool
    leader: tuple[float, float, float, float] | None


@dataclass(frozen=True)
class Line:
    xs: tuple[float, ...]
    ys: tuple[float, ...]
    colour: str
    width: float = 1.5
    dash: str = "solid"


@dataclass(frozen=True)
class Chart:
    """Log-log. `unlabelled`: methods for whose label no room was left."""

    key: str
    title: str
    x_label: str
    y_label: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    points: tuple[Point, ...] = ()
    texts: tuple[Text, ...] = ()
    lines: tuple[Line, ...] = ()
    floor: float | None = None
    unlabelled: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())


def family_of(method: str) -> str:
    return next((m.family for m in METHODS if m.name == method), method.split("-")[0])


def colour_of(family: str) -> str:
    return next((c for start, c in COLOURS.items() if family.startswith(start)), SOFT)


def sizes_of(bench: Bench) -> list[tuple[int, int]]:
    return list(dict.fromkeys((t.width, t.height) for t in bench.truths))


def megapixels(size: tuple[int, int]) -> str:
    return f"{size[0] * size[1] / 1e6:.2g} MP"


# ------------------------------------------------------------------------------------------ error against seconds


def error_chart(bench: Bench, size: tuple[int, int], truth: str, metric: str) -> Chart | None:
    """Every method's error against its seconds; None where nothing was measured."""
    row_of = {r.method: r for r in bench.rows if (r.width, r.height) == size}
    found = [
        (e, row_of[e.method], getattr(e, metric))
        for e in bench.errors
        if (e.width, e.height) == size and e.truth == truth and getattr(e, metric) is not None
    ]
    if not found:
        return None
    floor = next(t for t in bench.truths if (t.width, t.height, t.name) == (*size, truth)).floor.get(metric) or 0.0
    seconds, errors = [r.seconds_median for _, r, _ in found], [v for _, _, v in found]
    least = min((v for v in errors if v > 0), default=1e-16)
    bottom = floor or least
    flags = on_frontier(seconds, errors, floor)
    points = tuple(
        Point(r.seconds_median, max(v, bottom), e.method, family_of(e.method), colour_of(family_of(e.method)),
              MARKERS.get(r.rung, "circle"), v <= floor, flag)
        for (e, r, v), flag in zip(found, flags, strict=True)
    )  # fmt: skip
    stairs = [points[i] for i in staircase(seconds, errors, floor)]
    x_range, y_range = _range([p.x for p in points], 0.12), _range([p.y for p in points], 0.14)
    lines = [
        Line(tuple(p.x for p in group), tuple(p.y for p in group), group[0].colour)
        for group in _families(points).values()
        if len(group) > 1
    ]
    lines += _guides(x_range, y_range, -1.0 if metric == "relmse" else -0.5)
    xs, ys = [], []
    for a, b in zip(stairs, [*stairs[1:], None], strict=True):
        end = b.x if b else x_range[1]
        xs += [a.x, end]
        ys += [a.y, a.y]
    lines.append(Line(tuple(xs), tuple(ys), INK, 2.5, "solid"))
    texts, without = _labels(points, x_range, y_range)
    slope = "−1" if metric == "relmse" else "−1/2"
    return Chart(
        f"{size[0]}x{size[1]}/{truth}/{metric}",
        f"{bench.scene}, {megapixels(size)}, against {TRUTHS.get(truth, truth)}",
        "seconds a frame (median)", METRICS[metric], x_range, y_range, points, texts, tuple(lines), floor or None,
        without,
        (f"thin grey lines: slope {slope}, Monte Carlo's",),
    )  # fmt: skip


def _families(points: Sequence[Point]) -> dict[str, list[Point]]:
    """The families' points in the order of METHODS."""
    order = {m.name: i for i, m in enumerate(METHODS)}
    ranked = sorted(points, key=lambda p: (p.family, order.get(p.method, 0)))
    return {name: list(group) for name, group in groupby(ranked, key=lambda p: p.family)}


def _labels(
    points: Sequence[Point], x_range: tuple[float, float], y_range: tuple[float, float]
) -> tuple[tuple[Text, ...], tuple[str, ...]]:
    """A family's name once, a point's place in it each; the frontier's methods by their whole name."""
    to_px, from_px = _pixels(x_range, y_range)
    short = {m.name: m.label for m in METHODS}
    whole = [
        (Label(p.method, *to_px(p.x, p.y), size=11, bold=True), p.colour, True, p.method) for p in points if p.frontier
    ]
    names, rest = [], []
    for name, group in _families(points).items():
        if all(p.frontier for p in group):
            continue
        places = [to_px(p.x, p.y) for p in group]
        names.append(
            (Label(name, *places[-1], size=11, bold=True, others=tuple(places[:-1])), group[0].colour, True, name)
        )
        for p in group:
            if len(group) > 1 and not p.frontier:  # a family's only member goes by the family's name
                label = Label(short.get(p.method, p.method), *to_px(p.x, p.y), size=10)
                rest.append((label, p.colour, False, p.method))
    asked = [*whole, *names, *rest]
    placed = place([a[0] for a in asked], [to_px(p.x, p.y) for p in points], *FRAME)
    texts, without = [], []
    for (label, colour, bold, method), at in zip(asked, placed, strict=True):
        if at is None:
            without.append(method)
            continue
        leader = None
        if at.leader is not None:
            leader = (*from_px(*at.leader[:2]), *from_px(*at.leader[2:]))
        texts.append(Text(label.text, *from_px(at.x, at.y), colour, bold, leader))
    return tuple(texts), tuple(without)


def _pixels(x_range: tuple[float, float], y_range: tuple[float, float]) -> tuple[Callable, Callable]:
    (x0, x1), (y0, y1) = np.log10(x_range), np.log10(y_range)

    def to_px(x: float, y: float) -> tuple[float, float]:
        return (
            (math.log10(x) - x0) / (x1 - x0) * FRAME[0],
            (math.log10(y) - y0) / (y1 - y0) * FRAME[1],
        )

    def from_px(x: float, y: float) -> tuple[float, float]:
        return float(10 ** (x0 + x / FRAME[0] * (x1 - x0))), float(10 ** (y0 + y / FRAME[1] * (y1 - y0)))

    return to_px, from_px


def _range(values: Sequence[float], margin: float) -> tuple[float, float]:
    low, high = math.log10(min(values)), math.log10(max(values))
    pad = max(margin * (high - low), 0.3)
    return 10 ** (low - pad), 10 ** (high + pad)


def _guides(x_range: tuple[float, float], y_range: tuple[float, float], slope: float) -> list[Line]:
    """Lines of one slope, some decades apart, through the frame."""
    (x0, x1), (y0, y1) = np.log10(x_range), np.log10(y_range)
    apart = max(1.0, (y1 - y0 - slope * (x1 - x0)) / 6)
    lines, height = [], y0 + apart / 2
    while height + slope * (x1 - x0) < y1:
        start, end = max(x0, x0 + (height - y1) / -slope), min(x1, x0 + (height - y0) / -slope)
        if end > start:
            ys = [10 ** float(height + slope * (x - x0)) for x in (start, end)]
            lines.append(Line((10 ** float(start), 10 ** float(end)), tuple(ys), "#b9c0ca", 1.0, "dotted"))
        height += apart
    return lines


# ------------------------------------------------------------------------------------------ growth


def side_charts(bench: Bench) -> list[Chart]:
    """Growth and calibration, what of them was measured."""
    return growth_charts(bench) + calibration_charts(f"{bench.scene}: ", bench.calibration)


def growth_charts(bench: Bench) -> list[Chart]:
    """Seconds against pixels (from three sizes on) and against spheres, each with its fitted exponent."""
    by_pixels: dict[str, list[tuple[float, float]]] = {}
    if len(sizes_of(bench)) > 2:
        for r in bench.rows:
            by_pixels.setdefault(r.method, []).append((r.width * r.height / 1e6, r.seconds_median))
        if shared := [name for name in by_pixels if name in GROWTH]:
            by_pixels = {name: by_pixels[name] for name in shared}
        by_pixels = dict(sorted(by_pixels.items(), key=lambda item: item[1][-1][1])[:12])
    by_spheres: dict[str, list[tuple[float, float]]] = {}
    for g in bench.growth:
        by_spheres.setdefault(g.method, []).append((g.spheres, g.seconds_median))
    size = f"{bench.growth[0].width} x {bench.growth[0].height} pixels" if bench.growth else ""
    made = [
        _growth_chart("pixels", f"{bench.scene}: seconds against pixels", "megapixels", by_pixels),
        _growth_chart("spheres", f"seconds against small spheres, {size}", "spheres", by_spheres),
    ]
    return [chart for chart in made if chart is not None]


def _growth_chart(key: str, title: str, x_label: str, series: dict[str, list[tuple[float, float]]]) -> Chart | None:
    series = {name: sorted(points) for name, points in series.items() if len(points) > 1}
    if not series:
        return None
    everything = [p for points in series.values() for p in points]
    x_range, y_range = _range([x for x, _ in everything], 0.08), _range([s for _, s in everything], 0.1)
    x_range = x_range[0], 10 ** (math.log10(x_range[1]) + 0.45 * math.log10(x_range[1] / x_range[0]))
    to_px, from_px = _pixels(x_range, y_range)
    points, lines, asked, notes = [], [], [], []
    palette = _distinct(list(series))
    for name, found in series.items():
        colour = palette[name]
        points += [Point(x, s, name, family_of(name), colour, "circle", False, False) for x, s in found]
        lines.append(Line(tuple(x for x, _ in found), tuple(s for _, s in found), colour))
        fit = fit_power(*zip(*found, strict=True))
        text = name
        if fit:
            text += f": {fit.exponent:.2f}" + ("" if math.isnan(fit.sigma) else f" ± {fit.sigma:.2f}")
            ends = fit.used[0], fit.used[-1]
            lines.append(Line(ends, tuple(fit.factor * x**fit.exponent for x in ends), colour, 1.2, "dashed"))
        asked.append((Label(text, *to_px(*found[-1]), size=11, bold=True), colour))
        notes.append(text)
    placed = place([a[0] for a in asked], [to_px(p.x, p.y) for p in points], *FRAME)
    texts = []
    for (label, colour), at in zip(asked, placed, strict=True):
        if at is not None:
            leader = (*from_px(*at.leader[:2]), *from_px(*at.leader[2:])) if at.leader else None
            texts.append(Text(label.text, *from_px(at.x, at.y), colour, True, leader))
    note = "dashed and in numbers: the exponent fitted to the upper half of the points, with its standard error"
    return Chart(key, title, x_label, "seconds (median)", x_range, y_range, tuple(points), tuple(texts), tuple(lines),
                 notes=(note,))  # fmt: skip


def _distinct(names: list[str]) -> dict[str, str]:
    """Family colours, and where two methods would share one, others."""
    spare = iter(("#5d3a9b", "#d6006e", "#111827", "#5a6575", "#2563eb", "#65a30d", "#a16207", "#be185d"))
    taken: dict[str, str] = {}
    for name in names:
        colour = colour_of(family_of(name))
        taken[name] = colour if colour not in taken.values() else next(spare, SOFT)
    return taken


# ------------------------------------------------------------------------------------------ calibration


def calibration_charts(title: str, rows: Sequence[Calibrated]) -> list[Chart]:
    """Held-out error against seconds, a chart for each set of photos: a line for a setting, a point for a scale.

    `title`: what stands before the chart's own.
    """
    charts = []
    for i, source in enumerate(dict.fromkeys(r.source for r in rows)):
        of = sorted((r for r in rows if r.source == source), key=lambda r: (r.setting, -r.scale))
        marks = [
            Mark(r.setting, f"{r.scale:g}", f"{r.setting}, scale {r.scale:g}", r.seconds_median, r.heldout_px)
            for r in of
        ]
        size = f" of {of[0].width} x {of[0].height}" if of[0].width else ""
        what = " ".join(filter(None, (str(max(r.photos for r in of)), source, "photos"))) + size
        made = marks_chart(
            f"calibration{f'-{i + 1}' if i else ''}", f"{title}calibration from {what}", "seconds (median)",
            "held-out rms error, pixels of the photos as taken", marks,
            note="numbers at the points: the scale of what is searched",
        )  # fmt: skip
        charts.append(made)
    return charts


# ------------------------------------------------------------------------------------------ any seconds and errors


class Mark(NamedTuple):
    """One point: `family` is what a line joins, `label` its place in it, `name` what the hover says."""

    family: str
    label: str
    name: str
    seconds: float
    error: float


def marks_chart(
    key: str, title: str, x_label: str, y_label: str, marks: Sequence[Mark], floor: float = 0.0, note: str = ""
) -> Chart:
    """Error against seconds: each family a line in its own colour, named once, every point labelled.

    What is at or below `floor` is hollow and drawn there.
    """
    palette = _distinct(list(dict.fromkeys(m.family for m in marks)))
    seconds, errors = [m.seconds for m in marks], [m.error for m in marks]
    bottom = floor or min((e for e in errors if e > 0), default=1e-16)
    flags = on_frontier(seconds, errors, floor)
    points = [
        Point(m.seconds, max(m.error, bottom), m.name, m.family, palette[m.family], "circle", m.error <= floor, flag)
        for m, flag in zip(marks, flags, strict=True)
    ]
    x_range, y_range = _range(seconds, 0.15), _range([p.y for p in points], 0.15)
    to_px, from_px = _pixels(x_range, y_range)
    groups = [list(group) for _, group in groupby(points, key=lambda p: p.family)]
    lines = [Line(tuple(p.x for p in g), tuple(p.y for p in g), g[0].colour) for g in groups if len(g) > 1]
    asked = [(Label(g[0].family, *to_px(g[0].x, g[0].y), 11, True), g[0].colour) for g in groups]
    asked += [
        (Label(m.label, *to_px(p.x, p.y), 10), p.colour)
        for m, p in zip(marks, points, strict=True)
        if sum(other.family == m.family for other in marks) > 1
    ]
    placed = place([a[0] for a in asked], [to_px(p.x, p.y) for p in points], *FRAME)
    texts = [
        Text(label.text, *from_px(at.x, at.y), colour, label.bold,
             (*from_px(*at.leader[:2]), *from_px(*at.leader[2:])) if at.leader else None)
        for (label, colour), at in zip(asked, placed, strict=True) if at is not None
    ]  # fmt: skip
    return Chart(
        key, title, x_label, y_label, x_range, y_range, tuple(points), tuple(texts), tuple(lines), floor or None,
        notes=(note,) if note else (),
    )  # fmt: skip
