"""What `raytwin levels` found: its page, and its lines for the terminal."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from raytwin.scene.toml_json import write_json
from raytwin.show.charts.chart import Chart, Point, chart_html, family_chart, write_charts
from raytwin.show.numbers import seconds, shown
from raytwin.show.page import write_page
from raytwin.show.picture_pair import SCRIPTS, STYLES, picture_pair
from raytwin.show.terminal_text import counted

if TYPE_CHECKING:
    from raytwin.study.levels import Levels, Row, Table

LIGHT = {
    "none": "the background alone", "lambert": "sun and sky without shadows",
    "shadow": "cast shadows of the sun, sky without occlusion", "sky": "direct light of sun and sky",
}  # fmt: skip
"""What a light level computes, in words; `path` says its bounces."""


def write_levels(levels: "Levels", folder: str | os.PathLike[str]) -> None:
    """levels.html, levels.json, and the chart as SVG."""
    folder = Path(folder)
    found, drawn = levels.found, error_chart(levels.found)
    names = list(levels.images)
    first = next((name for name in names if name.startswith("tracer: shadow")), names[0]), names[-1]
    write_page(
        folder / "levels.html",
        "levels.html.j2",
        ("bench.css", *STYLES),
        SCRIPTS,
        l=found,
        answer=answer(found),
        words=words,
        chart=chart_html(drawn),
        **picture_pair(levels.images, first, names[-1]),
    )
    write_json(folder / "levels.json", found)
    write_charts([drawn], folder)


def levels_summary(found: "Table") -> str:
    """The recommendation, then a line per method and per part of the light."""
    lines = [f"{found.scene}, {found.width} x {found.height}", *answer(found), "  rays per pixel       time  error"]
    for row in found.rows:
        chosen = "*" if row == found.choice else " "
        lines.append(f"{chosen} {row.rays:14.4g}  {seconds(row.seconds):>9}  {shown(row.error, 3):<9} {row.method}")
    lines.append("  error without it     of the light")
    for part in found.parts:
        share = "" if part.share_of_light is None else f"{100 * part.share_of_light:+.2g} %"
        lines.append(f"  {shown(part.error, 3):<20} {share:<13} {part.part}")
    return "\n".join(lines)


def answer(found: "Table") -> list[str]:
    """Return the recommendation in sentences."""
    if found.tolerance is None:
        best = min((row for row in found.rows if row.side == "tracer"), key=lambda row: row.error)
        said = [f"The smallest {found.metric} measured is {shown(best.error, 2)}: {words(best)}."]
        return [*said, "--tolerance T names the cheapest method whose error is at most T."]
    goal = f"{found.metric} <= {found.tolerance:g}"
    if found.choice is None:
        return [f"No method is recommended for {goal}: {found.reason}."]
    choice, tracer = found.choice, [row for row in found.rows if row.side == "tracer"]
    rays = f"{choice.rays:.3g}"
    said = [
        f"Cheapest with {goal}: {words(choice)} ({choice.method}).",
        f"Its {found.metric} is {shown(choice.error, 2)}.",
        f"It costs {rays} ray{'s' * (rays != '1')} per pixel, shadow rays included.",
    ]
    if place := tracer.index(choice):
        cheaper = tracer[place - 1]
        relation = "exceeds it" if cheaper.error > found.tolerance else "cannot be told from it"
        said.append(f"The next cheaper, {cheaper.method}, has {shown(cheaper.error, 2)}, which {relation}.")
    spared = [part.part for part in found.parts if part.can_be_dropped]
    bounces = [name for name in spared if "bounces" in name]
    spared = [name for name in spared if name not in bounces[1:]]  # the first includes the others
    said.append(
        f"Any one of these can be left out and {goal} still holds: {', '.join(spared)}."
        if spared
        else "No part can be left out."
    )
    return said


def words(row: "Row") -> str:
    """Return a method in words."""
    light = LIGHT.get(row.rung) or f"light with at most {counted((row.depth or 2) - 2, 'bounce')}"
    if row.rung == "none":
        return light
    rays = "one ray per pixel" if row.sampling == "center" else f"{counted(row.samples, 'sample')} per pixel"
    return f"{light}, {rays}{' (Mitsuba)' if row.side == 'twin' else ''}"


COLOURS = {
    "lambert": "#e07b00", "shadow": "#0f8b8d", "sky": "#3b82c4", "path depth 3": "#8e44ad", "path depth 4": "#c02f4a",
    "path depth 8": "#a16207", "Mitsuba": "#6b7280",
}  # fmt: skip
"""A line of the chart -> its colour; in this order."""


def error_chart(found: "Table") -> Chart:
    """Return each method's error against the rays that it costs, a line per light level."""
    points: list[Point] = []
    for row in found.rows:
        if row.rays == 0:  # no place on a logarithmic axis
            continue
        family = "Mitsuba" if row.side == "twin" else f"path depth {row.depth}" if row.rung == "path" else row.rung
        label = row.rung if row.side == "twin" else str(row.samples)
        label = label if any(p.family == family for p in points) else f"{family}: {label}"
        points.append(
            Point(
                row.rays,
                max(row.error, found.floor, 1e-16),
                name=row.method,
                family=family,
                colour=COLOURS[family],
                hollow=row.error <= found.floor,
                strong=row == found.choice,
                tip=f"{row.method}\n{row.rays:.3g} rays per pixel, {seconds(row.seconds)}, error {shown(row.error)}",
                label=label,
            )
        )
    points.sort(key=lambda point: list(COLOURS).index(point.family))  # stable: each line from the lowest cost up
    title = f"{found.scene}: error against cost"
    return family_chart("levels", title, "rays per pixel", f"{found.metric} against all light", points, found.floor)
