"""compare(test, reference): hard failures, then geometry, then radiance; one verdict and its reasons in words."""

import math
import time
from dataclasses import replace
from functools import partial
from typing import Any

import msgspec
import numpy as np

from raytwin.compare.alpha import alpha_findings
from raytwin.compare.blocks import Pixels
from raytwin.compare.comparison import Comparison, Perceptual, Radiance, Verdict
from raytwin.compare.exact import Bound, scale_of, unit_of
from raytwin.compare.finding import HARD, Finding, notes, plural
from raytwin.compare.geometry import geometry_findings, without_ties
from raytwin.compare.invalid import shape_findings, value_findings
from raytwin.compare.metrics import measure
from raytwin.compare.radiance_test import RadianceTest
from raytwin.compare.shift import find_shift, shift_finding
from raytwin.images.image import Image
from raytwin.judging import Judging

SURE_SHIFT = 0.5
"""A shift whose standard deviation is larger, pixels, is not reported."""

TIED = "both are equally far, either is correct, and these were not compared"


# Finite values near float32's end may overflow when squared: infinite errors fail, and need no warning.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def compare(
    test: Image,
    reference: Image,
    judging: Judging | None = None,
    *,
    sequence_rate: float | None = None,
    half_steps: tuple[Pixels | None, Pixels | None] = (None, None),
    flip: bool = False,
    **options: Any,
) -> Comparison:
    """Compare `test` with `reference` and return the verdict, its reasons in words, and every number behind it.

    Invalid values are checked first (missing, NaN, infinite, negative, black), then geometry if both images have a
    surface, then radiance. `judging` or `options`: fields of Judging, `compare(a, b, false_alarm_rate=1e-4)`.
    `sequence_rate`: the rate of a whole sequence of looks at more and more samples, if this comparison is one of them.
    `half_steps` (H, W, 3) is what the file formats may have rounded off. `flip` adds NVIDIA's perceptual metric, which
    is slow. A bad image does not raise InputError: it fails.
    """
    judging = replace(judging or Judging(), **options)
    tolerance, noise = judging.bounds, judging.noise
    look = 1.0 if sequence_rate is None else judging.false_alarm_rate / sequence_rate
    made = partial(_made, time.perf_counter())
    if findings := shape_findings(test, reference):
        return made(findings)
    test, reference = _single(test), _single(reference)
    scale = scale_of(reference, test)
    findings = value_findings(test, reference, tolerance.p999_abs * scale, noisy=noise == "both")
    radiance = Radiance(**measure(test.mean, reference.mean, Radiance.__struct_fields__))
    test, tied = without_ties(test, reference)
    geometry, misplaced = geometry_findings(test, reference, tolerance)
    findings += misplaced
    if any(f.rank == HARD for f in findings):
        return made(findings, geometry=geometry, radiance=radiance)
    perceptual = Perceptual(measure(test.mean, reference.mean, ["flip_hdr"])["flip_hdr"] if flip else None)

    if noise != "both":
        test = replace(test, variance=None, samples=0, batches=None)
    if noise == "none":
        reference = replace(reference, variance=None)
    # float32 does not hold the fourth powers of all scales.
    unit = 1.0 if 1e-3 <= scale <= 1e3 else unit_of(scale)
    test, reference = _scaled(test, unit), _scaled(reference, unit)
    mine, theirs = (None if half is None else half / np.float32(unit) for half in half_steps)
    # Where both report what they see, and see the same, nothing is shifted.
    aligned = geometry.mask_mismatch_pixels is not None and not any(f.kind == "silhouettes" for f in findings)
    shift = None if aligned or noise == "none" else find_shift(test.mean, reference.mean)
    # Another light pulls at the edges too: that is no shift to report.
    if shift is not None and shift.sigma <= SURE_SHIFT and (shift.better_than_light or not shift.significant):
        geometry = msgspec.structs.replace(geometry, shift_px=shift.length)
    mismatch = geometry.mask_mismatch_pixels or 0
    excused = mismatch if mismatch <= tolerance.mask_pixels else 0
    bound = Bound(tolerance.p999_abs, scale / unit)
    asked = RadianceTest(test, reference, judging, bound, unit, look, (mine, theirs), excused, shift)
    outcome = asked.exactly() if noise == "none" else asked.run()
    findings += outcome.findings
    different, unknown = alpha_findings(test, reference, judging, half_steps)
    findings += different
    doubts = () if misplaced else outcome.doubts
    if findings and all(f.kind == "below zero" for f in findings):
        doubts, findings = (*(f"undecided: {f.text}" for f in findings), *doubts), []
    if findings and not outcome.doubts and shift is not None and shift.certain:
        findings = [*(f for f in findings if f.kind != "shift"), shift_finding(shift)]
    comparison = made(
        findings,
        outcome.notes,
        doubts,
        geometry=geometry,
        radiance=radiance,
        statistics=msgspec.structs.replace(outcome.statistics, noise_of_samples=asked.of_samples),
        perceptual=perceptual,
        excluded_bias=outcome.excluded_bias,
        failing=outcome.failing if findings and not outcome.doubts else (),
    )
    tie = (f"{plural(tied, 'pixel')} on the common edge of two objects: {TIED}",) if tied else ()
    return comparison.saying(*tie, *unknown)


def _made(
    start: float, findings: list[Finding], seen: tuple[Finding, ...] = (), doubts: tuple[str, ...] = (), **parts: Any
) -> Comparison:
    """`start`: when the comparison began; `seen`: what to say of a pass; `doubts`: why nothing can be decided."""
    verdict: Verdict = "undecided" if doubts else "fail" if findings else "pass"
    said = (*notes(doubts), *sorted(findings, key=lambda f: f.rank)) or seen
    return Comparison(verdict, said, seconds=time.perf_counter() - start, **parts)


def _single(image: Image) -> Image:
    """The image in float32, or float64 where it came so: half floats overflow when squared."""
    wide = {
        k: x for k in ("mean", "variance", "third") if (x := getattr(image, k)) is not None and x.dtype.itemsize < 4
    }
    return replace(image, **{k: x.astype(np.float32) for k, x in wide.items()})


def _scaled(image: Image, unit: float) -> Image:
    """In units of a power of two: every digit stays."""
    if unit == 1:
        return image
    k = math.frexp(unit)[1] - 1
    variance = None if image.variance is None else np.ldexp(image.variance, -2 * k)
    third = None if image.third is None else np.ldexp(image.third, -3 * k)
    return replace(image, mean=np.ldexp(image.mean, -k), variance=variance, third=third)
