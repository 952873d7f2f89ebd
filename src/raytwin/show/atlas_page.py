"""The stability atlas as a page: an index picture coloured by digits kept, and one chart an experiment."""

import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from raytwin.images.photo_files import srgb_decode
from raytwin.scene.toml_json import write_json
from raytwin.show.charts.chart import Chart, Line, Point, chart_html, log_range, write_charts
from raytwin.show.charts.svg import INK, Range
from raytwin.show.numbers import short, shown
from raytwin.show.page import write_page
from raytwin.show.terminal_text import counted
from raytwin.study.atlas import EXPERIMENTS, Atlas, Experiment, Found, digits
from raytwin.tracer.lights.envmap_tables import REC_709

OURS = "#0f7a3d", "#2563eb", "#0f8b8d"
OTHERS = "#c02f4a", "#e07b00", "#8e44ad", "#7c4a21", "#d455a5", "#5a6575", "#a16207", "#111827"
"""Colours of raytwin's own methods (OURS) and of those compared with them."""

LOST, HALF, ALL = (178, 24, 43), (250, 232, 176), (26, 122, 72)
"""sRGB of no digit, of eight, of sixteen."""

LEAST_ERROR_DRAWN = 1e-17
"""Smaller errors, and none at all, are drawn at the bottom."""

LINE_POINTS = 160
"""Points of a law's line."""


class Cell(NamedTuple):
    """One value of one method in the index: `text` the digits kept, `tip` the numbers; `broken`: beyond the bound."""

    text: str
    colour: str
    ink: str
    broken: bool
    tip: str


def write_atlas(found: Atlas, folder: str | os.PathLike[str]) -> None:
    """atlas.html, atlas.json, and each chart as SVG."""
    folder = Path(folder)
    rows = [(EXPERIMENTS[f.name], f) for f in found.experiments]
    charts = [chart(e, f) for e, f in rows]
    write_page(
        folder / "atlas.html",
        "atlas.html.j2",
        ("bench.css", "atlas.css"),
        ("charts.js",),
        experiments=[
            (
                e,
                f,
                [(name, name in e.ours, cells(f, name)) for name in f.methods],
                chart_html(c),
            )
            for (e, f), c in zip(rows, charts, strict=True)
        ],
        scale=[Cell(str(k), *colours(k), False, "") for k in range(0, 17, 2)],
        fate=fate,
        last=lambda f, name: digits_left(f.methods[name].errors[-1]),
    )
    write_json(folder / "atlas.json", found)
    write_charts(charts, folder)


def atlas_summary(found: Atlas) -> str:
    """Say for each experiment where each method first exceeds the bound, and where theory says so."""
    lines = []
    for f in found.experiments:
        lines.append(f"{f.name}: {f.parameter} {short(f.values[0])} to {short(f.values[-1])}, bound {short(f.bound)}")
        for name, curve in f.methods.items():
            lines.append(f"  {name:<38} {fate(f, name)}; {digits_left(curve.errors[-1])} at the last")
    return "\n".join(lines)


def fate(f: Found, method: str) -> str:
    """Say where the method breaks or starts to refuse, and where theory predicts that it breaks."""
    curve = f.methods[method]
    refused = next((x for x, e in zip(f.values, curve.errors, strict=True) if e is None), None)
    said = "holds" if refused is None else f"refuses at {short(refused)}"
    said = said if curve.breaks_at is None else f"breaks at {shown(curve.breaks_at, 2)}"
    return said if curve.predicted is None else f"{said}; predicted {shown(curve.predicted, 2)}"


def digits_left(error: float | None) -> str:
    left = digits(error)
    return "refused" if left is None else "no error" if error == 0 else counted(round(left), "digit")


# ------------------------------------------------------------------------------------------ the index


def cells(f: Found, method: str) -> list[Cell]:
    made = []
    for x, error in zip(f.values, f.methods[method].errors, strict=True):
        left = digits(error)
        said = "refused, and said so" if error is None else f"error {shown(error)}"
        tip = f"{f.parameter} {short(x)}: {said}"
        if left is None:
            made.append(Cell("–", "#e2e6eb", INK, False, tip))
        else:
            made.append(
                Cell("✓" if error == 0 else f"{left:.0f}", *colours(left), error is not None and error > f.bound, tip)
            )
    return made


def colours(left: float) -> tuple[str, str]:
    """The colours of a cell and of its text (black or white, at a contrast of 4.58 or more) for the digits kept."""
    low, high, share = (LOST, HALF, left / 8) if left < 8 else (HALF, ALL, left / 8 - 1)
    ground = tuple(round(a + (b - a) * share) for a, b in zip(low, high, strict=True))
    luminance = srgb_decode(np.array(ground) / 255) @ REC_709
    bright = (luminance + 0.05) ** 2 > 1.05 * 0.05
    return "#{:02x}{:02x}{:02x}".format(*ground), "#000000" if bright else "#ffffff"


# ------------------------------------------------------------------------------------------ a chart


def chart(e: Experiment, f: Found) -> Chart:
    """Draw error against the parameter, the hardest case at the right. Dashed: a method's law; thick: the bound."""
    x_range = log_range(f.values, 0.03)
    if f.values[0] > f.values[-1]:
        x_range = x_range[1], x_range[0]
    y_range = heights(f)
    ours, others = iter(OURS * 9), iter(OTHERS * 9)
    points, lines = [], [Line(x_range, (f.bound, f.bound), INK, 2.5, strength=0.35)]
    for name, curve in f.methods.items():
        own = name in e.ours
        colour, shape = (next(ours), "square") if own else (next(others), "circle")
        group = [
            Point(
                x,
                min(max(error, y_range[0]), y_range[1]),
                name=name,
                family=name,
                colour=colour,
                marker=shape,
                hollow=error < y_range[0],
                strong=own,
                tip=f"{name}\n{f.parameter} {short(x)}\nerror {shown(error)}",
            )
            for x, error in zip(f.values, curve.errors, strict=True)
            if error is not None
        ]
        if group:
            points += [*group[:-1], replace(group[-1], label=name)]
            lines.append(Line(tuple(p.x for p in group), tuple(p.y for p in group), colour, 2.2 if own else 1.4))
            lines += law_of(e, name, x_range, y_range, colour)
    refused = any(error is None for curve in f.methods.values() for error in curve.errors)
    notes = ["thick grey: the bound; dashed: what theory predicts", "hollow, at the bottom: no error"]
    notes += ["no point: the method refused, and said so"] if refused else []
    labels = e.name, e.title, e.parameter, e.error
    return Chart(*labels, x_range, y_range, tuple(points), tuple(lines), notes=tuple(notes))


def heights(f: Found) -> Range:
    """Return the range that holds the smallest and largest errors and the bound."""
    shown_ = [e for curve in f.methods.values() for e in curve.errors if e is not None and e > LEAST_ERROR_DRAWN]
    low = min([*shown_, f.bound])
    high = max([*(e for e in shown_ if e < 1e6), f.bound, *([1.0] if max(shown_, default=0) > 0.1 else [])])
    return low / 4, high * 4


def law_of(e: Experiment, name: str, x_range: Range, y_range: Range, colour: str) -> list[Line]:
    """Return the law's line, as far as it lies within the chart."""
    if name not in e.laws:
        return []
    law = [(x, float(e.laws[name](x))) for x in np.geomspace(*x_range, LINE_POINTS).tolist()]
    inner = [(x, y) for x, y in law if y_range[0] < y < y_range[1]]
    if len(inner) < 2:
        return []
    xs, ys = zip(*inner, strict=True)
    return [Line(xs, ys, colour, 1.2, "dashed", 0.75)]
