"""What a calibration rests on, drawn over the frame: how far off each pixel may be, and each tag's residual."""

import math
from collections.abc import Sequence

import numpy as np

from raytwin.photos.camera import Calibration, uncertainty_map
from raytwin.show.charts.svg import (
    INK,
    SOFT,
    Axes,
    box,
    dot,
    drawing,
    log_ticks,
    marker,
    picture,
    round_down,
    stroke,
    words,
)
from raytwin.show.numbers import short

SIDE = 440
"""Length of the frame's longer side in the drawing, pixels; a picture in it has twice as many."""

TOP, LEFT, BAR, TICKS = 26, 8, 14, 44
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
NO_TAG = (0xB4, 0xB8, 0xBE)
"""What colours are mixed with where no tag was seen."""

MOST_VECTORS = 1500
"""Residuals drawn at most: evenly chosen of more."""
LONGEST_SHARE = 0.06
"""Length of the 95 % quantile of the residuals, as a share of the frame's longer side."""
CELLS_ACROSS, FEWEST_TAGS = 8, 4
"""Cells across the longer side in which residuals are averaged, and tags that a cell needs."""
MEAN = "#c02f4a"
"""Colour of a cell's mean."""


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


def residual_drawing(calibration: Calibration) -> str:
    """Draw where each tag was seen and, as a line from there, where the camera puts it, enlarged.

    Thick: the means of cells. They point nowhere in common where the lens model fits.
    """
    axes, evidence = frame_axes(calibration), calibration.basis
    (left, _), (right, bottom) = axes.corners
    seen, off = np.array(evidence.seen), np.array(evidence.residuals)
    longest = max(calibration.image_size)
    size = float(np.quantile(np.linalg.norm(off, axis=1), 0.95)) or 1.0
    by = round_down(LONGEST_SHARE * longest / size)
    some = np.arange(0, len(seen), math.ceil(len(seen) / MOST_VECTORS))
    shapes = [box(*axes.corners, "#f6f7f9", SOFT)]
    for at, moved in zip(seen[some], (seen + by * off)[some], strict=True):
        shapes += [stroke((axes.at(*at), axes.at(*moved)), "#5a6575", 0.9), dot(axes.at(*at), 1.3, INK)]
    for cell, mean, count in cell_means(seen, off, longest):
        tip = f"mean of {count} tags: {math.hypot(*mean):.2g} px"
        shapes += [
            stroke((axes.at(*cell), axes.at(*(cell + by * mean))), MEAN, 2.2),
            marker(axes.at(*cell), 1.8, MEAN, tip, tip),
        ]
    title = f"residuals, drawn {by:g} times as long"
    bar, y = by * round_down(size) * axes.width / calibration.image_size[0], bottom + 16
    shapes += [
        words(title, (left, 12), 11, INK),
        stroke(((left, y), (left + bar, y)), INK, 2),
        words(f"{short(round_down(size))} px", (left + bar + 6, y), 11),
        stroke(((left + 150, y), (left + 170, y)), MEAN, 2.2),
        words(f"mean of a cell of {FEWEST_TAGS} tags or more", (left + 176, y), 11),
    ]
    if len(some) < len(seen):
        shapes.append(words(f"{len(some)} of {len(seen)} tags", (right, 12), 11, anchor="end"))
    return drawing(right + LEFT, y + 12, title, shapes)


def cell_means(seen: np.ndarray, off: np.ndarray, longest: int) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Return (middle of its tags, mean residual, tags) of each square cell that has FEWEST_TAGS tags."""
    cells = np.floor((seen + 0.5) * CELLS_ACROSS / longest).astype(int)
    keys, which, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    return [
        (seen[which == i].mean(axis=0), off[which == i].mean(axis=0), int(count))
        for i, count in enumerate(counts[: len(keys)])
        if count >= FEWEST_TAGS
    ]
