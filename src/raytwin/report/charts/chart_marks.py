"""A chart's shapes in pixels, y down: what every way to draw it has to know, and nothing more."""

import math
from dataclasses import dataclass

import numpy as np

from raytwin.report.charts.chart import FRAME, INK, SOFT, Axes, Chart, Range
from raytwin.report.numbers import short

MARGIN = (80, 30, 60, 50)
"""Pixels left, right, below and above the frame."""

GRID, OUTLINE, FLOOR = "#e9edf1", "#c9ced6", "#eef0f3"

XY = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """`fill` or `line` may be empty."""

    low: XY
    high: XY
    fill: str = ""
    line: str = ""


@dataclass(frozen=True)
class Stroke:
    points: tuple[XY, ...]
    colour: str
    width: float
    dash: str = "solid"
    role: str = ""


@dataclass(frozen=True)
class Marker:
    """`corners`: around `at`, none for a circle; `fill` may be empty; `tip`: lines of text on hover."""

    at: XY
    radius: float
    corners: tuple[XY, ...]
    line: str
    fill: str
    name: str
    tip: str


@dataclass(frozen=True)
class Words:
    """`anchor`: start, middle or end, of what is at `at`; vertically its middle. `halo`: white behind the letters.
    `role`: tick, title, axis or label: a page on a phone enlarges the first and leaves the others out."""

    text: str
    at: XY
    size: float
    colour: str
    bold: bool = False
    anchor: str = "start"
    turned: bool = False
    halo: bool = False
    role: str = ""


@dataclass(frozen=True, eq=False)
class Picture:
    """sRGB uint8 (H, W, 3) that fills the box."""

    low: XY
    high: XY
    pixels: np.ndarray


Shape = Box | Stroke | Marker | Words | Picture


@dataclass(frozen=True, eq=False)
class Drawing:
    width: int
    height: int
    title: str
    shapes: tuple[Shape, ...]


CORNERS = {
    "circle": (),
    "square": ((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)),
    "triangle": ((0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)),
    "diamond": ((0.0, -1.25), (1.25, 0.0), (0.0, 1.25), (-1.25, 0.0)),
}
"""Times the radius."""


def layout(chart: Chart) -> Drawing:
    """Ground, grid and ticks, lines, points, texts, in the order of drawing."""
    left, right, below, above = MARGIN
    frame, bottom, end = Axes(chart.x_range, chart.y_range), above + FRAME[1], left + FRAME[0]

    def at(x: float, y: float) -> XY:
        u, v = frame.pixel(x, y)
        return min(max(left + u, left), end), min(max(bottom - v, above), bottom)

    shapes: list[Shape] = [Box((0, 0), (end + right, bottom + below), fill="#ffffff")]
    if chart.floor is not None and chart.floor > chart.y_range[0]:
        shapes.append(Box((left, at(chart.x_range[0], chart.floor)[1]), (end, bottom), fill=FLOOR))
        shapes.append(Words("below what the reference can tell", (left + 6, bottom - 9), 10, SOFT, role="label"))
    for value in ticks(chart.x_range):
        x, _ = at(value, chart.y_range[0])
        shapes += [
            Stroke(((x, above), (x, bottom)), GRID, 1),
            Words(short(value), (x, bottom + 12), 10.5, SOFT, anchor="middle", role="tick"),
        ]
    for value in ticks(chart.y_range):
        _, y = at(chart.x_range[0], value)
        shapes += [
            Stroke(((left, y), (end, y)), GRID, 1),
            Words(short(value), (left - 7, y), 10.5, SOFT, anchor="end", role="tick"),
        ]
    shapes.append(Box((left, above), (end, bottom), line=OUTLINE))
    for line in chart.lines:
        ends = tuple(at(x, y) for x, y in zip(line.xs, line.ys, strict=True))
        shapes.append(Stroke(ends, faded(line.colour, line.strength), line.width, line.dash))
    for t in chart.texts:
        if t.leader:
            shapes.append(Stroke((at(*t.leader[:2]), at(*t.leader[2:])), faded(t.colour, 0.7), 0.6, role="label"))
    for p in chart.points:
        radius = 5.0 if p.strong else 3.6
        corners = tuple((radius * x, radius * y) for x, y in CORNERS[p.marker])
        shapes.append(Marker(at(p.x, p.y), radius, corners, p.colour, "" if p.hollow else p.colour, p.name, p.tip))
    for t in chart.texts:
        shapes.append(Words(t.text, at(t.x, t.y), 11 if t.bold else 10, t.colour, t.bold, halo=True, role="label"))
    middle = left + FRAME[0] / 2, above + FRAME[1] / 2
    shapes += [
        Words(chart.title, (left, above - 16), 14, INK, bold=True, role="title"),
        Words(chart.x_label, (middle[0], bottom + 32), 12, SOFT, anchor="middle", role="axis"),
        Words(chart.y_label, (18, middle[1]), 12, SOFT, anchor="middle", turned=True, role="axis"),
        Words("; ".join(chart.notes), (left, bottom + 50), 10, SOFT, role="label"),
    ]
    return Drawing(end + right, bottom + below, chart.title, tuple(shapes))


def ticks(ends: Range) -> list[float]:
    """Return at least three: powers of ten, with 2 and 5 or more between where there are few of them; not all of many.

    At least where the ends are a factor of four apart, as those of `log_range` are.
    """
    low, high = sorted(ends)  # an axis may run downwards
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for multiples in ((1,), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        found = [m * 10.0**k for k in decades for m in multiples if low <= m * 10.0**k <= high]
        if len(found) > 2:
            break
    return found[:: max(1, math.ceil(len(found) / 9))]


def faded(colour: str, strength: float) -> str:
    """The colour on white: `strength` 1 is itself."""
    return "#" + "".join(f"{round(255 + (int(colour[i : i + 2], 16) - 255) * strength):02x}" for i in (1, 3, 5))
