"""The ladder as a page: any two of its pictures in the viewer, error against seconds, and what each rung leaves out."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from raytwin import files
from raytwin.image import Image
from raytwin.report.bench_charts import Mark, marks_chart
from raytwin.report.charts.chart import Chart, chart_html, write_charts
from raytwin.report.numbers import seconds, shown
from raytwin.report.page import write_page
from raytwin.report.picture_pair import SCRIPTS, STYLES, picture_pair

if TYPE_CHECKING:
    from raytwin.analysis.ladder import Ladder, Rungs

PARTS = {
    "numerics": "#6b7280", "its own samples": "#6b7280", "pixel sampling": "#a16207", "sun's shadow": "#174a7c",
    "sky's occlusion": "#3b82c4", "bounce 1": "#c02f4a", "bounce 2": "#e07b00", "bounces 3 and more": "#d4a017",
}  # fmt: skip
FIRST = "tracer: shadow", "twin: path"
"""The pictures that the page opens with."""


def write_ladder(found: "Ladder", folder: str | os.PathLike[str]) -> None:
    """ladder.html, ladder.json, and the chart as SVG."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    rungs, images = found.rungs, found.images
    drawn = error_chart(rungs)
    write_page(
        folder / "ladder.html",
        "ladder.html.j2",
        ("bench.css", *STYLES),
        SCRIPTS,
        l=rungs,
        colours=PARTS,
        **picture_pair({name: Image(mean) for name, mean in images.items()}, FIRST, "global illumination"),
        bars=[(rung, bars(rungs, rung)) for rung in rungs.ledgers],
        chart=chart_html(drawn),
    )
    files.write_json(folder / "ladder.json", rungs)
    write_charts([drawn], folder)


def ladder_summary(rungs: "Rungs") -> str:
    """A line each rung and side, then what each rung leaves out."""
    lines = [f"{rungs.scene}, {rungs.width} x {rungs.height}, {rungs.samples} samples per pixel where light is sampled"]
    for step in rungs.steps:
        error = "no light" if step.rmse is None else f"rmse {shown(step.rmse, 3)}"
        noise = "" if step.noise is None else f", of it noise {shown(step.noise, 2)}"
        lines.append(f"  {step.rung:<8} {step.side:<6} {seconds(step.seconds):>9}   {error}{noise}")
    for rung, parts in rungs.ledgers.items():
        shares = [
            f"{part.part} {100 * part.share_of_light:+.2g} %"
            for part in parts
            if part.share_of_light is not None and abs(part.share_of_light) >= 5e-4
        ]
        lines.append(
            f"  {rung}: " + (", ".join(shares) + " of the light" if shares else "no part above 0.05 % of the light")
        )
    return "\n".join(lines)


def error_chart(rungs: "Rungs") -> Chart:
    """Every lit rung's error against its seconds; a line a side."""
    twin_first = sorted(rungs.steps, key=lambda s: s.side, reverse=True)  # in its colour on every chart
    marks = [Mark(s.side, s.rung, s.method, s.seconds, s.rmse) for s in twin_first if s.rmse is not None]
    title, error = f"{rungs.scene}: every rung on both sides", "RMSE against global illumination"
    return marks_chart("ladder", title, "seconds per frame", error, marks, rungs.floor)


def bars(rungs: "Rungs", rung: str) -> list[dict[str, Any]]:
    """A rung's parts as bars: `width` in percent of the largest rmse of all rungs."""
    most = max(part.rmse or 0.0 for parts in rungs.ledgers.values() for part in parts if part.part in PARTS) or 1.0
    return [
        {
            "part": part.part,
            "width": 100 * (part.rmse or 0.0) / most,
            "colour": PARTS[part.part],
            "rmse": part.rmse,
            "share": part.share_of_light,
            "between": part.between,
        }
        for part in rungs.ledgers[rung]
        if part.part in PARTS
    ]
