"""The projected uncertainty over the frame, as a picture: how far off a pixel may be, and where the tags were seen."""

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

TOP, LEFT, BAR, TICKS, AXIS = 26, 8, 14, 44, 34
"""Pixels above the frame, beside it, of the colour bar, of its numbers and of an axis's numbers."""

VIRIDIS = (
    (0x44, 0x01, 0x54), (0x48, 0x24, 0x75), (0x41, 0x44, 0x87), (0x35, 0x5F, 0x8D), (0x2A, 0x78, 0x8E),
    (0x21, 0x90, 0x8C), (0x22, 0xA8, 0x84), (0x42, 0xBE, 0x71), (0x7A, 0xD1, 0x51), (0xBB, 0xDF, 0x27),
    (0xFD, 0xE7, 0x25),
)  # fmt: skip
"""Equal steps of Smith and van der Walt's map: as light as the value is large, for every kind of colour vision."""


DOT = "#e8eef2"
RAYLESS = (0x80, 0x80, 0x80)
"""Where the lens has no inverse, so that no ray belongs to a pixel."""
NO_TAG = (0xB4, 0xB8, 0xBE)
"""What colours are mixed with where no tag was seen."""

MOST_IDS = 160
"""Tags whose numbers are written into a board's picture."""

EDGE = 24
"""Pixels that a number keeps from the frame, in the map that is twice as fine as the drawing."""


def write_uncertainty(calibration: Calibration, path: str | os.PathLike[str]) -> None:
    """Write `uncertainty_drawing` as a PNG."""
    write_drawing(uncertainty_drawing(calibration), path)


def write_difference(calibration: Calibration, difference: ProjectionDifference, path: str | os.PathLike[str]) -> None:
    """Write the projection difference over the frame, drawn as the uncertainty is."""
    title = f"difference from the other camera at {difference.distance:.2g} m, pixels; dots: tags seen"
    write_drawing(map_drawing(calibration, difference.px, title), path)


def write_bends(calibration: Calibration, path: str | os.PathLike[str]) -> None:
    """Write `bend_drawing` of the first board to `path`, of the n-th to NAME_n.png beside it."""
    path = Path(path)
    for i, _ in enumerate(calibration.basis.boards):
        write_drawing(bend_drawing(calibration, i), path.with_stem(f"{path.stem}_{i + 1}") if i else path)


def write_drawing(drawing: Drawing, path: str | os.PathLike[str]) -> None:
    data = png_bytes(drawing)
    with files.replacing(path) as temporary:
        temporary.write_bytes(data)


def uncertainty_drawing(calibration: Calibration) -> Drawing:
    """Draw one standard deviation of what is seen at each pixel, `photos.uncertainty_map`, with contours."""
    title = f"1 standard deviation of a point {calibration.basis.distance:.2g} m away, pixels"
    return map_drawing(calibration, uncertainty_map(calibration), title)


def map_drawing(calibration: Calibration, found: np.ndarray, title: str) -> Drawing:
    """Draw pixels (h, w) over the frame, with contours, a colour bar and the tags seen.

    Grey where no ray belongs to a pixel (NaN); towards grey in each tenth by tenth of the frame without a tag, where
    the map rests on none.
    """
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
    bare = without_tags(calibration, 2 * width, 2 * height)
    shown[bare] = (0.4 * shown[bare] + 0.6 * np.array(NO_TAG)).astype(np.uint8)
    shown[stretched(rayless.astype(float), 2 * width, 2 * height) > 0.5] = RAYLESS
    shapes: list[Shape] = [Picture((low, high), (low + width, high + height), shown)]
    shapes += [Marker((low + k * (u + 0.5), high + k * (v + 0.5)), 0.9, (), DOT, DOT, "", "") for u, v in evidence.seen]
    shapes += [
        Words(f"{level:g}", (low + at[0] / 2, high + at[1] / 2), 11, INK, anchor="middle", halo=True)
        for level in levels[1:-1]
        if (at := crossing(fine, math.log(level)))
    ]
    marks = [(short(level), (math.log(level) - ends[0]) / (ends[1] - ends[0])) for level in levels]
    shapes += [Box((low, high), (low + width, high + height), line=SOFT), *colour_bar(low + width + 12, height, marks)]
    key_at = high + height + 16
    shapes += [
        Words(title, (low, 12), 11, INK),
        Marker((low + 5, key_at), 2, (), SOFT, SOFT, "", ""),
        Words("a tag that was seen", (low + 13, key_at), 11, SOFT),
        Box((low + 140, key_at - 5), (low + 152, key_at + 5), "#{:02x}{:02x}{:02x}".format(*NO_TAG), SOFT),
        Words("greyed: no tag was seen there", (low + 158, key_at), 11, SOFT),
    ]  # fmt: skip
    return Drawing(low + width + 12 + BAR + TICKS, key_at + 12, title, tuple(shapes))


