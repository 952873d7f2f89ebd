"""Where things are seen: silhouettes, depth, normals."""

import numpy as np

from raytwin.compare.comparison import Geometry
from raytwin.compare.finding import DEPTH, HARD, NORMAL, SILHOUETTE, Finding, at, plural
from raytwin.image import BACKGROUND, Image
from raytwin.scene import Tolerance

DEPTH_REL = 1e-4
"""Bound on the 99.9 % quantile of |t - t_ref| / t_ref: rounding at a sphere's rim stays below, a wrong radius not."""

NORMAL_DEG = 0.1
"""Bound on the 99.9 % quantile of the angle between normals, degrees."""


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
        seen = f"the test sees {_named(t.ids[y, x])}, the reference {_named(r.ids[y, x])}"
        findings.append(
            Finding(
                SILHOUETTE,
                f"{plural(mismatch, 'pixel')} see another object (allowed {tolerance.mask_pixels}): "
                f"first at {at(x, y)}, where {seen}",
            )
        )
    same = ~differ & (r.ids != BACKGROUND)
    if not same.any():
        return Geometry(mask_mismatch_pixels=mismatch), findings
    ys, xs = np.nonzero(same)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = np.abs(t.depth[same].astype(float) - r.depth[same]) / np.abs(r.depth[same])
        a, b = (n / np.linalg.norm(n, axis=-1, keepdims=True) for n in (t.normal[same], r.normal[same]))
        # arccos(a . b) loses half of the digits of a small angle; the chord does not.
        chord = np.linalg.norm(a.astype(float) - b, axis=-1)
    angle = np.degrees(2 * np.arcsin(np.clip(chord / 2, 0, 1)))
    largest = {}
    for rank, what, error, bound, unit in (
        (DEPTH, "depth", depth, DEPTH_REL, ""),
        (NORMAL, "normal", angle, NORMAL_DEG, " degrees"),
    ):
        finite = np.isfinite(error)
        largest[what] = float(error[finite].max()) if finite.any() else None
        if not finite.all():
            i = int(np.argmin(finite))
            count = plural(int((~finite).sum()), "pixel")
            findings.append(Finding(HARD, f"the {what} of {count} is not a number, first at {at(xs[i], ys[i])}"))
            continue
        k = error.size - 1 - error.size // 1000
        p999 = float(np.partition(error, k)[k])
        if p999 > bound:
            i = int(error.argmax())
            kind = "relative error" if what == "depth" else "angle"
            findings.append(
                Finding(
                    rank,
                    f"{what}: the 99.9 % quantile of the {kind} is {p999:.3g}{unit} (allowed {bound:g}), "
                    f"the largest {error[i]:.3g}{unit} at {at(xs[i], ys[i])}",
                )
            )
    return Geometry(mismatch, largest["depth"], largest["normal"]), findings


def _named(index: int) -> str:
    return "the background" if index == BACKGROUND else f"object {index}"
