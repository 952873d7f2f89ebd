"""Pictures as Bokeh figures that pan and zoom together, each its own element, so that the page lays them out.

Pixel (x, y) covers x - 1/2 .. x + 1/2: a picture of width W spans -1/2 .. W - 1/2, y down.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from bokeh.embed import components
from bokeh.models import (
    BoxZoomTool,
    ColumnDataSource,
    CustomJS,
    GridPlot,
    PanTool,
    Range1d,
    ResetTool,
    Span,
    Toolbar,
    ToolProxy,
    WheelZoomTool,
)
from bokeh.plotting import figure
from bokeh.resources import Resources

SHOWN_WIDTH = 640
"""CSS pixels a figure is laid out for; the page stretches it."""


@dataclass(frozen=True)
class Picture:
    """One panel: `url` is a data URL, `alt` says what it shows to who cannot see it, `rings` are pixels to circle."""

    key: str
    title: str
    alt: str
    note: str
    url: str
    rings: tuple[tuple[int, int], ...] = ()
    ring_colour: str = "#111827"


def script_of_bokeh() -> str:
    """Bokeh's own script element, inlined: the page loads nothing."""
    return Resources(mode="inline", components=["bokeh"]).render_js()


def embed(pictures: Sequence[Picture], width: int, height: int) -> tuple[str, list[str], str]:
    """(script element, an element for each picture, the element of the toolbar that they share)."""
    whole = {"min_interval": 4, "name": "columns", "max_interval": 2 * width}
    columns = Range1d(-0.5, width - 0.5, **whole)
    lines = Range1d(height - 0.5, -0.5, **whole | {"name": "lines", "max_interval": 2 * height})
    # The inspected pixel, shared by all: report.js moves it.
    cross = [Span(dimension=d, name=f"cross_{d}", line_color="#111827", line_alpha=0.55, line_width=1, location=None)
             for d in ("width", "height")]  # fmt: skip
    figures, tools = [], []
    for picture in pictures:
        own = [
            PanTool(),
            BoxZoomTool(match_aspect=True),
            # Without a key the wheel scrolls the page: pictures as wide as the window would otherwise trap it.
            WheelZoomTool(modifiers="ctrl"),
            ResetTool(),
        ]
        p = figure(
            x_range=columns, y_range=lines, width=SHOWN_WIDTH, height=round(SHOWN_WIDTH * height / width),
            sizing_mode="scale_width", tools=own, toolbar_location=None, min_border=0, outline_line_color=None,
            background_fill_color="#eef0f3", border_fill_color=None, name=picture.key,
        )  # fmt: skip
        p.axis.visible = False
        p.grid.visible = False
        p.toolbar.active_scroll = own[2]
        p.image_url(url=[picture.url], x=-0.5, y=-0.5, w=width, h=height, anchor="top_left")
        if picture.rings:
            x, y = zip(*picture.rings, strict=True)
            p.scatter(
                "x", "y", source=ColumnDataSource({"x": x, "y": y}), marker="circle", size=16, fill_color=None,
                line_color=picture.ring_colour, line_width=1.5, line_alpha=0.9,
            )  # fmt: skip
        for span in cross:
            p.add_layout(span)
        for event, method in (("mousemove", "hover"), ("mouseleave", "leave"), ("tap", "pin")):
            p.js_on_event(event, CustomJS(code=f"window.raytwin.{method}(cb_obj.x, cb_obj.y)"))
        figures.append(p)
        tools.append(own)
    shared = [ToolProxy(tools=list(group)) for group in zip(*tools, strict=True)]
    toolbar = Toolbar(tools=shared, logo=None, active_drag=shared[0], active_scroll=shared[2])
    # A grid without plots, because only a grid lays its toolbar out in a row.
    bar = GridPlot(children=[], toolbar=toolbar, toolbar_location="above", width=148, height=30)
    script, elements = components((*figures, bar))
    return script, list(elements[:-1]), elements[-1]
