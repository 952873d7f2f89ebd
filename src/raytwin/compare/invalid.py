"""What no image may be: not an array of radiance, NaN, infinite, negative, black. Counted and located."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from raytwin.compare.blocks import Pixels, to_pixels
from raytwin.compare.finding import Finding, Place, at, plural
from raytwin.compare.noise import FIREFLY, block_means, degrees_of_freedom, estimated, residual
from raytwin.compare.significance import quantile
from raytwin.images.image import Image

NOISE_BELOW, CHANCE = 8.0, 1e-6
"""Standard deviations below 0 that noise may take a value, which the statistics judge further; of a variance that few
batches tell, as many more as Student's t has at this probability."""

LOBES = (
    "; nothing tells whether noise explains them (a filter with negative lobes, control variates): give a variance or "
    "several renders"
)


def shape_findings(test: Image, reference: Image) -> list[Finding]:
    """Whatever makes the two arrays impossible to compare: kind, dtype, shape."""
    findings = []
    for name, image in (("test", test), ("reference", reference)):
        parts = {"image": image.mean, "variance": image.variance}
        for what, array in parts.items():
            if what == "variance" and array is None:
                continue
            whose = f"the {name} {what}" if what == "image" else f"the {name}'s {what}"
            if not isinstance(array, np.ndarray):
                findings.append(Finding("shape", f"{whose} is no array but {type(array).__name__}"))
            elif not np.issubdtype(array.dtype, np.floating):
                findings.append(Finding("shape", f"{whose} holds {array.dtype}, not floating-point radiance"))
            elif array.ndim != 3 or array.shape[-1] != 3 or 0 in array.shape:
                findings.append(Finding("shape", f"{whose} has the shape {array.shape}, not (height, width, 3)"))
            elif what == "variance" and array.shape != np.shape(image.mean):
                own = np.shape(image.mean)
                findings.append(Finding("shape", f"{whose} has the shape {array.shape}, its mean {own}"))
        s = image.surface
        if s is not None and np.shape(image.mean)[:2] != np.shape(s.ids):
            text = f"the {name}'s surface has the shape {np.shape(s.ids)}, not the image's"
            findings.append(Finding("shape", text))
    if not findings and test.shape != reference.shape:
        (h, w), (rh, rw) = test.shape[:2], reference.shape[:2]
        turned = ": width and height are swapped" if (h, w) == (rw, rh) else ""
        findings.append(Finding("shape", f"the test image is {w} x {h} pixels, the reference {rw} x {rh}{turned}"))
    return findings


def value_findings(test: Image, reference: Image, least: float, noisy: bool = True) -> list[Finding]:
    """NaN, infinite and negative values (below -least) of either image, and a black test image.

    Negative values that noise bears out are none of them (filters with negative lobes, few samples); the test has
    noise only if `noisy`. Where an image's noise is not known, those that are left are "below zero": not proven wrong.
    """
    findings = []
    for name, image, other in (("test image", test, reference), ("reference image", reference, test)):
        negative = noisy or image is reference
        found = bad_values(name, image.mean, least, partial(_noise_of, image, other) if negative else float)
        if negative and image.variance is None and image.samples != 1:
            found = [f._replace(kind="below zero", text=f.text + LOBES) if f.kind == "negative" else f for f in found]
        findings += found
        if image.variance is not None:
            findings += bad_values(f"variance of the {name}", image.variance, 0.0)
    if not findings and not test.mean.any() and reference.mean.any():
        findings.append(Finding("black", "the test image is all black"))
    return findings


def _noise_of(image: Image, other: Image) -> Pixels | float:
    """How far below 0 noise may take a value: as its block or a neighbour scatters, and its variance, if any."""
    from scipy.ndimage import maximum_filter

    if image.variance is None and image.samples == 1:
        return 0.0
    shown = residual(image.mean, other.mean)
    squares = np.where(np.isfinite(shown.square), shown.square * (shown.pixels - 1), 0)
    total, count = (to_pixels(x, *image.shape[:2]) for x in (squares, shown.pixels))
    # Without the value itself, which would otherwise excuse itself.
    square = np.maximum(total - estimated(image.mean, other.mean), 0) / np.maximum(count - 2, 1)
    around = np.ones((3, 3, 1), bool)
    around[1, 1] = False
    scatter = np.where(np.isfinite(shown.square), shown.square, 0)
    square = np.maximum(square, to_pixels(maximum_filter(scatter, footprint=around, mode="constant"), *image.shape[:2]))
    if image.variance is not None:
        square = np.minimum(square, maximum_filter(image.variance, (3, 3, 1)))
        # A sample far below 0 shows in the variance of its own pixel, where a claim is alike in all.
        typical = to_pixels(np.square(block_means(np.sqrt(np.maximum(image.variance, 0)))), *image.shape[:2])
        square = np.where(image.variance > FIREFLY * typical, image.variance, square)
    # A variance of few batches may be far too small: Student's t in the place of the Gaussian.
    few = quantile(CHANCE, degrees_of_freedom(image)) / quantile(CHANCE, math.inf)
    return np.asarray(float(few) * NOISE_BELOW * np.sqrt(np.maximum(square, 0)))


def bad_values(name: str, x: Pixels, least: float, noise: Callable[[], Pixels | float] = float) -> list[Finding]:
    """NaN, infinite, and values below -least by more than `noise`, counted and located."""
    # Two reductions recognise a sound image: NaN and infinity both show in the extremes.
    low, high = x.min(), x.max()
    if np.isfinite(low) and np.isfinite(high) and low >= -least:
        return []
    kinds = (
        ("NaN", np.isnan(x)),
        ("infinite", np.isinf(x)),
        ("negative", np.isfinite(x) & (x < -x.dtype.type(least) - noise())),
    )
    findings = []
    for what, bad in kinds:
        if bad.any():
            rows, columns = np.nonzero(bad.any(axis=-1))
            first = Place(int(columns[0]), int(rows[0]))
            counted = f"{plural(int(bad.sum()), f'{what} value')} in {plural(len(rows), 'pixel')}"
            lowest = f", the lowest {float(x[bad].min()):.3g}" if what == "negative" else ""
            text = f"the {name} has {counted}, the first at {at(first.x, first.y)}{lowest}"
            findings.append(Finding(what, text, first))
    return findings
