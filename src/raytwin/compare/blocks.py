"""An image's sums over 8 x 8 blocks, from which larger tiles are merged."""

import numpy as np

from raytwin.array_types import Float, Float64

Pixels = Float[np.ndarray, "h w 3"]
"""Values of an image."""

Blocks = Float[np.ndarray, "by bx 3"]
"""A value each for its blocks of 8 x 8 pixels."""

Means = Float[np.ndarray, "*n 3"]
"""A value each for any tiles."""

SIDE = 8
"""Pixels on the side of the smallest tile: small enough to be local, large enough for its mean to be near Gaussian."""


def block_sums(x: Float[np.ndarray, "h w c"]) -> Float64[np.ndarray, "by bx c"]:
    """Sums over blocks of 8 x 8 pixels, of which the last of a row or column may be cut."""
    whole = len(x) - len(x) % SIDE
    rows = x[:whole].reshape(-1, SIDE, *x.shape[1:]).sum(axis=1)  # six times as fast as reduceat
    if whole < len(x):
        rows = np.concatenate([rows, x[whole:].sum(axis=0, keepdims=True)])
    return np.add.reduceat(rows, np.arange(0, x.shape[1], SIDE), axis=1).astype(np.float64)


def block_counts(shape: tuple[int, ...]) -> Float64[np.ndarray, "by bx 1"]:
    """The pixels of each block of an image (H, W, ...)."""
    down, across = (np.minimum(SIDE, n - np.arange(0, n, SIDE)) for n in shape[:2])
    return np.multiply.outer(down, across)[..., None].astype(np.float64)


def to_pixels(blocks: Float[np.ndarray, "by bx c"], height: int, width: int) -> Float[np.ndarray, "{height} {width} c"]:
    """A number per block (by, bx, c) for each of its pixels: (height, width, c)."""
    return np.asarray(np.repeat(np.repeat(blocks, SIDE, axis=1)[:, :width], SIDE, axis=0)[:height])


def slide(x: Float64[np.ndarray, "*n by bx c"]) -> Float64[np.ndarray, "*n ty tx c"]:
    """Sums over 2 x 2 neighbours at every place: tiles of twice the side, overlapping by half of it."""
    x = x[..., :-1, :, :] + x[..., 1:, :, :] if x.shape[-3] > 1 else x
    return x[..., :-1, :] + x[..., 1:, :] if x.shape[-2] > 1 else x
