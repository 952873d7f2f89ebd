"""The projected uncertainty over the frame, as a picture: how far off a pixel may be, and where the tags were seen."""

import math
import os
from collections.abc import Sequence

import numpy as np

from raytwin import files
from raytwin.calib.photos import Calibration, uncertainty_map
from raytwin.report.charts.svg import INK, SOFT, Axes, box, dot, drawing, log_ticks, marker, picture, stroke, words
from raytwin.report.numbers import short

SIDE = 440
"""Length of the frame's longer side in the drawing, pixels; a picture in it has twice as many."""

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


def write_uncertainty(calibration: Calibration, path: str | os.PathLike[str]) -> None:
    """Write `uncertainty_drawing` as SVG."""
    files.write_text(path, uncertainty_drawing(calibration))


def write_bend(calibration: Calibration, path: str | os.PathLike[str]) -> None:
    """Write `bend_drawing` as SVG."""
    files.write_text(path, bend_drawing(calibration))


def frame_axes(calibration: Calibration) -> Axes:
    """Return the axes of the camera's frame: pixels, the first one's centre at 0."""
    width, height = calibration.image_size
    k = SIDE / max(width, height)
    return Axes(LEFT, TOP, round(k * width), round(k * height), (-0.5, width - 0.5), (height - 0.5, -0.5))


def uncertainty_drawing(calibration: Calibration) -> str:
    """Draw one standard deviation of what is seen at each pixel, with contours, a colour bar and the tags seen.

    Grey where no ray belongs to a pixel (NaN); towards grey in each tenth by tenth of the frame without a tag, where
    the map rests on none.
    """
    found = uncertainty_map(calibration)
    title = f"1 standard deviation of a point {calibration.basis.distance:.2g} m away, pixels"
    axes, has_no_ray = frame_axes(calibration), np.isnan(found)
    (left, _), (right, bottom) = axes.corners
    found = np.where(has_no_ray, np.nanmax(found), found)
    low, high = float(found.min()), max(float(found.max()), 4.1 * float(found.min()))
    size = 2 * round(axes.width), 2 * round(axes.height)
    # Logarithmic: from the middle to a corner without tags it may grow a hundredfold.
    fine, levels = stretched(np.log(found), *size), log_ticks((low, high))
    shown = coloured(fine, math.log(low), math.log(high), np.log(levels))
    bare = without_tags(calibration, *size)
    shown[bare] = (0.4 * shown[bare] + 0.6 * np.array(NO_TAG)).astype(np.uint8)
    shown[stretched(has_no_ray.astype(float), *size) > 0.5] = RAYLESS
    marks = [(short(level), math.log(level / low) / math.log(high / low)) for level in levels]
    key_at = bottom + 16
    shapes = [
        picture(*axes.corners, shown),
        *(dot(axes.at(u, v), 1.5, DOT) for u, v in calibration.basis.seen),
        box(*axes.corners, line=SOFT),
        *colour_bar(right + 12, axes.height, marks),
        words(title, (left, 12), 11, INK),
        dot((left + 5, key_at), 2, SOFT),
        words("a tag that was seen", (left + 13, key_at), 11),
        box((left + 140, key_at - 5), (left + 152, key_at + 5), "#{:02x}{:02x}{:02x}".format(*NO_TAG), SOFT),
        words("greyed: no tag was seen there", (left + 158, key_at), 11),
    ]
    return drawing(right + 12 + BAR + TICKS, key_at + 12, title, shapes)


def without_tags(calibration: Calibration, width: int, height: int) -> np.ndarray:
    """Return (height, width) bool: the tenths by tenths of the frame in which no tag's centre was seen."""
    u, v = np.array(calibration.basis.seen).T
    w, h = calibration.image_size
    seen, _, _ = np.histogram2d(v, u, bins=10, range=((-0.5, h - 0.5), (-0.5, w - 0.5)))
    rows, columns = np.arange(height) * 10 // height, np.arange(width) * 10 // width
    return np.asarray(seen[np.ix_(rows, columns)] == 0)


