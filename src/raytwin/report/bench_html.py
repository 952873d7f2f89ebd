"""bench.html: one file that opens offline: the frontier by size, truth and metric, growth, every number."""

import os
from dataclasses import astuple

from bokeh.core.properties import value
from bokeh.embed import components
from bokeh.models import ColumnDataSource, CustomJSHover, HoverTool, Range1d, WheelZoomTool
from bokeh.plotting import figure

from raytwin import files
from raytwin.bench import METHODS, Bench, Changes
from raytwin.report import numbers
from raytwin.report.charts import (
    COLOURS,
    FRAME,
    INK,
    METRICS,
    SOFT,
    TRUTHS,
    Chart,
    error_chart,
    megapixels,
    side_charts,
    sizes_of,
)
from raytwin.report.figures import script_of_bokeh
from raytwin.report.html import asset, environment

FIRST = ("path-area", "relmse")
"""What the chart shows when the page opens."""

FONT = "DejaVu Sans, system-ui, sans-serif"

SHOWN = (
    "samples",
    "seconds_median",
    "seconds_iqr",
    "compile_seconds",
    "peak_mib",
    "rmse",
    "relmse",
    "p999_abs",
    "flip",
)
"""Of a row, the numbers of the hover and the table."""


def write_bench_page(bench: Bench, path: str | os.PathLike, changes: Changes | None = None) -> None:
    """The page. Every chart of every size, truth and metric lies in it as plain numbers, labels placed."""
    charts = all_charts(bench)
    growth = side_charts(bench)
    first = first_chart(charts)
    figures = ([frontier_figure(first)] if first else []) + [growth_figure(c) for c in growth]
    script, elements = components(figures) if figures else ("", ())
    elements = list(elements)
    page = environment().from_string(asset("bench.html.j2")).render(
        b=bench,
        changes=changes,
        bokeh=script_of_bokeh(),
        script=script,
        css=asset("report.css") + asset("bench.css"),
        js=asset("bench.js"),
        frontier=elements.pop(0) if first else "",
        growth=list(zip(growth, elements, strict=True)),
        data={
            "charts": {c.key: as_data(c) for c in charts},
            "rows": {f"{r.method}@{r.width}x{r.height}": row_texts(r) for r in bench.rows},
            "first": first.key if first else "",
        },
        sizes=[(f"{w}x{h}", f"{w} × {h}, {megapixels((w, h))}") for w, h in sizes_of(bench)],
        truths=[(t, TRUTHS.get(t, t)) for t in dict.fromkeys(t.name for t in bench.truths)],
        metrics=[(m, words) for m, words in METRICS.items() if any(c.key.endswith(f"/{m}") for c in charts)],
        first=first.key.split("/") if first else ["", "", ""],
        kinds=kinds(bench),
        never=never(bench),
        shown=SHOWN,
    )  # fmt: skip
    files.write_text(path, page)


def all_charts(bench: Bench) -> list[Chart]:
    return [
        chart
        for size in sizes_of(bench)
        for truth in dict.fromkeys(t.name for t in bench.truths if (t.width, t.height) == size)
        for metric in METRICS
        if (chart := error_chart(bench, size, truth, metric)) is not None
    ]


def first_chart(charts: list[Chart]) -> Chart | None:
    wanted = "/" + "/".join(FIRST)
    return next((c for c in charts if c.key.endswith(wanted)), charts[0] if charts else None)


def never(bench: Bench) -> list[str]:
    """The methods that were measured and are on no frontier, at no size and against no truth."""
    on = {e.method for e in bench.errors if e.on_frontier}
    return [m for m in dict.fromkeys(r.method for r in bench.rows) if m not in on]


def kinds(bench: Bench) -> list[tuple[str, str]]:
    """(first words of families, colour) of what was measured, for the key."""
    measured = {m.family for m in METHODS if m.name in {r.method for r in bench.rows}}
    return [(start, colour) for start, colour in COLOURS.items() if any(f.startswith(start) for f in measured)]


# ------------------------------------------------------------------------------------------ the charts in Bokeh


def as_data(chart: Chart) -> dict:
    """What bench.js puts into the figure's sources."""
    columns = list(zip(*map(astuple, chart.points), strict=True)) or [()] * 8
    names = "x", "y", "method", "family", "colour", "marker", "hollow", "frontier"
    points = dict(zip(names, map(list, columns), strict=True))
    points["alpha"] = [0.0 if hollow else 1.0 for hollow in points.pop("hollow")]
    points["size"] = [10 if on else 7 for on in points["frontier"]]
    return {
        "title": chart.title,
        "y_label": chart.y_label,
        "x_range": chart.x_range,
        "y_range": chart.y_range,
        "floor": chart.floor,
        "notes": "; ".join(chart.notes),
        "unlabelled": list(chart.unlabelled),
        "points": points,
        "lines": {
            "xs": [list(line.xs) for line in chart.lines],
            "ys": [list(line.ys) for line in chart.lines],
            "colour": [line.colour for line in chart.lines],
            "width": [line.width for line in chart.lines],
            "dash": [line.dash for line in chart.lines],
            "alpha": [0.35 if line.colour == INK else 0.8 for line in chart.lines],
        },
        "texts": texts_of(chart, True),
        "small": texts_of(chart, False),
        "leaders": leaders_of(chart),
    }


