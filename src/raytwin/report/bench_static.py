"""The charts for paper and the README: SVG and PNG by Matplotlib, since Bokeh needs a browser for either."""

import os
from collections.abc import Iterable
from pathlib import Path

from raytwin.report.charts import FRAME, INK, SOFT, Chart

MARKERS = {"square": "s", "circle": "o", "triangle": "^", "diamond": "D"}
DASHES = {"solid": "-", "dotted": ":", "dashed": "--"}
MARGIN = (80, 30, 60, 50)
"""Pixels left, right, below and above the frame."""


def write_static(charts: Iterable[Chart], folder: str | os.PathLike) -> list[Path]:
    """`KEY.svg` and `KEY.png` of each chart, slashes in the key made dashes."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    left, right, below, above = MARGIN
    width, height = FRAME[0] + left + right, FRAME[1] + below + above
    written = []
    for chart in charts:
        figure = Figure(figsize=(width / 100, height / 100), dpi=100)
        FigureCanvasAgg(figure)
        axes = figure.add_axes((left / width, below / height, FRAME[0] / width, FRAME[1] / height))
        draw(axes, chart)
        for suffix, options in ((".svg", {"metadata": {"Date": None}}), (".png", {"dpi": 200})):
            path = Path(folder) / (chart.key.replace("/", "-") + suffix)
            with rc_context({"svg.fonttype": "none", "svg.hashsalt": "raytwin"}):  # text stays text, files repeat
                figure.savefig(path, **options)
            written.append(path)
    return written


def draw(axes, chart: Chart) -> None:
    ground = {"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.2}
    axes.set(xscale="log", yscale="log", xlim=chart.x_range, ylim=chart.y_range)
    axes.set_xlabel(chart.x_label, color=INK)
    axes.set_ylabel(chart.y_label, color=INK)
    axes.set_title(chart.title, color=INK, fontsize=11, loc="left")
    axes.grid(True, which="major", color="#e2e6eb", linewidth=0.7)
    axes.set_axisbelow(True)
    if chart.floor is not None and chart.floor > chart.y_range[0]:
        axes.axhspan(chart.y_range[0], chart.floor, color="#eef0f3", zorder=0)
        axes.text(
            *chart.x_range[:1], chart.y_range[0] * 1.2, " below what the truth can tell", fontsize=7.5, color=SOFT
        )
    for line in chart.lines:
        axes.plot(line.xs, line.ys, DASHES[line.dash], color=line.colour, linewidth=line.width,
                  alpha=0.35 if line.colour == INK else 0.8, zorder=1)  # fmt: skip
    for p in chart.points:
        axes.plot(p.x, p.y, MARKERS[p.marker], color=p.colour, markersize=6 if p.frontier else 4.5,
                  fillstyle="none" if p.hollow else "full", zorder=3)  # fmt: skip
    for t in chart.texts:
        if t.leader:
            axes.plot(t.leader[::2], t.leader[1::2], "-", color=t.colour, linewidth=0.4, alpha=0.7, zorder=2)
        axes.text(
            t.x, t.y, t.text, ha="left", va="center_baseline", color=t.colour, fontsize=7.2 if t.bold else 6.6,
            fontweight="bold" if t.bold else "normal", zorder=4, bbox=ground,
        )  # fmt: skip
    axes.text(0.0, -0.095, "; ".join(chart.notes), transform=axes.transAxes, fontsize=7.5, color=SOFT)
