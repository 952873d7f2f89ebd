"""Charts as data: a Chart (points, lines, labels placed) -> shapes in pixels -> SVG for pages, PNG for slides.

chart.py what a chart holds; labels.py where its texts go; shapes.py frame, ticks and layout; svg.py, png.py draw them.
"""

from raytwin.report.charts.chart import (
    FRAME,
    INK,
    SOFT,
    Asked,
    Chart,
    Line,
    Point,
    Text,
    by_family,
    family_chart,
    joined,
    labelled,
    log_range,
)
from raytwin.report.charts.chart_marks import layout
from raytwin.report.charts.png import png_bytes, write_charts
from raytwin.report.charts.svg import chart_html, svg_text
