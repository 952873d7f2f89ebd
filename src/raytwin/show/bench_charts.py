"""What the bench's charts hold: error against seconds."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from raytwin.show.charts.chart import Chart, Line, Point, by_family, family_chart
from raytwin.show.charts.svg import INK, SOFT, Range
from raytwin.show.numbers import seconds, shown
from raytwin.show.terminal_text import counted
from raytwin.study.bench import RENDERERS, Bench, Measurement, staircase

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

GUIDE = "#b9c0ca"
SLOPE = -0.5
"""Of Monte Carlo's RMSE against seconds, both logarithmic."""


def colour_of(method: str) -> str:
    if method not in RENDERERS:
        return OWN_COLOUR
    return next((colour for part, colour in COLOURS.items() if part in method), SOFT)


def megapixels(size: tuple[int, int]) -> str:
    return f"{size[0] * size[1] / 1e6:.2g} MP"


# ------------------------------------------------------------------------------------------ error against seconds


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
    groups = by_family(sorted(points, key=lambda p: (p.family, order.get(p.name, 0))))
    named = [p for group in groups for p in (*group[:-1], group[-1] if group[-1].label else rest_of(group))]
    drawn = family_chart(
        f"{size[0]}x{size[1]}/{truth}",
        f"{bench.scene}, {megapixels(size)}, against {TRUTHS.get(truth, truth)}",
        "seconds per frame (median)",
        "RMSE",
        named,
        floor or None,
    )
    stairs = steps([points[i] for i in staircase(times, errors, floor)], drawn.x_range[1])
    bars = [error_bar(r, p.colour, drawn.y_range) for r, p in zip(found, points, strict=True) if r.rmse_sigma]
    lines = *drawn.lines, *guides(drawn.x_range, drawn.y_range), *bars, stairs
    notes = "thin grey lines: slope −1/2, Monte Carlo's", "upright: two standard errors either way"
    return replace(drawn, lines=lines, notes=notes)


def error_bar(r: Measurement, colour: str, y_range: Range) -> Line:
    """Return the upright of two standard errors either way, as far as it lies within the chart."""
    reach = 2 * (r.rmse_sigma or 0.0)
    ends = max(r.rmse - reach, y_range[0]), min(max(r.rmse + reach, y_range[0]), y_range[1])
    return Line((r.seconds_median,) * 2, ends, colour)


def rest_of(family: Sequence[Point]) -> Point:
    """Return the last point of a family, labelled with the family's name, or its own where it is the only one."""
    return replace(family[-1], label=family[-1].family if len(family) > 1 else family[-1].name)


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


def guides(x_range: Range, y_range: Range) -> list[Line]:
    """Return lines of the slope of Monte Carlo's RMSE, some decades apart, through the frame."""
    (x0, x1), (y0, y1) = np.log10(x_range), np.log10(y_range)
    apart = max(1.0, (y1 - y0 - SLOPE * (x1 - x0)) / 6)
    lines, height = [], y0 + apart / 2
    while height + SLOPE * (x1 - x0) < y1:
        start, end = max(x0, x0 + (height - y1) / -SLOPE), min(x1, x0 + (height - y0) / -SLOPE)
        if end > start:
            ys = tuple(10 ** float(height + SLOPE * (x - x0)) for x in (start, end))
            lines.append(Line((10 ** float(start), 10 ** float(end)), ys, GUIDE, 1.0, "dotted", 1.0))
        height += apart
    return lines
