"""An image in strips that stay in the cache, and its sums over 8 x 8 blocks, from which larger tiles are merged."""

from collections.abc import Iterator

import numpy as np

from raytwin.array_types import Float, Float64

Pixels = Float[np.ndarray, "h w 3"]
"""Values of an image, or of a strip of it."""

Blocks = Float[np.ndarray, "by bx 3"]
"""A value each for its blocks of 8 x 8 pixels."""

Means = Float[np.ndarray, "*n 3"]
"""A value each for any tiles."""

SIDE = 8
"""Pixels on the side of the smallest tile: small enough to be local, large enough for its mean to be near Gaussian."""

CACHED = 64_000
"""Pixels of a strip: 768 kB an array of three floats."""


def strips(shape: tuple[int, ...], rows: int = 8 * SIDE) -> Iterator[tuple[int, int, int]]:
    """(first row, end row, rows per block) of an image (H, W, ...): strips are whole blocks high, at most `rows`.

    Wide images have lower ones, so that a few arrays fit the cache; the last may hold one lower row of blocks.
    """
    height, width = shape[:2]
    rows = min(rows, max(CACHED // width // SIDE, 1) * SIDE)
    whole = height - height % SIDE
    for y in range(0, whole, rows):
        yield y, min(y + rows, whole), SIDE
    if whole < height:
        yield whole, height, height - whole


def block_sums(x: Float[np.ndarray, "h w c"], rows: int) -> Float64[np.ndarray, "by bx c"]:
    """Sums over blocks of `rows` x 8 pixels: (h, w, c) -> (h / rows, ceil(w / 8), c) float64."""
    columns = x.reshape(-1, rows, *x.shape[1:]).sum(axis=1)
    return np.add.reduceat(columns, np.arange(0, x.shape[1], SIDE), axis=1).astype(np.float64)


def block_counts(strip: Float[np.ndarray, "h w c"], rows: int) -> Float64[np.ndarray, "by bx 1"]:
    """(h / rows, ceil(w / 8), 1): the pixels of each block."""
    high, width = len(strip) // rows, strip.shape[1]
    counts = np.full((high, -(-width // SIDE), 1), float(rows * SIDE))
    counts[:, width // SIDE :] = rows * (width % SIDE)
    return counts


def to_pixels(blocks: Float[np.ndarray, "by bx c"], height: int, width: int) -> Float[np.ndarray, "{height} {width} c"]:
    """A number per block (by, bx, c) for each of its pixels: (height, width, c)."""
    return np.asarray(np.repeat(np.repeat(blocks, SIDE, axis=0)[:height], SIDE, axis=1)[:, :width])


def slide(x: Float64[np.ndarray, "*n by bx c"]) -> Float64[np.ndarray, "*n ty tx c"]:
    """Sums over 2 x 2 neighbours at every place: tiles of twice the side, overlapping by half of it."""
    x = x[..., :-1, :, :] + x[..., 1:, :, :] if x.shape[-3] > 1 else x
    return x[..., :-1, :] + x[..., 1:, :] if x.shape[-2] > 1 else x