def colour_bar(x: float, height: float, marks: Sequence[tuple[str, float]]) -> list[str]:
    """Draw VIRIDIS upwards, `height` high, with each text at its share of it."""
    ramp = np.repeat(np.linspace(1, 0, 2 * round(height))[:, None], 2 * BAR, axis=1)
    shapes = [picture((x, TOP), (x + BAR, TOP + height), coloured(ramp, 0.0, 1.0))]
    for text, share in marks:
        y = TOP + height * (1 - share)
        shapes += [stroke(((x + BAR, y), (x + BAR + 3, y)), SOFT, 1), words(text, (x + BAR + 6, y), 11)]
    return shapes


def bend_drawing(calibration: Calibration) -> str:
    """Draw the board's heights over its plane, as the photos tell them, between its tags' centres."""
    board = calibration.basis.board
    centers = board.centers()
    xy = np.array(list(centers.values()))
    (x0, y0), (x1, y1) = xy.min(axis=0), xy.max(axis=0)
    k = SIDE / 2 / max(x1 - x0, y1 - y0)
    width, height = max(round(k * (x1 - x0)), 40), max(round(k * (y1 - y0)), 40)
    axes = Axes(LEFT + AXIS, TOP, width, height, (1e3 * x0, 1e3 * x1 + 1e-9), (1e3 * y0, 1e3 * y1 + 1e-9))
    (left, _), (right, bottom) = axes.corners
    x, y = np.meshgrid(np.linspace(x0, x1, 2 * width), np.linspace(y1, y0, 2 * height))
    found = 1e3 * board.rise(np.stack([x, y], axis=-1))
    low, high = float(found.min()), float(found.max())
    lines = [v for v in np.arange(math.floor(low), math.ceil(high), 0.25) if low < v < high]
    title = "heights of the board, mm; a line every 0.25"
    shapes = [
        words(title, (LEFT, 12), 11, INK),
        *axes.grid(10, lines=False),
        picture(*axes.corners, coloured(found, low, max(high, low + 1e-6), lines)),
        box(*axes.corners, line=SOFT),
        words("x and y on the board, mm", (left + width / 2, bottom + 25), 10, anchor="middle"),
    ]
    many = math.ceil(math.sqrt(len(xy) / MOST_IDS))
    for n, (tag, (u, v)) in enumerate(centers.items()):
        at, rise = axes.at(1e3 * u, 1e3 * v), 1e3 * float(board.rise(np.array([u, v])))
        shapes.append(marker(at, 0.9, DOT, f"tag {tag}", f"tag {tag}: {rise:+.2f} mm"))
        if n % many == 0:
            shapes.append(words(str(tag), (at[0], at[1] - 6), 8, INK, anchor="middle", halo=True))
    shapes += colour_bar(right + 12, height, [(f"{low + share * (high - low):+.2f}", share) for share in (0, 0.5, 1)])
    return drawing(right + 12 + BAR + TICKS + 8, bottom + 36, title, shapes)


def stretched(values: np.ndarray, width: int, height: int) -> np.ndarray:
    """Return (height, width), bilinear between the middles of the cells."""
    from PIL import Image as Pillow

    grid = Pillow.fromarray(values.astype(np.float32))
    return np.asarray(grid.resize((width, height), Pillow.Resampling.BILINEAR))


def coloured(values: np.ndarray, low: float, high: float, lines: Sequence[float] | np.ndarray = ()) -> np.ndarray:
    """Return (H, W, 3) uint8: VIRIDIS from low to high, white where one of `lines` passes between neighbours."""
    share = (values - low) / (high - low)
    at = np.linspace(0, 1, len(VIRIDIS))
    pixels = np.stack([np.interp(share, at, channel) for channel in np.transpose(VIRIDIS)], axis=-1).astype(np.uint8)
    side = np.digitize(values, lines)
    across, down = side[:, 1:] != side[:, :-1], side[1:] != side[:-1]
    for part, apart in ((pixels[:, :-1], across), (pixels[:, 1:], across), (pixels[:-1], down), (pixels[1:], down)):
        part[apart] = 255
    return pixels
