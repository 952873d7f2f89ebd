"""What a chart of speed against accuracy holds, both axes logarithmic, in its own units."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from raytwin.report.charts.labels import Label, place

FRAME = (740, 600)
"""Pixels of every chart's frame: labels are placed for this size."""

INK, SOFT = "#1b2330", "#5a6575"

Range = tuple[float, float]


@dataclass(frozen=True)
class Point:
    """`strong`: on the frontier; `hollow`: at or below what the truth can tell, drawn there; `tip`: told on hover."""

    x: float
    y: float
    name: str
    family: str
    colour: str
    marker: str = "circle"
    hollow: bool = False
    strong: bool = False
    tip: str = ""


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
    """`dash`: solid, dotted or dashed; `strength`: 1 is the full colour."""

    xs: tuple[float, ...]
    ys: tuple[float, ...]
    colour: str
    width: float = 1.5
    dash: str = "solid"
    strength: float = 0.8


@dataclass(frozen=True)
class Chart:
    """`floor`: below it the truth cannot tell; `unlabelled`: points for whose label no room was left."""

    key: str
    title: str
    x_label: str
    y_label: str
    x_range: Range
    y_range: Range
    points: tuple[Point, ...] = ()
    texts: tuple[Text, ...] = ()
    lines: tuple[Line, ...] = ()
    floor: float | None = None
    unlabelled: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def log_range(values: Iterable[float], margin: float) -> Range:
    """What shows all values with `margin` of their extent, at least a factor of two, on either side."""
    logs = [math.log10(v) for v in values]
    pad = max(margin * (max(logs) - min(logs)), 0.3)
    return 10 ** (min(logs) - pad), 10 ** (max(logs) + pad)


@dataclass(frozen=True)
class Axes:
    """Between a chart's units and pixels of its frame, x to the right, y up."""

    x_range: Range
    y_range: Range

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        return self._share(x, self.x_range) * FRAME[0], self._share(y, self.y_range) * FRAME[1]

    def units(self, x: float, y: float) -> tuple[float, float]:
        (x0, x1), (y0, y1) = self.x_range, self.y_range
        return x0 * (x1 / x0) ** (x / FRAME[0]), y0 * (y1 / y0) ** (y / FRAME[1])

    @staticmethod
    def _share(value: float, ends: Range) -> float:
        return math.log(value / ends[0]) / math.log(ends[1] / ends[0])


@dataclass(frozen=True)
class Asked:
    """A label that is wanted beside `at`, or one of `others`; `name`: what goes without where there is no room."""

    text: str
    at: Point
    bold: bool = True
    others: tuple[Point, ...] = ()
    name: str = ""


def labelled(chart: Chart, asked: Sequence[Asked]) -> Chart:
    """Return the chart with the labels for which there is room, the first asked first; the others are `unlabelled`."""
    frame = Axes(chart.x_range, chart.y_range)
    labels = [
        Label(a.text, *frame.pixel(a.at.x, a.at.y), 11 if a.bold else 10, a.bold,
              tuple(frame.pixel(p.x, p.y) for p in a.others))
        for a in asked
    ]  # fmt: skip
    texts, without = [], []
    for a, found in zip(asked, place(labels, [frame.pixel(p.x, p.y) for p in chart.points], *FRAME), strict=True):
        if found is None:
            without.append(a.name or a.text)
            continue
        leader = found.leader and (*frame.units(*found.leader[:2]), *frame.units(*found.leader[2:]))
        texts.append(Text(a.text, *frame.units(found.x, found.y), a.at.colour, a.bold, leader))
    return replace(chart, texts=tuple(texts), unlabelled=tuple(without))


def by_family(points: Iterable[Point]) -> list[list[Point]]:
    """The families' points, the first family first."""
    groups: dict[str, list[Point]] = {}
    for point in points:
        groups.setdefault(point.family, []).append(point)
    return list(groups.values())


def joined(groups: Iterable[Sequence[Point]]) -> list[Line]:
    """A line through each group of more than one."""
    return [Line(tuple(p.x for p in g), tuple(p.y for p in g), g[0].colour) for g in groups if len(g) > 1]


def family_chart(
    key: str, title: str, x_label: str, y_label: str, points: Sequence[Point], asked: Sequence[Asked],
    floor: float | None = None, note: str = "",
) -> Chart:  # fmt: skip
    """Return a chart of the points, a line through each family, with its labels."""
    x_range, y_range = log_range([p.x for p in points], 0.15), log_range([p.y for p in points], 0.15)
    lines, notes = tuple(joined(by_family(points))), (note,) if note else ()
    return labelled(
        Chart(key, title, x_label, y_label, x_range, y_range, tuple(points), (), lines, floor, (), notes), asked
    )
