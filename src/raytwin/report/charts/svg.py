"""A drawing as SVG: text stays text; a point carries its name and tells its tip on hover."""

from collections.abc import Iterable
from html import escape

from raytwin.report.charts.chart import Chart
from raytwin.report.charts.chart_marks import Box, Drawing, Marker, Picture, Shape, Stroke, Words, layout
from raytwin.report.data_urls import png_url

FONT = "DejaVu Sans, Verdana, system-ui, sans-serif"
DASHES = {"solid": "", "dotted": ' stroke-dasharray="1.5 3"', "dashed": ' stroke-dasharray="6 4"'}


def svg_text(drawing: Drawing) -> str:
    """The whole element, which stands alone as a file and inside a page."""
    size = f'viewBox="0 0 {drawing.width} {drawing.height}" width="{drawing.width}" height="{drawing.height}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="{FONT}" role="img" aria-label="'
    return head + escape(drawing.title) + '">\n' + "\n".join(map(element, drawing.shapes)) + "\n</svg>\n"


def chart_html(chart: Chart) -> str:
    """Return a chart for a page: its numbers by pointer, touch and arrow keys; what a phone leaves out, as text."""
    words = f"{chart.title}. Up: {chart.y_label}; to the right: {chart.x_label}. {'; '.join(chart.notes)}"
    about = escape(f"{chart.title}: left and right arrows step through its points")
    svg = svg_text(layout(chart))
    return (
        f'<div class="view" tabindex="0" role="group" aria-label="{about}">{svg}</div>'
        f'<p class="chart-words">{escape(words)} Tap a point for its numbers.</p>'
    )


def _class(role: str) -> str:
    return f' class="{role}"' if role else ""


def element(shape: Shape) -> str:
    match shape:
        case Box(low, high, fill, line):
            return f'<rect {_box(low, high)} fill="{fill or "none"}"' + (f' stroke="{line}"/>' if line else "/>")
        case Stroke(points, colour, width, dash, role):
            pen = f'fill="none" stroke="{colour}" stroke-width="{width:g}"{DASHES[dash]}{_class(role)}'
            return f'<polyline points="{_points(points)}" {pen}/>'
        case Marker(at, radius, corners, line, fill, name, tip):
            if corners:
                outline = f'polygon points="{_points([(at[0] + x, at[1] + y) for x, y in corners])}"'
            else:
                outline = f'circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius:g}"'
            tag = outline.split()[0]
            paint = f'fill="{fill or "#ffffff"}" stroke="{line}" stroke-width="1.4"'
            return f'<{outline} {paint} data-name="{escape(name)}"><title>{escape(tip or name)}</title></{tag}>'
        case Words(text, at, size, colour, bold, anchor, turned, halo, role):
            style = _class(role) + (' font-weight="bold"' if bold else "")
            style += f' text-anchor="{anchor}"' if anchor != "start" else ""
            style += ' stroke="#ffffff" stroke-opacity="0.6" stroke-width="3" paint-order="stroke"' if halo else ""
            style += f' transform="rotate(-90 {at[0]:.1f} {at[1]:.1f})"' if turned else ""
            place = f'x="{at[0]:.1f}" y="{at[1] + 0.36 * size:.1f}" font-size="{size:g}" fill="{colour}"'
            return f"<text {place}{style}>{escape(text)}</text>"
        case Picture(low, high, pixels):
            return f'<image {_box(low, high)} preserveAspectRatio="none" href="{png_url(pixels)}"/>'


def _box(low: tuple[float, float], high: tuple[float, float]) -> str:
    return f'x="{low[0]:.1f}" y="{low[1]:.1f}" width="{high[0] - low[0]:.1f}" height="{high[1] - low[1]:.1f}"'


def _points(points: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