def without_tags(calibration: Calibration, width: int, height: int) -> np.ndarray:
    """(height, width) bool: the tenths by tenths of the frame in which no tag's centre was seen."""
    u, v = np.array(calibration.basis.seen).T
    w, h = calibration.image_size
    seen, _, _ = np.histogram2d(v, u, bins=10, range=((-0.5, h - 0.5), (-0.5, w - 0.5)))
    rows, columns = np.arange(height) * 10 // height, np.arange(width) * 10 // width
    return np.asarray(seen[np.ix_(rows, columns)] == 0)


def colour_bar(x: float, height: int, marks: Sequence[tuple[str, float]]) -> list[Shape]:
    """Draw VIRIDIS upwards, `height` high, with each text at its share of it."""
    ramp = np.repeat(np.linspace(1, 0, 2 * height)[:, None], 2 * BAR, axis=1)
    shapes: list[Shape] = [Picture((x, TOP), (x + BAR, TOP + height), coloured(ramp, 0.0, 1.0))]
    for text, share in marks:
        y = TOP + height * (1 - share)
        shapes += [Stroke(((x + BAR, y), (x + BAR + 3, y)), SOFT, 1), Words(text, (x + BAR + 6, y), 11, SOFT)]
    return shapes


def bend_drawing(calibration: Calibration, index: int) -> Drawing:
    """Draw the heights over its plane of the index-th board, as the photos tell them, between its tags' centres."""
    board = calibration.basis.boards[index]
    centers = board.centers()
    xy = np.array(list(centers.values()))
    (x0, y0), (x1, y1) = xy.min(axis=0), xy.max(axis=0)
    k, left = SIDE / 2 / max(x1 - x0, y1 - y0), LEFT + AXIS
    width, height = max(round(k * (x1 - x0)), 40), max(round(k * (y1 - y0)), 40)
    x, y = np.meshgrid(np.linspace(x0, x1, 2 * width), np.linspace(y1, y0, 2 * height))
    found = 1e3 * board.rise(np.stack([x, y], axis=-1))
    low, high = float(found.min()), float(found.max())
    lines = [v for v in np.arange(math.floor(low), math.ceil(high), 0.25) if low < v < high]
    title = "heights of the board, mm; a line every 0.25"
    shapes: list[Shape] = [
        Words(title, (LEFT, 12), 11, INK),
        Picture((left, TOP), (left + width, TOP + height), coloured(found, low, max(high, low + 1e-6), lines)),
        Box((left, TOP), (left + width, TOP + height), line=SOFT),
    ]
    for at, text in board_ticks(x0, x1):
        shapes.append(Words(text, (left + k * (at - x0), TOP + height + 11), 10, SOFT, anchor="middle"))
    for at, text in board_ticks(y0, y1):
        shapes.append(Words(text, (left - 5, TOP + k * (y1 - at)), 10, SOFT, anchor="end"))
    shapes.append(Words("x and y on the board, mm", (left + width / 2, TOP + height + 25), 10, SOFT, anchor="middle"))
    many = math.ceil(math.sqrt(len(xy) / MOST_IDS))
    for n, (tag, (u, v)) in enumerate(centers.items()):
        dot, height_mm = (left + k * (u - x0), TOP + k * (y1 - v)), 1e3 * float(board.rise(np.array([u, v])))
        shapes.append(Marker(dot, 0.9, (), DOT, DOT, f"tag {tag}", f"tag {tag}: {height_mm:+.2f} mm"))
        if n % many == 0:
            shapes.append(Words(str(tag), (dot[0], dot[1] - 6), 8, INK, anchor="middle", halo=True))
    bar = left + width + 12
    shapes += colour_bar(bar, height, [(f"{low + share * (high - low):+.2f}", share) for share in (0, 0.5, 1)])
    return Drawing(bar + BAR + TICKS + 8, TOP + height + 36, title, tuple(shapes))


def board_ticks(low: float, high: float) -> list[tuple[float, str]]:
    """(metres, millimetres in words) at three to six round places from `low` to `high`."""
    span = max(high - low, 1e-6)
    step = next(m * 10.0**e for e in range(-6, 3) for m in (1, 2, 5) if span / (m * 10.0**e) < 6)
    return [
        (float(v), f"{1e3 * v:g}")
        for v in np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1) * step
    ]


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
