"""Ways to tell a wrong render from noise that others use, each at a setting that its users choose."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from raytwin.image import Image

TILE = 8
"""Pixels on the side of a tile whose sum is a Welch sample, and that the sign flips go over."""

RATE = 1e-3
"""The false-alarm rate of the tests that have one."""

FLIPS = 4096
"""Random signs that the batches' differences are given."""

Batches = Sequence[Image]
"""Renders of one side that share no sample, all of the same number."""


def tile_sums(images: Batches) -> np.ndarray:
    """(n, tiles, 3): the means over the whole tiles of each image."""
    h, w = (side // TILE * TILE for side in images[0].shape[:2])
    stack = np.stack([image.mean[:h, :w] for image in images]).astype(np.float64)
    return stack.reshape(len(images), h // TILE, TILE, w // TILE, TILE, 3).mean(axis=(2, 4)).reshape(len(images), -1, 3)


def welch_p(test: Batches, reference: Batches) -> np.ndarray:
    """(tiles, 3) p-values that the tiles' means are equal; 1 where neither side has any noise.

    A Welch sample is a tile's sum over one render, so that it is near Gaussian; t = (m1 - m2) / sqrt(s1²/n1 + s2²/n2)
    with the degrees of freedom of Welch and Satterthwaite. After Jung, Hanika and Dachsbacher, Detecting Bias in Monte
    Carlo Renderers using Welch's t-test, Journal of Computer Graphics Techniques 9(2), 2020, sections 3 and 4.
    """
    from scipy.special import stdtr

    a, b = tile_sums(test), tile_sums(reference)
    va, vb = a.var(axis=0, ddof=1) / len(a), b.var(axis=0, ddof=1) / len(b)
    v = va + vb
    noisy = v > 0
    t = np.divide(np.abs(a.mean(axis=0) - b.mean(axis=0)), np.sqrt(v), out=np.zeros_like(v), where=noisy)
    below = np.square(va) / (len(a) - 1) + np.square(vb) / (len(b) - 1)
    dof = np.divide(np.square(v), below, out=np.ones_like(v), where=noisy)
    return np.where(noisy, 2 * stdtr(dof, -t), 1.0)


def sees_welch(test: Batches, reference: Batches) -> bool:
    """Whether a tile's p-value lies below RATE shared by all of them (Sidak); the paper leaves that to the eye."""
    p = welch_p(test, reference)
    return bool(p.min() < -math.expm1(math.log1p(-RATE) / p.size))


def sign_flip_p(test: Batches, reference: Batches, seed: int = 0) -> float:
    """The probability of a maximum as large as that of all tiles and the whole image, if every sign were chance.

    The batches' differences are flipped at random, FLIPS times, and the largest |mean| / standard error is taken each
    time: exact for differences that are symmetric, however wide the filter is and however tiles hang together (Winkler
    et al., Permutation inference for the general linear model, NeuroImage 92, 2014). n batches show no less than
    2^(1 - n).
    """
    d = tile_sums(test) - tile_sums(reference)
    d = np.concatenate([d, d.mean(axis=1, keepdims=True)], axis=1).reshape(len(d), -1)
    square = np.square(d).sum(axis=0)
    d, square = d[:, square > 0], square[square > 0]
    if not d.size:
        return 1.0
    n = len(d)
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), (FLIPS, n))
    signs[0] = 1.0
    means2 = np.square(signs @ d / n)
    # t² of the flipped sums: the sum of squares stays.
    t2 = means2 / np.maximum((square / n - means2) / (n - 1), 1e-300)
    largest = t2.max(axis=1)
    return float((largest >= largest[0] * (1 - 1e-9)).mean())


def sees_by_sign_flips(test: Batches, reference: Batches) -> bool:
    return sign_flip_p(test, reference) < RATE


def sees_idiff(test: Image, reference: Image) -> bool:
    """OpenImageIO's `idiff -fail 0.004 -failpercent 10 -hardfail 0.1`."""
    import OpenImageIO as oiio

    pair = [oiio.ImageBuf(np.ascontiguousarray(i.mean, np.float32)) for i in (test, reference)]
    found = oiio.ImageBufAlgo.compare(pair[0], pair[1], 0.004, 0.004)
    worst = oiio.ImageBufAlgo.compare(pair[0], pair[1], 0.1, 0.1)
    return found.nfail > 0.1 * test.mean[..., 0].size or worst.nfail > 0


def sees_flip(test: Image, reference: Image) -> bool:
    """A mean LDR-FLIP above 0.05."""
    import flip_evaluator  # not METRICS' row, which refuses what is not finite

    pair = [np.ascontiguousarray(np.clip(i.mean, 0, 1)) for i in (reference, test)]
    return bool(flip_evaluator.evaluate(*pair, "LDR", inputsRGB=False, applyMagma=False, parameters={})[1] > 0.05)


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
    "sign flips": sees_by_sign_flips,
}
"""Tests that take a side's renders one by one."""

ON_IMAGES: dict[str, Callable[[Image, Image], bool]] = {
    "z-test": sees_z_test,
    "idiff": sees_idiff,
    "FLIP": sees_flip,
}
"""Tests that take one image of each side. One whose library is not installed raises ImportError."""