def texts_of(chart: Chart, bold: bool) -> dict:
    texts = [t for t in chart.texts if t.bold == bold]
    return {
        "x": [t.x for t in texts],
        "y": [t.y for t in texts],
        "text": [t.text for t in texts],
        "colour": [t.colour for t in texts],
    }


def leaders_of(chart: Chart) -> dict:
    texts = [t for t in chart.texts if t.leader]
    return {k: [t.leader[i] for t in texts] for i, k in enumerate(("x0", "y0", "x1", "y1"))} | {
        "colour": [t.colour for t in texts]
    }


def row_texts(row) -> list[str]:
    """The numbers of SHOWN, as the hover says them."""
    texts = []
    for name in SHOWN:
        value = getattr(row, name)
        texts.append(numbers.seconds(value) if "seconds" in name else numbers.shown(value))
    return texts


def _figure(chart: Chart, tools: list):
    p = figure(
        x_axis_type="log", y_axis_type="log", x_range=Range1d(*chart.x_range), y_range=Range1d(*chart.y_range),
        frame_width=FRAME[0], frame_height=FRAME[1], tools=["pan", "box_zoom", "reset", *tools],
        toolbar_location="above", min_border=2, outline_line_color="#c9ced6", title=chart.title,
        x_axis_label=chart.x_label, y_axis_label=chart.y_label,
    )  # fmt: skip
    p.toolbar.logo = None
    p.title.text_color, p.title.text_font_size = INK, "14px"
    p.axis.axis_label_text_color = SOFT
    p.axis.axis_label_text_font_style = "normal"
    p.grid.grid_line_color = "#e9edf1"
    return p


def _glyphs(p, data: dict, named: bool = False):
    """Lines below, points above them, texts on top; `named`: each source has a name, for bench.js to fill it anew."""
    sources = {
        n: ColumnDataSource(data[n], name=n if named else None)
        for n in ("points", "lines", "texts", "small", "leaders")
    }
    p.multi_line(
        "xs", "ys", source=sources["lines"], line_color="colour", line_width="width", line_dash="dash",
        line_alpha="alpha",
    )  # fmt: skip
    p.segment("x0", "y0", "x1", "y1", source=sources["leaders"], line_color="colour", line_width=0.6, line_alpha=0.7)
    dots = p.scatter(
        "x", "y", source=sources["points"], marker="marker", size="size", line_color="colour", fill_color="colour",
        fill_alpha="alpha", line_width=1.4,
    )  # fmt: skip
    for name, size, style in (("small", "10px", "normal"), ("texts", "11px", "bold")):
        p.text(
            "x", "y", "text", source=sources[name], text_color="colour", text_font_size=size, text_font_style=style,
            text_baseline="middle", text_font=value(FONT), background_fill_color="#ffffff",
            background_fill_alpha=0.6,
        )  # fmt: skip
    return dots


def frontier_figure(chart: Chart):
    p = _figure(chart, [WheelZoomTool(modifiers="ctrl")])
    p.name = "frontier"
    p.x_range.name, p.y_range.name, p.yaxis[0].name, p.title.name = "x_range", "y_range", "y_axis", "title"
    data = as_data(chart)
    draw_floor(p, ColumnDataSource(floor_box(chart), name="floor"))
    dots = _glyphs(p, data, named=True)
    # What a row holds is looked up in the page's data: it would otherwise stand in it once for each chart.
    rows = CustomJSHover(code="return window.raytwinBench.row(value)")
    p.add_tools(
        HoverTool(renderers=[dots], tooltips='<div class="hover">@method{custom}</div>', formatters={"@method": rows})
    )
    return p


def draw_floor(p, box: ColumnDataSource) -> None:
    p.quad("left", "right", "bottom", "top", source=box, fill_color="#eef0f3", line_color=None, level="underlay")


def floor_box(chart: Chart) -> dict:
    shown = chart.floor is not None
    far = 1e6
    return {
        "left": [chart.x_range[0] / far], "right": [chart.x_range[1] * far], "bottom": [chart.y_range[0] / far],
        "top": [chart.floor if shown else chart.y_range[0] / far],
    }  # fmt: skip


def growth_figure(chart: Chart):
    p = _figure(chart, [])
    if chart.floor is not None:
        draw_floor(p, ColumnDataSource(floor_box(chart)))
    dots = _glyphs(p, as_data(chart))
    tips = [("method", "@method"), (chart.x_label, "@x{0.[00000]}"), (chart.y_label, "@y{0.000e+0}")]
    p.add_tools(HoverTool(renderers=[dots], tooltips=tips))
    return p
