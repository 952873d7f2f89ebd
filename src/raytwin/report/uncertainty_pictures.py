"""The projected uncertainty over the frame, as a picture: how far off a pixel may be, and where the tags were seen."""

import base64
import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from raytwin import files
from raytwin.calib.photos import Calibration, ProjectionDifference, uncertainty_map
from raytwin.report.charts import INK, SOFT, png_bytes
from raytwin.report.charts.chart_marks import XY, Box, Drawing, Marker, Picture, Shape, Stroke, Words
from raytwin.report.numbers import short

SIDE = 440
"""Length of the frame's longer side in the drawing, pixels; a file has twice as many."""

TOP, LEFT, BAR, TICKS = 26, 8, 14, 40
"""Pixels above the frame, beside it, of the colour bar and of its numbers."""

VIRIDIS = (
    (0x44, 0x01, 0x54), (0x48, 0x24, 0x75), (0x41, 0x44, 0x87), (0x35, 0x5F, 0x8D), (0x2A, 0x78, 0x8E),
    (0x21, 0x90, 0x8C), (0x22, 0xA8, 0x84), (0x42, 0xBE, 0x71), (0x7A, 0xD1, 0x51), (0xBB, 0xDF, 0x27),
    (0xFD, 0xE7, 0x25),
)  # fmt: skip
"""Equal steps of Smith and van der Walt's map: as light as the value is large, for every kind of colour vision."""


DOT = "#e8eef2"
RAYLESS = (0x80, 0x80, 0x80)
"""Where the lens has no inverse, so that no ray belongs to a pixel."""

EDGE = 24
"""Pixels that a number keeps from the frame, in the map that is twice as fine as the drawing."""


def write_uncertainty(calibration: Calibration, path: str | os.PathLike[str]) -> None:
    """`uncertainty_png` as a file."""
    data = uncertainty_png(calibration)
    with files.replacing(path) as temporary:
        temporary.write_bytes(data)


def uncertainty_url(calibration: Calibration) -> str:
    """The same for a page that has no files beside it."""
    return f"data:image/png;base64,{base64.b64encode(uncertainty_png(calibration)).decode('ascii')}"


def uncertainty_png(calibration: Calibration) -> bytes:
    """One standard deviation of what is seen at each pixel, `photos.uncertainty_map`, with contours: a PNG."""
    title = f"1 standard deviation of a point {calibration.basis.distance:.2g} m away, pixels; dots: tags seen"
    return _map_png(calibration, uncertainty_map(calibration), title)


def write_difference(calibration: Calibration, difference: ProjectionDifference, path: str | os.PathLike[str]) -> None:
    """The projection difference over the frame, drawn as the uncertainty is."""
    title = f"difference from the other camera at {difference.distance:.2g} m, pixels; dots: tags seen"
    data = _map_png(calibration, difference.px, title)
    with files.replacing(path) as temporary:
        temporary.write_bytes(data)


def _map_png(calibration: Calibration, found: np.ndarray, title: str) -> bytes:
    """Pixels (h, w) over the frame, NaN where no ray belongs to a pixel, with contours and the tags seen: a PNG."""
    evidence, rayless = calibration.basis, np.isnan(found)
    # Four decades are enough for the eye; a difference may be 0 somewhere.
    found = np.maximum(np.where(rayless, np.nanmax(found), found), max(float(np.nanmax(found)) * 1e-4, 1e-9))
    k = SIDE / max(calibration.image_size)
    width, height = (round(k * side) for side in calibration.image_size)
    low, high = LEFT, TOP
    levels = steps(float(found.min()), float(found.max()))
    # Logarithmic: from the middle to a corner without tags it may grow a hundredfold.
    ends = math.log(levels[0]), math.log(levels[-1])
    fine = stretched(np.log(np.maximum(found, levels[0])), 2 * width, 2 * height)
    shown = coloured(fine, *ends, np.log(levels[1:-1]))
    shown[stretched(rayless.astype(float), 2 * width, 2 * height) > 0.5] = RAYLESS
    shapes: list[Shape] = [Picture((low, high), (low + width, high + height), shown)]
    shapes += [Marker((low + k * (u + 0.5), high + k * (v + 0.5)), 0.9, (), DOT, DOT, "", "") for u, v in evidence.seen]
    shapes += [
        Words(f"{level:g}", (low + at[0] / 2, high + at[1] / 2), 9, INK, anchor="middle", halo=True)
        for level in levels[1:-1]
        if (at := crossing(fine, math.log(level)))
    ]
    x = low + width + 12
    ramp = np.repeat(np.linspace(*ends[::-1], 2 * height)[:, None], 2 * BAR, axis=1)
    shapes += [Picture((x, high), (x + BAR, high + height), coloured(ramp, *ends)),
               Box((low, high), (low + width, high + height), line=SOFT)]  # fmt: skip
    for level in levels:
        y = high + height * (1 - (math.log(level) - ends[0]) / (ends[1] - ends[0]))
        shapes += [Stroke(((x + BAR, y), (x + BAR + 3, y)), SOFT, 1), Words(short(level), (x + BAR + 6, y), 9, SOFT)]
    shapes.insert(0, Words(title, (low, 12), 10, INK))
    return png_bytes(Drawing(x + BAR + TICKS, high + height + 8, title, tuple(shapes)))


