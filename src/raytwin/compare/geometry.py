"""Where things are seen: silhouettes, depth, normals."""

from dataclasses import replace

import numpy as np

from raytwin.array_types import Bool, Float32
from raytwin.compare.comparison import Geometry
from raytwin.compare.finding import Finding, Place, at, plural
from raytwin.compare.metrics import all_finite, nth_largest
from raytwin.images.image import BACKGROUND, Image, Surface
from raytwin.scene import Tolerance

DEPTH_REL = 1e-4
"""Bound on the 99.9 % quantile of |t - t_ref| / t_ref: rounding at a sphere's rim stays below."""

NORMAL_DEG = 0.1
"""Bound on the 99.9 % quantile of the angle between normals, degrees."""

PIXELS_PER_PASS = 1 << 14
"""Pixels processed at once, so that they fit in the cache."""


def geometry_findings(test: Image, reference: Image, tolerance: Tolerance) -> tuple[Geometry, list[Finding]]:
    """Geometry without the shift, and what is wrong with it; nulls where an image has no surface."""
    if test.surface is None or reference.surface is None:
        return Geometry(), []
    t, r = test.surface, reference.surface
    findings = []
    differ = t.ids != r.ids
    mismatch = int(np.count_nonzero(differ))
    if mismatch > tolerance.mask_pixels:
        ys, xs = np.nonzero(differ)
        y, x = int(ys[0]), int(xs[0])
        seen = f"the test sees {_named(int(t.ids[y, x]))}, the reference {_named(int(r.ids[y, x]))}"
        findings.append(
            Finding(
                "silhouettes",
                f"another object is seen in {plural(mismatch, 'pixel')} (allowed {tolerance.mask_pixels}): "
                f"first at {at(x, y)}, where {seen}",
                Place(x, y),
            )
        )
    same = ~differ & (r.ids != BACKGROUND)
    if not same.any():
        return Geometry(mask_mismatch_pixels=mismatch), findings
    depth, chord = _errors(t, r, same)
    above = int(np.count_nonzero(same)) // 1000
    largest = {}
    for kind, what, error, bound, unit in (
        ("depth", "depth", depth, DEPTH_REL, ""),
        ("normals", "normal", chord, NORMAL_DEG, " degrees"),
    ):
        in_units = _degrees if what == "normal" else float
        if not all_finite(error):
            finite = np.isfinite(error)
            largest[what] = in_units(float(error[finite].max())) if (finite & same).any() else None
            y, x = (int(i) for i in np.argwhere(~finite)[0])
            count = plural(int((~finite).sum()), "pixel")
            text = f"the {what} of {count} is not finite, first at {at(x, y)}"
            findings.append(Finding("NaN", text, Place(x, y)))
            continue
        y, x = (int(i) for i in np.unravel_index(int(error.argmax()), error.shape))
        largest[what] = in_units(float(error[y, x]))
        p999 = in_units(nth_largest(above, np.asarray, error))
        if p999 > bound:
            measured = "relative error" if what == "depth" else "angle"
            findings.append(
                Finding(
                    kind,
                    f"{what}: the 99.9 % quantile of the {measured} is {p999:.3g}{unit} (allowed {bound:g}), "
                    f"the largest {largest[what]:.3g}{unit} at {at(x, y)}",
                    Place(x, y),
                )
            )
    return Geometry(mismatch, largest["depth"], largest["normal"]), findings


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
    """The test image with the reference's pixels where either answer is correct, and how many these are."""
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
    """(H, W) float32 each, 0 where not `same`: |t - t_ref| / t_ref; the chord between the normals' ends.

    arccos(a . b) loses half of the digits of a small angle; the chord does not.
    """
    depth, chord = np.zeros(same.shape, np.float32), np.zeros(same.shape, np.float32)
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
            np.copyto(chord[part], np.sqrt(np.einsum("ijk,ijk->ij", apart, apart)), where=same[part])
    return depth, chord


def _degrees(chord: float) -> float:
    """The angle of a chord of the unit circle."""
    return float(np.degrees(2 * np.arcsin(min(chord / 2, 1.0))))


def _named(index: int) -> str:
    return "the background" if index == BACKGROUND else f"object {index}"
