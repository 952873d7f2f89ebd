"""A chart of any rows, for a notebook: what a sweep or a table of results shows."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from raytwin import files
from raytwin.errors import InputError
from raytwin.report.charts.chart import Point, family_chart, svg_text

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
    points: list[Point] = []
    kept.sort(key=lambda row: row[x])
    last = {str(row.get(by)): row for row in kept} if by else {}
    for row in kept:
        line, tip = str(row.get(by)) if by else "", f"{x} {row[x]:.4g}, {y} {row[y]:.4g}"
        own = str(row.get(name)) if name else line
        label = own if name or last.get(line) is row else ""
        points.append(Point(row[x], row[y], own, line, colour[line], strong=True, tip=tip, label=label))
    return RowsChart(svg_text(family_chart("rows", title, x, y, points)))
