"""A chart of speed against accuracy with two logarithmic axes: its records, and its SVG."""

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from raytwin.safe_write import write_text
from raytwin.show.charts.svg import (
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
"""Pixels: the frame's corner, its size, and the margins to the right and below."""
MARGIN = 0.15
"""Share of the points' extent that a chart of families leaves free on either side."""
FLOOR = "#eef0f3"
"""Colour of the area below the reference's own error."""
LETTER, LINE = 0.66, 14.0
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
    """`dash`: solid or dashed; `strength`: 1 is the full colour."""

    xs: tuple[float, ...]
    ys: tuple[float, ...]
    colour: str
    width: float = 1.5
    dash: str = "solid"
    strength: float = 0.8


@dataclass(frozen=True)
class Chart:
    """`floor`: the reference's own error; errors below it cannot be told apart."""

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
    """Return a range of all values, wider on either side by `margin` of their extent, at least by a factor of two."""
    logs = [math.log10(v) for v in values]
    pad = max(margin * (max(logs) - min(logs)), 0.3)
    return 10 ** (min(logs) - pad), 10 ** (max(logs) + pad)


def by_family(points: Iterable[Point]) -> list[list[Point]]:
    """Group the points by family, in the order in which families first appear."""
    groups: dict[str, list[Point]] = {}
    for point in points:
        groups.setdefault(point.family, []).append(point)
    return list(groups.values())


def family_chart(
    key: str, title: str, x_label: str, y_label: str, points: Sequence[Point], floor: float | None
) -> Chart:  # fmt: skip
    """Return a chart of the points: a line through each family."""
    ranges = log_range([p.x for p in points], MARGIN), log_range([p.y for p in points], MARGIN)
    through = [Line(tuple(p.x for p in g), tuple(p.y for p in g), g[0].colour) for g in by_family(points) if g[1:]]
    return Chart(key, title, x_label, y_label, *ranges, tuple(points), tuple(through), floor)


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
    """Place each label as near to its point as other points and earlier labels allow. Strong points come first."""
    points = [chart.axes.at(p.x, p.y) for p in chart.points]
    placed = [_box((LEFT + 6, TOP + HEIGHT - 9), LETTER * 10 * 31)]  # of the floor's text
    for p in sorted((p for p in chart.points if p.label), key=lambda p: not p.strong):
        at, long = chart.axes.at(p.x, p.y), LETTER * 11 * len(p.label)
        free = [place for place in places(at, long, p.left) if not covered(_box(place, long), placed)]
        clear = (place for place in free if not any(_inside(point, _box(place, long)) for point in points))
        x, y = next(clear, free[0] if free else (LEFT, at[1]))
        placed.append(_box((x, y), long))
        if abs(y - at[1]) > LINE:
            yield stroke((at, (min(max(at[0], x), x + long), y)), faded(p.colour, 0.7), 0.6, role="label")
        size = 11 if p.strong else 10
        yield words(p.label, (x, y), size, p.colour, bold=p.strong, halo=True, role="label")


Box = tuple[float, float, float, float]
"""Left, top, right and bottom of a text."""


def places(at: XY, long: float, left: bool) -> Iterator[XY]:
    """Yield places for the left end of a label `long` pixels wide: beside the point, then further above and below."""
    beside = sorted((at[0] + 9, at[0] - 9 - long), reverse=not left)
    for k in range(2 * int(HEIGHT / LINE) + 2):
        y = at[1] + (k // 2 + k % 2) * LINE * (-1 if k % 2 else 1)
        if TOP + LINE / 2 <= y <= TOP + HEIGHT - LINE / 2:
            yield from ((x, y) for x in beside if LEFT <= x <= LEFT + WIDTH - long)


def covered(label: Box, placed: Iterable[Box]) -> bool:
    left, top, right, bottom = label
    return any(left < r and right > x and top < b and bottom > y for x, y, r, b in placed)


def _box(place: XY, long: float) -> Box:
    x, y = place
    return x, y - LINE / 2, x + long, y + LINE / 2


def _inside(point: XY, label: Box) -> bool:
    x, y = point
    left, top, right, bottom = label
    return left - 5 < x < right + 5 and top - 2 < y < bottom + 2


def chart_html(chart: Chart) -> str:
    """Return a chart for a page. Pointer, touch and arrow keys show numbers. A text has what a phone leaves out."""
    text = f"{chart.title}. Up: {chart.y_label}; to the right: {chart.x_label}. {'; '.join(chart.notes)}"
    about = escape(f"{chart.title}: left and right arrows step through its points")
    return (
        f'<div class="view" tabindex="0" role="group" aria-label="{about}">{svg_text(chart)}</div>'
        f'<p class="chart-words">{escape(text)} Tap a point for its numbers.</p>'
    )


def write_charts(charts: Iterable[Chart], folder: str | os.PathLike[str]) -> None:
    """Write `KEY.svg` of each chart, slashes in the key made dashes."""
    for chart in charts:
        write_text(Path(folder) / f"{chart.key.replace('/', '-')}.svg", svg_text(chart))
