"""Ways to tell a wrong render from noise that others use, each at a setting that its users choose."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Float, Float64
from raytwin.compare.blocks import SIDE
from raytwin.compare.significance import sidak
from raytwin.images.image import Image

RATE = 1e-3
"""The false-alarm rate of the tests that have one."""

Batches = Sequence[Image]
"""Renders of one side that share no sample, all of the same number."""


class Tiles(NamedTuple):
    """Means over an image's tiles (tiles, 3), the variances of these means, and their degrees of freedom."""

    mean: np.ndarray
    variance: np.ndarray
    dof: float


def tile_means(mean: Float[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "k 3"]:
    """The means of the image's whole tiles of 8 x 8 pixels; of the image where it has none."""
    h, w = (side // SIDE * SIDE for side in mean.shape[:2])
    if not (h and w):
        return np.asarray(mean.mean(axis=(0, 1), dtype=np.float64, keepdims=True)[0])
    tiles = mean[:h, :w].astype(np.float64).reshape(h // SIDE, SIDE, w // SIDE, SIDE, 3).mean(axis=(1, 3))
    return np.asarray(tiles.reshape(-1, 3))


def tile_sums(images: Batches) -> np.ndarray:
    """(n, tiles, 3): the means over the whole tiles of each image."""
    return np.stack([tile_means(image.mean) for image in images])


def tiles_of_renders(images: Batches) -> Tiles:
    """By the scatter between renders: a Welch sample is a tile's mean over one of them, so that it is near Gaussian."""
    sums = tile_sums(images)
    return Tiles(sums.mean(axis=0), sums.var(axis=0, ddof=1) / len(sums), len(sums) - 1)


def tiles_of_image(image: Image) -> Tiles:
    """By the variance that an image states, of pixels that are taken for independent."""
    if image.variance is None:
        raise ValueError("an image without variance")
    pixels = min(image.mean[..., 0].size, SIDE * SIDE)
    batches = image.batches or image.samples
    return Tiles(tile_means(image.mean), tile_means(image.variance) / pixels, pixels * max(batches - 1, 1))


def welch_p(test: Tiles, reference: Tiles) -> np.ndarray:
    """(tiles, 3) p-values that the tiles' means are equal; 1 where neither side has any noise.

    t = (m1 - m2) / sqrt(v1 + v2) with the degrees of freedom of Welch and Satterthwaite. The method of Jung, Hanika and
    Dachsbacher, Detecting Bias in Monte Carlo Renderers using Welch's t-test, Journal of Computer Graphics Techniques
    9(2), 2020, as its abstract and public descriptions have it: Welch's test of the means of many regions, and the
    histogram of their p-values, which is level where two renderers agree. The paper itself was not at hand.
    """
    from scipy.special import stdtr

    (a, va, na), (b, vb, nb) = test, reference
    v = va + vb
    noisy = v > 0
    t = np.divide(np.abs(a - b), np.sqrt(v), out=np.zeros_like(v), where=noisy)
    below = np.square(va) / na + np.square(vb) / nb
    dof = np.divide(np.square(v), below, out=np.ones_like(v), where=noisy)
    return np.where(noisy, 2 * stdtr(dof, -t), 1.0)


def sees_welch(test: Batches, reference: Batches) -> bool:
    """Whether a tile's p-value lies below RATE shared by all of them (Sidak): a limit of ours, for a verdict."""
    return beyond_rate(welch_p(tiles_of_renders(test), tiles_of_renders(reference)))


def sees_welch_of_images(test: Image, reference: Image) -> bool:
    """The same of one image of each side."""
    return beyond_rate(welch_p(tiles_of_image(test), tiles_of_image(reference)))


def beyond_rate(p: np.ndarray) -> bool:
    """Whether the least of these p-values lies below its share of RATE."""
    return bool(p.min() < sidak(RATE, p.size))


def sees_idiff(test: Image, reference: Image) -> bool:
    """OpenImageIO's `idiff -fail 0.004 -failpercent 10 -hardfail 0.1`."""
    import OpenImageIO as oiio

    pair = [oiio.ImageBuf(np.ascontiguousarray(i.mean, np.float32)) for i in (test, reference)]
    found = oiio.ImageBufAlgo.compare(pair[0], pair[1], 0.004, 0.004)
    worst = oiio.ImageBufAlgo.compare(pair[0], pair[1], 0.1, 0.1)
    return found.nfail > 0.1 * test.mean[..., 0].size or worst.nfail > 0


def sees_flip(test: Image, reference: Image) -> bool:
    """A mean LDR-FLIP above 0.05."""
    import OpenImageIO as oiio  # not METRICS' row, which refuses what is not finite

    pair = [oiio.ImageBuf(np.ascontiguousarray(np.clip(i.mean, 0, 1), np.float32)) for i in (reference, test)]
    return bool(oiio.ImageBufAlgo.FLIP_diff(*pair, hdr=0).spec().get_float_attribute("FLIP:meanerror") > 0.05)


def sees_z_test(test: Image, reference: Image) -> bool:
    """Mitsuba's own rendering test: each value's z by the reference's variance per sample, Sidak over the image at 1 %.

    99.75 % of the values must pass.
    """
    from scipy.special import ndtr

    if reference.variance is None:
        raise ValueError("a reference without variance")
    variance = reference.variance * (reference.samples / test.samples)
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.abs(test.mean - reference.mean) / np.sqrt(np.maximum(variance, 1e-12))
        p = 2 * ndtr(-z)
    alpha = 1 - (1 - 0.01) ** (1 / test.mean[..., 0].size)
    return bool(np.count_nonzero(p > alpha) < 0.9975 * p.size)


ON_BATCHES: dict[str, Callable[[Batches, Batches], bool]] = {
    "Welch": sees_welch,
}
"""Tests that take a side's renders one by one."""

ON_IMAGES: dict[str, Callable[[Image, Image], bool]] = {
    "z-test": sees_z_test,
    "idiff": sees_idiff,
    "FLIP": sees_flip,
}
"""Tests that take one image of each side. One whose library is not installed raises ImportError."""
