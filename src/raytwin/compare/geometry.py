"""Where things are seen: silhouettes, depth, normals."""

from dataclasses import replace

import numpy as np

from raytwin.array_types import Bool, Float32
from raytwin.compare.comparison import Geometry
from raytwin.compare.finding import Finding, Place, at, plural
from raytwin.compare.metrics import nth_largest
from raytwin.images.image import BACKGROUND, Image, Surface
from raytwin.scene import Tolerance

DEPTH_REL = 1e-4
"""Bound on the 99.9 % quantile of |t - t_ref| / t_ref: rounding at a sphere's rim stays below."""

NORMAL_DEG = 0.1
"""Bound on the 99.9 % quantile of the angle between normals, degrees."""

PIXELS_PER_PASS = 1 << 14
"""Pixels processed at once, so that they fit in the cache."""


def geometry_findings(test: Image, reference: Image, tolerance: Tolerance) -> tuple[Geometry, list[Finding]]:
    """Compare silhouettes, depths and normals. Return the numbers (null without a surface) and the findings."""
    if test.surface is None or reference.surface is None:
        return Geometry(), []
    mine, theirs = test.surface, reference.surface
    findings = []
    differ = mine.ids != theirs.ids
    mismatch = int(np.count_nonzero(differ))
    if mismatch > tolerance.mask_pixels:
        ys, xs = np.nonzero(differ)
        y, x = int(ys[0]), int(xs[0])
        seen = f"the test sees {_named(int(mine.ids[y, x]))}, the reference {_named(int(theirs.ids[y, x]))}"
        findings.append(
            Finding(
                "silhouettes",
                f"another object is seen in {plural(mismatch, 'pixel')} (allowed {tolerance.mask_pixels}): "
                f"first at {at(x, y)}, where {seen}",
                Place(x, y),
            )
        )
    same = ~differ & (theirs.ids != BACKGROUND)
    if not same.any():
        return Geometry(mask_mismatch_pixels=mismatch), findings
    depth, angle = _errors(mine, theirs, same)
    above, largest = int(np.count_nonzero(same)) // 1000, []
    for kind, what, measured, error, bound, unit in (
        ("depth", "depth", "relative error", depth, DEPTH_REL, ""),
        ("normals", "normal", "angle", angle, NORMAL_DEG, " degrees"),
    ):
        finite = np.isfinite(error)
        largest.append(float(error[finite & same].max()) if (finite & same).any() else None)
        if not finite.all():
            y, x = np.argwhere(~finite)[0].tolist()
            text = f"the {what} of {plural(int((~finite).sum()), 'pixel')} is not finite, first at {at(x, y)}"
            findings.append(Finding("NaN", text, Place(x, y)))
        elif (p999 := nth_largest(above, np.asarray, error)) > bound:
            y, x = (int(i) for i in np.unravel_index(int(error.argmax()), error.shape))
            text = f"{what}: the 99.9 % quantile of the {measured} is {p999:.3g}{unit} (allowed {bound:g}), the largest"
            findings.append(Finding(kind, f"{text} {largest[-1]:.3g}{unit} at {at(x, y)}", Place(x, y)))
    return Geometry(mismatch, *largest), findings


def ties(test: Surface, reference: Surface) -> Bool[np.ndarray, "h w"]:
    """Pixels on the common edge of two objects, where rounding decides which is seen and either answer is correct.

    Both are met at the same depth, to DEPTH_REL, and the reference sees the test's object in a neighbouring pixel.
    """
    tied = (test.ids != reference.ids) & (test.ids != BACKGROUND) & (reference.ids != BACKGROUND)
    if not tied.any():
        return np.asarray(tied)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = np.abs(np.subtract(test.depth, reference.depth, dtype=np.float32))
        tied &= depth <= np.float32(DEPTH_REL) * np.abs(reference.depth)
    wide = np.pad(reference.ids, 1, constant_values=BACKGROUND)
    h, w = tied.shape
    near = np.zeros_like(tied)
    for y in range(3):
        for x in range(3):
            near |= wide[y : y + h, x : x + w] == test.ids
    return np.asarray(tied & near)


def without_ties(test: Image, reference: Image) -> tuple[Image, int]:
    """Copy the reference's pixels into the test where either answer is correct. Return the image and their number."""
    t, r = test.surface, reference.surface
    if t is None or r is None or not (tied := ties(t, r)).any():
        return test, 0
    mean = np.where(tied[..., None], reference.mean, test.mean)
    parts = (np.where(tied, r.ids, t.ids), np.where(tied, r.depth, t.depth))
    surface = Surface(*parts, np.where(tied[..., None], r.normal, t.normal))
    return replace(test, mean=mean, surface=surface), int(np.count_nonzero(tied))


def _errors(
    t: Surface, r: Surface, same: Bool[np.ndarray, "h w"]
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """(H, W) float32 each, 0 where not `same`: |t - t_ref| / t_ref; the angle between the normals, degrees.

    arccos(a . b) loses half of the digits of a small angle; the chord between their ends does not.
    """
    depth, angle = np.zeros((2, *same.shape), np.float32)
    rows = max(1, PIXELS_PER_PASS // same.shape[1])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for y in range(0, len(same), rows):
            part = slice(y, y + rows)
            error = np.abs(np.subtract(t.depth[part], r.depth[part], dtype=np.float32))
            error /= np.abs(r.depth[part])
            np.copyto(depth[part], error, where=same[part])
            a, b = (
                n[part] / np.sqrt(np.einsum("ijk,ijk->ij", n[part], n[part]))[..., None] for n in (t.normal, r.normal)
            )
            apart = np.subtract(a, b)
            chord = np.sqrt(np.einsum("ijk,ijk->ij", apart, apart))
            np.copyto(angle[part], np.degrees(2 * np.arcsin(np.minimum(chord / 2, 1))), where=same[part])
    return depth, angle


def _named(index: int) -> str:
    return "the background" if index == BACKGROUND else f"object {index}"
