"""compare(test, reference): hard failures, then geometry, then radiance; one verdict and its reasons in words."""

import math
import time
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from raytwin.compare.chance import sidak
from raytwin.compare.comparison import Comparison, Perceptual, Radiance, Statistics
from raytwin.compare.decision import POWER, TESTS, Noise, decide
from raytwin.compare.exact import count_quiet
from raytwin.compare.finding import CHANNELS, EXACT, HARD, IMAGE, SHIFT, TILE, VALUE, Finding, at, plural
from raytwin.compare.geometry import geometry_findings
from raytwin.compare.hard import shape_findings, value_findings
from raytwin.compare.hints import find_hints
from raytwin.compare.metrics import METRICS, measure
from raytwin.compare.shift import GRANTED_SHIFT, find_shift, shift_finding, shift_findings
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.scene import Tolerance

SURE_SHIFT = 0.5
"""A shift whose standard deviation is larger, pixels, is not reported."""


def compare(
    test: Image,
    reference: Image,
    *,
    tolerance: Tolerance = Tolerance(),  # noqa: B008 (frozen)
    false_alarm_rate: float = 1e-3,
    flip: bool = False,
) -> Comparison:
    """Does `test` show what `reference` shows? The verdict, its reasons in words, and every number behind it.

    Hard failures come first (no radiance, NaN, infinite, negative, black), then geometry where both have a surface,
    then radiance. Values without noise must meet `tolerance`; for the others `false_alarm_rate` is the probability
    that two images that differ by noise alone fail. `flip` adds the perceptual metric, which takes longer than all
    else. A bad image never raises: it fails.
    """
    if not 0 < false_alarm_rate < 1:
        raise InputError("false_alarm_rate", "a probability between 0 and 1", false_alarm_rate)
    start = time.perf_counter()
    # Finite values near float32's end may overflow when squared: infinite errors fail, and need no warning.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        made = _compare(test, reference, tolerance, false_alarm_rate, flip)
    return msgspec.structs.replace(made, seconds=time.perf_counter() - start)


def _compare(test: Image, reference: Image, tolerance: Tolerance, rate: float, flip: bool) -> Comparison:
    if findings := shape_findings(test, reference):
        return _made(findings)
    test, reference = _single(test), _single(reference)
    findings = value_findings(test, reference, tolerance)
    geometry, wrong = geometry_findings(test, reference, tolerance)
    findings += wrong
    radiance = _radiance(test.mean, reference.mean)
    if any(f.rank == HARD for f in findings):
        return _made(findings, geometry=geometry, radiance=radiance)

    shift = find_shift(test.mean, reference.mean)
    if shift is not None and shift.sigma <= SURE_SHIFT:
        geometry = msgspec.structs.replace(geometry, shift_px=shift.length)
    pixels = test.shape[0] * test.shape[1]
    mismatch = geometry.mask_mismatch_pixels or 0
    excused = mismatch if mismatch <= tolerance.mask_pixels else 0
    if test.variance is None and reference.variance is None:
        quiet = count_quiet(test, reference, tolerance)
        if wrong := quiet.findings(tolerance, pixels, excused):
            relative = METRICS["p999_rel"].function(test.mean, reference.mean)
            text = f"99.9 % quantile of the error: {radiance.p999_abs:.3g} absolute, {relative:.3g} relative"
            findings += [*wrong, Finding(EXACT, text)]
        statistics = Statistics(pixel_fail_fraction=quiet.outliers / pixels)
        notes = (
            f"the images agree: 99.9 % of the values to {radiance.p999_abs:.2g} (allowed {tolerance.p999_abs:g}), "
            f"all to {radiance.max_abs:.2g}",
        )
    else:
        noise = decide(test, reference, tolerance, rate)
        findings += noise.quiet.findings(tolerance, pixels, excused) + _noise_findings(noise, reference)
        if shift is not None:
            findings += shift_findings(shift, sidak(rate, TESTS))
        statistics = Statistics(
            noise.image.worst.signed,
            noise.tile.worst.signed,
            (noise.failed_pixels + noise.quiet.outliers) / pixels,
            noise.image.detectable if math.isfinite(noise.image.detectable) else None,
        )
        notes = _what_could_be_seen(noise, rate)
    if findings:
        hints = find_hints(test.mean, reference.mean)
        certain = shift is not None and shift.length > max(5 * shift.sigma, 2 * GRANTED_SHIFT)
        # A missing shadow pulls at the edges too; only a shift accounts for most of the difference.
        certain = certain and (shift.length > 1 or shift.explained > 0.5)
        if certain and not hints and not any(f.rank == SHIFT for f in findings):
            findings.append(shift_finding(shift))
        findings += hints
    perceptual = Perceptual(measure(test.mean, reference.mean, ["flip_hdr"])["flip_hdr"] if flip else None)
    return _made(findings, notes, geometry=geometry, radiance=radiance, statistics=statistics, perceptual=perceptual)


def _made(findings: list[Finding], notes: tuple[str, ...] = (), **parts: Any) -> Comparison:
    reasons = tuple(f.text for f in sorted(findings, key=lambda f: f.rank)) or notes
    return Comparison("fail" if findings else "pass", reasons, **parts)


def _single(image: Image) -> Image:
    """The image in float32, or float64 where it came so: half floats overflow when squared."""
    wide = {k: x for k in ("mean", "variance") if (x := getattr(image, k)) is not None and x.dtype.itemsize < 4}
    return replace(image, **{k: x.astype(np.float32) for k, x in wide.items()})


def _radiance(test: np.ndarray, reference: np.ndarray) -> Radiance:
    """The metrics over the values that are finite in both images; null where none is, or a metric has no value."""
    return Radiance(**measure(test, reference, Radiance.__struct_fields__))


def _noise_findings(noise: Noise, reference: Image) -> list[Finding]:
    findings = []
    for rank, family in ((IMAGE, noise.image), (TILE, noise.tile), (VALUE, noise.value)):
        if family.passed:
            continue
        w = family.worst
        area = reference.mean[w.y : w.y + w.height, w.x : w.x + w.width, w.channel].mean(dtype=np.float64)
        relative = f"{100 * abs(w.error) / area:.3g} %" if area > 0 else f"{abs(w.error):.3g}"
        off = f"{relative} too {'bright' if w.error > 0 else 'dark'} in {CHANNELS[w.channel]}"
        sure = f"{w.z:.3g} standard deviations, p = {max(w.p, 1e-300):.1g} where noise may have {family.level:.1g}"
        where = {
            IMAGE: "the whole image",
            TILE: f"the {w.width} x {w.height} tile at {at(w.x, w.y)}",
            VALUE: f"the pixel {at(w.x, w.y)}",
        }[rank]
        others = {IMAGE: 0, TILE: family.failed - 1, VALUE: noise.failed_pixels - 1}[rank]
        kind = {IMAGE: "", TILE: "other tile", VALUE: "other pixel"}[rank]
        too = f"; so {'is' if others == 1 else 'are'} {plural(others, kind)} beyond noise" if others else ""
        findings.append(Finding(rank, f"{where} is {off} ({sure}){too}"))
    return findings


def _what_could_be_seen(noise: Noise, rate: float) -> tuple[str, ...]:
    def share(x: float) -> str:
        return f"{100 * x:.2g} %" if math.isfinite(x) else "no size"

    return (
        f"no difference beyond noise, at a false-alarm rate of {rate:g}: with probability {POWER:g}, an error of "
        f"{share(noise.image.detectable)} of the whole image's mean, or of {share(noise.tile.detectable)} of a tile of "
        f"16 x 16 pixels (the median tile), would have been seen",
    )
