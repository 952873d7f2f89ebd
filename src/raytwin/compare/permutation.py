"""The test that assumes least: flip the signs of the differences between two sides' renders, and take the largest.

Exact where the differences are symmetric, as those of equally sampled renders are, whatever the noise, however wide
the filter is, and however tiles hang together: no variance, no degrees of freedom, no correction for many tests
(Winkler et al., Permutation inference for the general linear model, NeuroImage 92, 2014). Its price: n renders of each
side show no less than 2^(1 - n), and a variance from n of them is less than one that all pixels of a tile tell.
"""

import numpy as np

from raytwin.array_types import Float, Float64
from raytwin.compare.blocks import SIDE

FLIPS = 4096
"""Random signs that the differences are given."""

FEWEST = 11
"""Pairs of renders that can show one in a thousand."""


def tile_means(mean: Float[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "k 3"]:
    """The means of the image's whole tiles of 8 x 8 pixels; of the image where it has none."""
    h, w = (side // SIDE * SIDE for side in mean.shape[:2])
    if not (h and w):
        return np.asarray(mean.mean(axis=(0, 1), dtype=np.float64, keepdims=True)[0])
    tiles = mean[:h, :w].astype(np.float64).reshape(h // SIDE, SIDE, w // SIDE, SIDE, 3).mean(axis=(1, 3))
    return np.asarray(tiles.reshape(-1, 3))


def sign_flip_p(differences: Float[np.ndarray, "n k 3"], seed: int = 0) -> float:
    """The probability of a largest |t| like that of these differences, over all tiles and their mean, by chance alone.

    Each of the n differences of two sides' renders, (tiles, 3), counts as it is: those of more samples may be larger.
    """
    d = np.asarray(differences, np.float64)
    d = np.concatenate([d, d.mean(axis=1, keepdims=True)], axis=1).reshape(len(d), -1)
    square = np.square(d).sum(axis=0)
    d, square = d[:, square > 0], square[square > 0]
    if len(d) < 2 or not d.size:
        return 1.0
    n = len(d)
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), (FLIPS, n))
    signs[0] = 1.0
    mean2 = np.square(signs @ d / n)
    t2 = mean2 / np.maximum((square / n - mean2) / (n - 1), 1e-300)  # flips leave the sum of squares as it is
    largest = t2.max(axis=1)
    return float((largest >= largest[0] * (1 - 1e-9)).mean())