def write_bends(calibration: Calibration, path: str | os.PathLike[str]) -> None:
    """`bend_png` of the first board at `path`, of the n-th at NAME_n.png beside it."""
    path = Path(path)
    for i, _ in enumerate(calibration.basis.boards):
        data = bend_png(calibration, i)
        with files.replacing(path.with_stem(f"{path.stem}_{i + 1}") if i else path) as temporary:
            temporary.write_bytes(data)


def bend_url(calibration: Calibration, index: int) -> str:
    """`bend_png` for a page that has no files beside it."""
    return f"data:image/png;base64,{base64.b64encode(bend_png(calibration, index)).decode('ascii')}"


def bend_png(calibration: Calibration, index: int) -> bytes:
    """The heights over its plane of the index-th board, as the photos tell them, between its tags' centres: a PNG."""
    board = calibration.basis.boards[index]
    xy = np.array(list(board.centers().values()))
    (x0, y0), (x1, y1) = xy.min(axis=0), xy.max(axis=0)
    k = SIDE / 2 / max(x1 - x0, y1 - y0)
    width, height = max(round(k * (x1 - x0)), 40), max(round(k * (y1 - y0)), 40)
    x, y = np.meshgrid(np.linspace(x0, x1, 2 * width), np.linspace(y1, y0, 2 * height))
    found = 1e3 * board.rise(np.stack([x, y], axis=-1))
    low, high = float(found.min()), float(found.max())
    lines = [v for v in np.arange(math.floor(low), math.ceil(high), 0.25) if low < v < high]
    shapes: list[Shape] = [
        Words("heights of the board, mm; a line every 0.25", (LEFT, 12), 10, INK),
        Picture((LEFT, TOP), (LEFT + width, TOP + height), coloured(found, low, max(high, low + 1e-6), lines)),
        Box((LEFT, TOP), (LEFT + width, TOP + height), line=SOFT),
    ]
    shapes += [Marker((LEFT + k * (u - x0), TOP + k * (y1 - v)), 0.9, (), DOT, DOT, "", "") for u, v in xy.tolist()]
    bar = LEFT + width + 12
    ramp = np.repeat(np.linspace(high, low, 2 * height)[:, None], 2 * BAR, axis=1)
    shapes.append(Picture((bar, TOP), (bar + BAR, TOP + height), coloured(ramp, low, max(high, low + 1e-6))))
    for share in (0, 0.5, 1):
        y_of = TOP + height * (1 - share)
        shapes.append(Words(f"{low + share * (high - low):+.2f}", (bar + BAR + 6, y_of), 9, SOFT))
    return png_bytes(Drawing(bar + BAR + TICKS + 8, TOP + height + 8, "heights of the board", tuple(shapes)))


def steps(low: float, high: float) -> list[float]:
    """1, 2 and 5 times the powers of 10, from the last one at or below `low` to the first at or above `high`."""
    found = [m * 10.0**k for k in range(-7, 8) for m in (1, 2, 5)]
    first = max(0, sum(s <= low * 1.001 for s in found) - 1)
    last = max(first + 1, sum(s < high * 0.999 for s in found))
    return found[first : last + 1]


def stretched(values: np.ndarray, width: int, height: int) -> np.ndarray:
    """(height, width), bilinear between the middles of the cells."""
    from PIL import Image as Pillow

    grid = Pillow.fromarray(values.astype(np.float32))
    return np.asarray(grid.resize((width, height), Pillow.Resampling.BILINEAR))


def coloured(values: np.ndarray, low: float, high: float, lines: Sequence[float] | np.ndarray = ()) -> np.ndarray:
    """(H, W, 3) uint8: VIRIDIS from low to high, white where a neighbour is on the other side of one of `lines`."""
    share = (values - low) / (high - low)
    at = np.linspace(0, 1, len(VIRIDIS))
    pixels = np.stack([np.interp(share, at, channel) for channel in np.transpose(VIRIDIS)], axis=-1).astype(np.uint8)
    side = np.digitize(values, lines)
    across, down = side[:, 1:] != side[:, :-1], side[1:] != side[:-1]
    for part, apart in ((pixels[:, :-1], across), (pixels[:, 1:], across), (pixels[:-1], down), (pixels[1:], down)):
        part[apart] = 255
    return pixels


def crossing(values: np.ndarray, level: float) -> XY | None:
    """Where the way from the smallest value to a corner, the lower right one first, first reaches the level.

    None where that is so near an edge that a number would not fit.
    """
    h, w = values.shape
    y, x = np.unravel_index(int(values.argmin()), values.shape)
    for corner in ((w - 1, h - 1), (0, h - 1), (w - 1, 0), (0, 0)):
        way = np.linspace((x, y), corner, max(h, w)).round().astype(int)
        u, v = way[np.argmax(values[way[:, 1], way[:, 0]] >= level)].tolist()
        if values[v, u] >= level and EDGE < u < w - EDGE and EDGE < v < h - EDGE:
            return u, v
    return None
