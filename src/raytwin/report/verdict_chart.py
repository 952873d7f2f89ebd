"""The charts of `raytwin bench verdict`: samples and seconds to certainty against the size of the fault."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from raytwin.bench.bench_verdict import Certainty, VerdictBench
from raytwin.report.charts.rows_chart import chart
from raytwin.report.numbers import seconds as in_seconds

FILES = {"samples": "verdict-samples.svg", "seconds": "verdict-seconds.svg"}


def write_verdict_charts(found: VerdictBench, folder: Path) -> None:
    """Write a chart of samples and one of seconds, over the first scene's faults of the whole image.

    A tool that fails most of the correct pairs there is left out: it notices whatever it is shown.
    """
    scene = found.rows[0].scene
    wrong = {row.tool for row in found.alarms if row.scene == scene and row.alarms > row.asked / 2}
    rows = [
        {
            "size of the fault, %": 100 * row.size,
            "samples per pixel": row.samples,
            "seconds": row.seconds,
            "tool": row.tool,
        }
        for row in found.rows
        if row.scene == scene and row.where == "whole image" and row.samples and row.tool not in wrong
    ]
    for what, name in FILES.items():
        column = "samples per pixel" if what == "samples" else what
        title = f"{what.capitalize()} until the fault is certain ({scene}, 80 x 60 pixels)"
        chart(rows, "size of the fault, %", column, by="tool", title=title).save(folder / name)


def verdict_lines(found: VerdictBench) -> Iterator[str]:
    """The table in words: a line per scene and fault, every tool's samples; then the alarms."""
    tools = list(dict.fromkeys(row.tool for row in found.rows))
    yield f"{'scene':<10} {'fault':<40} " + " ".join(f"{tool:>18}" for tool in tools)
    faults = dict.fromkeys((row.scene, row.fault) for row in found.rows)
    for scene, fault in faults:
        mine = {row.tool: row for row in found.rows if (row.scene, row.fault) == (scene, fault)}
        yield f"{scene:<10} {fault:<40} " + " ".join(f"{_cell(mine.get(tool)):>18}" for tool in tools)
    for row in found.alarms:
        yield f"{row.scene:<10} {row.tool:<20} fails {row.alarms} of {row.asked} correct pairs"
    if ratios := found.ratios():
        worst, median = max(ratios), float(np.median(ratios))
        yield f"samples in rounds over the best fixed number: median {median:.2f}, worst {worst:.2f}"


def _cell(row: Certainty | None) -> str:
    if row is None:
        return "-"
    return "not seen" if row.samples is None else f"{row.verdict} {row.samples:g}, {in_seconds(row.seconds)}"
