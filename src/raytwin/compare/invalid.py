"""What no image may be: not an array of radiance, NaN, infinite, negative, black. Counted and located."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from raytwin.compare.blocks import Pixels, to_pixels
from raytwin.compare.finding import Finding, Place, at, plural
from raytwin.compare.noise import block_means, degrees_of_freedom
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
        arrays = {f"the {name} image": image.mean}
        if image.variance is not None:
            arrays[f"the {name}'s variance"] = image.variance
        for whose, array in arrays.items():
            if not isinstance(array, np.ndarray):
                findings.append(Finding("shape", f"{whose} is no array but {type(array).__name__}"))
            elif not np.issubdtype(array.dtype, np.floating):
                findings.append(Finding("shape", f"{whose} holds {array.dtype}, not floating-point radiance"))
            elif array.ndim != 3 or array.shape[-1] != 3 or 0 in array.shape:
                findings.append(Finding("shape", f"{whose} has the shape {array.shape}, not (height, width, 3)"))
            elif array.shape != np.shape(image.mean):
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
    for name, image in (("test image", test), ("reference image", reference)):
        has_noise = noisy or image is reference
        found = bad_values(name, image.mean, least, partial(_noise_of, image) if has_noise else float)
        if has_noise and image.variance is None and image.samples != 1:
            found = [f._replace(kind="below zero", text=f.text + LOBES) if f.kind == "negative" else f for f in found]
        findings += found
        if image.variance is not None:
            findings += bad_values(f"variance of the {name}", image.variance, 0.0)
    if not findings and not test.mean.any() and reference.mean.any():
        findings.append(Finding("black", "the test image is all black"))
    return findings


def _noise_of(image: Image) -> Pixels | float:
    """How far below 0 noise may take a value, by its own variance or its block's."""
    if image.variance is None:
        return 0.0
    blocks = to_pixels(block_means(image.variance), *image.shape[:2])
    # A variance of few batches may be far too small: Student's t in the place of the Gaussian.
    few = quantile(CHANCE, degrees_of_freedom(image)) / quantile(CHANCE, math.inf)
    return np.asarray(float(few) * NOISE_BELOW * np.sqrt(np.maximum(np.maximum(image.variance, blocks), 0)))


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
