"""A chart of speed against accuracy, both axes logarithmic: what it holds, and how it is drawn."""

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from raytwin import files
from raytwin.report.charts.svg import (
    INK,
    OUTLINE,
    XY,
    Axes,
    Range,
    box,
    drawing,
    faded,
    marker,
    stroke,
    words,
)

LEFT, TOP, WIDTH, HEIGHT, RIGHT, BOTTOM = 80, 50, 740, 600, 30, 60
"""Pixels: the frame's corner, its size, and what is right of it and below."""
FLOOR = "#eef0f3"
LETTER, LINE = 0.66, 13.0
"""Average width of a label's letter, as a share of its size; and pixels from one label down to the next."""


@dataclass(frozen=True)
class Point:
    """`strong`: on the frontier; `hollow`: at or below what the reference can tell, drawn there; `tip`: shown on hover.

    `label` is written beside it: to the right, or to the `left`, if there is room.
    """

    x: float
    y: float
    name: str
    family: str
    colour: str
    marker: str = "circle"
    hollow: bool = False
    strong: bool = False
    tip: str = ""
    label: str = ""
    left: bool = False


@dataclass(frozen=True)
class Line:
    """`dash`: solid, dotted or dashed; `strength`: 1 is the full colour."""

    xs: tuple[float, ...]
    ys: tuple[float, ...]
    colour: str
    width: float = 1.5
    dash: str = "solid"
    strength: float = 0.8


@dataclass(frozen=True)
class Chart:
    """`floor`: below it the reference cannot tell."""

    key: str
    title: str
    x_label: str
    y_label: str
    x_range: Range
    y_range: Range
    points: tuple[Point, ...] = ()
    lines: tuple[Line, ...] = ()
    floor: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def axes(self) -> Axes:
        return Axes(LEFT, TOP, WIDTH, HEIGHT, self.x_range, self.y_range, logarithmic=True)


def log_range(values: Iterable[float], margin: float) -> Range:
    """Return what shows all values with `margin` of their extent, at least a factor of two, on either side."""
    logs = [math.log10(v) for v in values]
    pad = max(margin * (max(logs) - min(logs)), 0.3)
    return 10 ** (min(logs) - pad), 10 ** (max(logs) + pad)


def by_family(points: Iterable[Point]) -> list[list[Point]]:
    """Return each family's points, the first family first."""
    groups: dict[str, list[Point]] = {}
    for point in points:
        groups.setdefault(point.family, []).append(point)
    return list(groups.values())


def family_chart(
    key: str, title: str, x_label: str, y_label: str, points: Sequence[Point], floor: float | None = None,
    notes: Iterable[str] = (), lines: Iterable[Line] = (), margin: float = 0.15,
) -> Chart:  # fmt: skip
    """Return a chart of the points: a line through each family, and `lines`."""
    ranges = log_range([p.x for p in points], margin), log_range([p.y for p in points], margin)
    through = [Line(tuple(p.x for p in g), tuple(p.y for p in g), g[0].colour) for g in by_family(points) if g[1:]]
    shown = tuple(filter(None, notes))
    return Chart(key, title, x_label, y_label, *ranges, tuple(points), (*through, *lines), floor, shown)


def svg_text(chart: Chart) -> str:
    """Draw ground, grid and ticks, lines, points and texts, in this order."""
    axes = chart.axes
    (left, top), (right, bottom) = axes.corners
    width, height = right + RIGHT, bottom + BOTTOM
    shapes = [box((0, 0), (width, height), fill="#ffffff")]
    if chart.floor is not None and chart.floor > chart.y_range[0]:
        shapes.append(box((left, axes.at(chart.x_range[0], chart.floor)[1]), (right, bottom), fill=FLOOR))
        shapes.append(words("below what the reference can tell", (left + 6, bottom - 9), 10, role="label"))
    shapes += [*axes.grid(), box(*axes.corners, line=OUTLINE)]
    for line in chart.lines:
        ends = [axes.at(x, y) for x, y in zip(line.xs, line.ys, strict=True)]
        shapes.append(stroke(ends, faded(line.colour, line.strength), line.width, line.dash))
    for p in chart.points:
        shapes.append(marker(axes.at(p.x, p.y), 5.0 if p.strong else 3.6, p.colour, p.name, p.tip, p.marker, p.hollow))
    shapes += [
        *label_shapes(chart),
        words(chart.title, (left, top - 16), 14, INK, bold=True, role="title"),
        words(chart.x_label, (left + WIDTH / 2, bottom + 32), 12, anchor="middle", role="axis"),
        words(chart.y_label, (18, top + HEIGHT / 2), 12, anchor="middle", turned=True, role="axis"),
        words("; ".join(chart.notes), (left, bottom + 50), 10, role="label"),
    ]
    return drawing(width, height, chart.title, shapes)


def label_shapes(chart: Chart) -> Iterator[str]:
    """Write the labels beside their points, those of strong points first, as near to their height as the labels
    before them leave room for."""
    placed: list[tuple[float, float, float]] = []
    for p in sorted((p for p in chart.points if p.label), key=lambda p: not p.strong):
        at, long = chart.axes.at(p.x, p.y), LETTER * 11 * len(p.label)
        free = (place for place in places(at, long, p.left) if not covered(place, long, placed))
        x, y = next(free, (max(LEFT, min(at[0] + 9, LEFT + WIDTH - long)), at[1]))  # or over another
        placed.append((x, y, long))
        if abs(y - at[1]) > LINE:
            yield stroke((at, (x if x > at[0] else x + long, y)), faded(p.colour, 0.7), 0.6, role="label")
        size = 11 if p.strong else 10
        yield words(p.label, (x, y), size, p.colour, bold=p.strong, halo=True, role="label")


def places(at: XY, long: float, left: bool) -> Iterator[XY]:
    """Yield left ends of a label `long` pixels wide: right and left of a point, ever higher and lower."""
    sides = sorted((at[0] + 9, at[0] - 9 - long), reverse=not left)
    for k in range(2 * int(HEIGHT / LINE) + 2):
        y = at[1] + (k // 2 + k % 2) * LINE * (-1 if k % 2 else 1)
        if TOP <= y <= TOP + HEIGHT:
            yield from ((x, y) for x in sides if LEFT <= x <= LEFT + WIDTH - long)


def covered(place: XY, long: float, placed: Sequence[tuple[float, float, float]]) -> bool:
    x, y = place
    return any(abs(y - v) < LINE - 0.5 and x < u + wide and u < x + long for u, v, wide in placed)


def chart_html(chart: Chart) -> str:
    """Return a chart for a page: its numbers by pointer, touch and arrow keys; what a phone leaves out, as text."""
    text = f"{chart.title}. Up: {chart.y_label}; to the right: {chart.x_label}. {'; '.join(chart.notes)}"
    about = escape(f"{chart.title}: left and right arrows step through its points")
    return (
        f'<div class="view" tabindex="0" role="group" aria-label="{about}">{svg_text(chart)}</div>'
        f'<p class="chart-words">{escape(text)} Tap a point for its numbers.</p>'
    )


def write_charts(charts: Iterable[Chart], folder: str | os.PathLike[str]) -> None:
    """Write `KEY.svg` of each chart, slashes in the key made dashes."""
    for chart in charts:
        files.write_text(Path(folder) / f"{chart.key.replace('/', '-')}.svg", svg_text(chart))
