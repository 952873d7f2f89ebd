"""The shapes of a drawing as SVG: text stays text; a point carries its name and shows its tip on hover.

All is in pixels, y down. `drawing` puts shapes together; `Axes` turns values into pixels, and draws grid and ticks.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape

from raytwin.show.numbers import short

INK, SOFT, GRID, OUTLINE = "#1b2330", "#5a6575", "#e9edf1", "#c9ced6"
FONT = "DejaVu Sans, Verdana, system-ui, sans-serif"
DASHES = {"solid": "", "dashed": ' stroke-dasharray="6 4"'}
CORNERS = {
    "square": ((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)),
    "triangle": ((0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)),
    "diamond": ((0.0, -1.25), (1.25, 0.0), (0.0, 1.25), (-1.25, 0.0)),
}
"""Times the radius; any other marker is a circle."""

XY = tuple[float, float]
Range = tuple[float, float]


def drawing(width: float, height: float, title: str, shapes: Iterable[str]) -> str:
    """Return the whole element, which stands alone as a file and inside a page."""
    size = f'viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="{FONT}" role="img" aria-label="'
    return head + escape(title) + '">\n' + "\n".join(shapes) + "\n</svg>\n"


def box(low: XY, high: XY, fill: str = "none", line: str = "") -> str:
    return f'<rect {_place(low, high)} fill="{fill}"' + (f' stroke="{line}"/>' if line else "/>")


def stroke(points: Iterable[XY], colour: str, width: float, dash: str = "solid", role: str = "") -> str:
    pen = f'fill="none" stroke="{colour}" stroke-width="{width:g}"{DASHES[dash]}{_class(role)}'
    return f'<polyline points="{_points(points)}" {pen}/>'


def dot(at: XY, radius: float, colour: str) -> str:
    """Return a small disc without a name: it cannot be pointed at."""
    return f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius:g}" fill="{colour}"/>'


def marker(at: XY, radius: float, colour: str, name: str, tip: str, shape: str = "circle", hollow: bool = False) -> str:
    if shape in CORNERS:
        outline = f'polygon points="{_points((at[0] + radius * x, at[1] + radius * y) for x, y in CORNERS[shape])}"'
    else:
        outline = f'circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius:g}"'
    paint = f'fill="{"#ffffff" if hollow else colour}" stroke="{colour}" stroke-width="1.4"'
    tag = outline.split()[0]
    return f'<{outline} {paint} data-name="{escape(name)}"><title>{escape(tip or name)}</title></{tag}>'


def words(
    text: str, at: XY, size: float, colour: str = SOFT, *, bold: bool = False, anchor: str = "start",
    turned: bool = False, halo: bool = False, role: str = "",
) -> str:  # fmt: skip
    """Return text; `anchor`: start, middle or end, of what is at `at`; vertically its middle. `halo`: white behind the
    letters. `role`: tick, title, axis or label: a page on a phone enlarges the first and leaves the others out."""
    style = _class(role) + (' font-weight="bold"' if bold else "")
    style += f' text-anchor="{anchor}"' if anchor != "start" else ""
    style += ' stroke="#ffffff" stroke-opacity="0.6" stroke-width="3" paint-order="stroke"' if halo else ""
    style += f' transform="rotate(-90 {at[0]:.1f} {at[1]:.1f})"' if turned else ""
    place = f'x="{at[0]:.1f}" y="{at[1] + 0.36 * size:.1f}" font-size="{size:g}" fill="{colour}"'
    return f"<text {place}{style}>{escape(text)}</text>"


@dataclass(frozen=True)
class Axes:
    """A frame in pixels and the values at its left and right, and at its lower and upper edge.

    `logarithmic`: equal ratios are equally long.
    """

    left: float
    top: float
    width: float
    height: float
    x_range: Range
    y_range: Range
    logarithmic: bool = False

    @property
    def corners(self) -> tuple[XY, XY]:
        return (self.left, self.top), (self.left + self.width, self.top + self.height)

    def at(self, x: float, y: float) -> XY:
        """Return the pixel of a place."""
        along, up = self._share(x, self.x_range), self._share(y, self.y_range)
        return self.left + along * self.width, self.top + (1 - up) * self.height

    def _share(self, value: float, ends: Range) -> float:
        if self.logarithmic:
            return math.log(value / ends[0]) / math.log(ends[1] / ends[0])
        return (value - ends[0]) / (ends[1] - ends[0])

    def grid(self) -> list[str]:
        """Return round numbers along both logarithmic axes, and a line at each."""
        (left, top), (right, bottom) = self.corners
        shapes = []
        for value in log_ticks(self.x_range):
            x, _ = self.at(value, self.y_range[0])
            shapes.append(stroke(((x, top), (x, bottom)), GRID, 1))
            shapes.append(words(short(value), (x, bottom + 12), 10.5, anchor="middle", role="tick"))
        for value in log_ticks(self.y_range):
            _, y = self.at(self.x_range[0], value)
            shapes.append(stroke(((left, y), (right, y)), GRID, 1))
            shapes.append(words(short(value), (left - 6, y), 10.5, anchor="end", role="tick"))
        return shapes


def log_ticks(ends: Range) -> list[float]:
    """Return at least three: powers of ten, with 2 and 5 or more between where there are few of them; not all of many.

    At least where the ends are a factor of four apart, as those of `log_range` are.
    """
    low, high = sorted(ends)  # an axis may run downwards
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for multiples in ((1,), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        found = [m * 10.0**k for k in decades for m in multiples if low <= m * 10.0**k <= high]
        if len(found) > 2:
            break
    return found[:: max(1, math.ceil(len(found) / 9))]


def round_down(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at most `value`."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (5, 2, 1) if m * power <= value * (1 + 1e-9))


def faded(colour: str, strength: float) -> str:
    """Return the colour on white: `strength` 1 is itself."""
    return "#" + "".join(f"{round(255 + (int(colour[i : i + 2], 16) - 255) * strength):02x}" for i in (1, 3, 5))


def _class(role: str) -> str:
    return f' class="{role}"' if role else ""


def _place(low: XY, high: XY) -> str:
    return f'x="{low[0]:.1f}" y="{low[1]:.1f}" width="{high[0] - low[0]:.1f}" height="{high[1] - low[1]:.1f}"'


def _points(points: Iterable[XY]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
