"""A chart of any rows, for a notebook: what a sweep or a table of results shows."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from raytwin import files
from raytwin.errors import InputError
from raytwin.report.charts.chart import Asked, Chart, Line, Point, log_range, placed
from raytwin.report.charts.chart_marks import layout
from raytwin.report.charts.svg import svg_text

COLOURS = ("#0f8b8d", "#e07b00", "#7a3e9d", "#c02f4a", "#3b82c4", "#a16207")
"""One per line, in turn; told apart by the colour-blind, and readable on white."""


@dataclass(frozen=True)
class RowsChart:
    """A chart as SVG text; a notebook shows it."""

    svg: str

    def _repr_svg_(self) -> str:
        return self.svg

    def save(self, path: str | Path) -> None:
        """Write the chart to an SVG file."""
        files.write_text(Path(path), self.svg)

    def __repr__(self) -> str:
        return f"<raytwin.chart, {len(self.svg) / 1000:.0f} kB of SVG>"


def chart(
    rows: Iterable[Mapping[str, Any]],
    x: str,
    y: str,
    *,
    by: str | None = None,
    name: str | None = None,
    title: str = "",
) -> RowsChart:
    """Return the chart of column `y` against column `x` of `rows`, both axes logarithmic.

    `rows` are dicts, as `table()` returns them. `by`: the column that says which points a line joins. `name`: the
    column that labels points. `title` stands above the chart. Rows without a positive number in `x` and `y` are left
    out. Raises InputError if none has.

    >>> chart([{"samples": n, "rmse": n**-0.5} for n in (1, 4, 16)], "samples", "rmse").svg[:4]
    '<svg'
    """
    kept = [row for row in rows if all(isinstance(row.get(k), int | float) and row[k] > 0 for k in (x, y))]
    if not kept:
        raise InputError("rows", f"some with positive numbers in {x!r} and {y!r}", "none")
    lines = list(dict.fromkeys(str(row.get(by)) if by else "" for row in kept))
    colour = {line: COLOURS[i % len(COLOURS)] for i, line in enumerate(lines)}
    points = [_point(row, x, y, by, name, colour) for row in sorted(kept, key=lambda row: row[x])]
    ranges = log_range([p.x for p in points], 0.15), log_range([p.y for p in points], 0.15)
    own = {line: [p for p in points if p.family == line] for line in lines}
    labelled = points if name else [own[line][-1] for line in lines if line]
    asked = [Asked(p.name, p) for p in labelled]
    texts, without = placed(asked, points, *ranges)
    drawn = Chart("rows", title, x, y, *ranges, tuple(points), texts, _joined(own, colour), None, without)
    return RowsChart(svg_text(layout(drawn)))


def _point(
    row: Mapping[str, Any], x: str, y: str, by: str | None, name: str | None, colour: Mapping[str, str]
) -> Point:
    line = str(row.get(by)) if by else ""
    tip = f"{x} {row[x]:.4g}, {y} {row[y]:.4g}"
    return Point(row[x], row[y], str(row.get(name)) if name else line, line, colour[line], strong=True, tip=tip)


def _joined(own: Mapping[str, Sequence[Point]], colour: Mapping[str, str]) -> tuple[Line, ...]:
    return tuple(
        Line(tuple(p.x for p in points), tuple(p.y for p in points), colour[line])
        for line, points in own.items() if len(points) > 1
    )  # fmt: skip
