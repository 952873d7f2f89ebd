"""A drawing as PNG by Pillow, twice its size: for slides, where SVG is not taken."""

import math
import os
import warnings
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from raytwin import files
from raytwin.report.charts.chart import Chart
from raytwin.report.charts.chart_marks import XY, Box, Drawing, Marker, Picture, Shape, Stroke, Words, layout
from raytwin.report.charts.svg import svg_text

if TYPE_CHECKING:
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

SCALE, FINER = 2, 2
"""Pixels of the file for one of the drawing; drawn so much finer again, so that lines are smooth."""

DASHES = {"dotted": (1.5, 3.0), "dashed": (6.0, 4.0)}
"""Drawn, and left out."""


def write_charts(charts: Iterable[Chart], folder: str | os.PathLike[str]) -> None:
    """`KEY.svg` and `KEY.png` of each chart, slashes in the key made dashes; without reportlab's font SVG alone."""
    with_png = find_spec("reportlab") is not None
    if not with_png:
        warnings.warn("charts are written as SVG, without PNG: pip install 'raytwin[charts]'", stacklevel=2)
    for chart in charts:
        drawing, place = layout(chart), Path(folder) / chart.key.replace("/", "-")
        files.write_text(f"{place}.svg", svg_text(drawing))
        if with_png:
            with files.replacing(f"{place}.png") as temporary:
                temporary.write_bytes(png_bytes(drawing))


def png_bytes(drawing: Drawing) -> bytes:
    from PIL import Image as Pillow
    from PIL import ImageDraw

    k = SCALE * FINER
    canvas = Pillow.new("RGB", (drawing.width * k, drawing.height * k), "#ffffff")
    pen = ImageDraw.Draw(canvas)
    for shape in drawing.shapes:
        draw(canvas, pen, shape, k)
    return files.encoded(canvas.reduce(FINER), "png", compress_level=6, dpi=(96 * SCALE, 96 * SCALE))


def draw(canvas: "Pillow.Image", pen: "ImageDraw.ImageDraw", shape: Shape, k: int) -> None:
    match shape:
        case Box(low, high, fill, line):
            pen.rectangle((*_up(low, k), *_up(high, k)), fill or None, line or None, width=k)
        case Stroke(points, colour, width, dash, _):
            for part in dashes(points, *DASHES[dash]) if dash in DASHES else (points,):
                pen.line([_up(p, k) for p in part], colour, max(1, round(width * k)), joint="curve")
        case Marker((x, y), radius, corners, line, fill, _, _):
            if corners:
                outline = [((x + u) * k, (y + v) * k) for u, v in corners]
                pen.polygon(outline, fill or "#ffffff", line, width=round(1.4 * k))
            else:
                pen.circle((x * k, y * k), radius * k, fill or "#ffffff", line, width=round(1.4 * k))
        case Words() if shape.turned:
            _turned(canvas, shape, k)
        case Words(text, at, size, colour, bold, anchor, _, halo, _):
            letter = {"start": "l", "middle": "m", "end": "r"}[anchor]
            edge = k if halo else 0
            pen.text(
                _up(at, k), text, colour, font(bold, size * k), letter + "m", stroke_width=edge, stroke_fill="white"
            )
        case Picture(low, high, pixels):
            _picture(canvas, _up(low, k), _up(high, k), pixels)


def _turned(canvas: "Pillow.Image", words: Words, k: int) -> None:
    """Text that reads upwards, its middle at `at`."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    letters = font(words.bold, words.size * k)
    strip = Pillow.new("L", (math.ceil(letters.getlength(words.text)) + 2, round(2 * words.size * k)), 0)
    ImageDraw.Draw(strip).text((strip.width / 2, strip.height / 2), words.text, 255, letters, "mm")
    strip = strip.transpose(Pillow.Transpose.ROTATE_90)
    corner = round(words.at[0] * k - strip.width / 2), round(words.at[1] * k - strip.height / 2)
    canvas.paste(words.colour, corner, strip)


def _picture(canvas: "Pillow.Image", low: XY, high: XY, pixels: np.ndarray) -> None:
    from PIL import Image as Pillow

    size = round(high[0]) - round(low[0]), round(high[1]) - round(low[1])
    canvas.paste(Pillow.fromarray(pixels).resize(size), (round(low[0]), round(low[1])))


def _up(p: XY, k: int) -> XY:
    return p[0] * k, p[1] * k


def dashes(points: tuple[XY, ...], drawn: float, left_out: float) -> Iterator[tuple[XY, XY]]:
    """Each straight part of the line in pieces of `drawn`, `left_out` apart."""
    for (x0, y0), (x1, y1) in pairwise(points):
        length = math.hypot(x1 - x0, y1 - y0)
        for start in np.arange(0, length, drawn + left_out):
            a, b = start / length, min(start + drawn, length) / length
            yield (x0 + a * (x1 - x0), y0 + a * (y1 - y0)), (x0 + b * (x1 - x0), y0 + b * (y1 - y0))


@cache
def font(bold: bool, size: float) -> "ImageFont.FreeTypeFont":
    """Bitstream Vera Sans, which reportlab brings: the labels' widths are those of its kin DejaVu Sans."""
    import reportlab
    from PIL import ImageFont

    name = "VeraBd.ttf" if bold else "Vera.ttf"
    return ImageFont.truetype(Path(reportlab.__file__).parent / "fonts" / name, size)
