"""Limits as idiff has them: how far a pixel may err, and how many may err further. For images without noise.

The same counts as OpenImageIO's idiff, with two mends: NaN and infinity always fail, and so does a pixel beyond the
hard limit where no other limit is exceeded.
"""

import math
from typing import Annotated

import msgspec
import numpy as np

from raytwin.compare.blocks import strips
from raytwin.compare.finding import CHANNELS, EXACT, Finding, at, plural
from raytwin.compare.invalid import bad_values, shape_findings
from raytwin.image import Image
from raytwin.scene import Record

Bound = Annotated[float, msgspec.Meta(ge=0)]


class Limits(Record, frozen=True):
    """A pixel errs when |t - r| > `error` and > `relative` * (|t| + |r|) / 2 in some channel.

    The images fail if more than `percent` of the pixels and more than `pixels` of them err, or if more than `pixels`
    err by more than `hard`.
    """

    error: Bound = 1e-6
    relative: Bound = 0.0
    percent: Bound = 0.0
    pixels: Annotated[int, msgspec.Meta(ge=0)] = 0
    hard: Bound = math.inf


def limit_findings(test: Image, reference: Image, limits: Limits) -> tuple[list[Finding], str]:
    """What exceeds the limits, and a sentence that counts what does not."""
    if findings := shape_findings(test, reference):
        return findings, ""
    findings = bad_values("test image", test.mean, math.inf) + bad_values("reference image", reference.mean, math.inf)
    erring = beyond = 0
    worst, x, y, channel = 0.0, 0, 0, 0
    with np.errstate(invalid="ignore", over="ignore"):
        for y0, y1, _ in strips(test.shape):
            t, r = (np.asarray(i.mean[y0:y1], np.float32) for i in (test, reference))
            error = np.abs(t - r)
            wrong = error > np.float32(limits.error)
            if limits.relative > 0:
                wrong &= error > np.float32(limits.relative / 2) * (np.abs(t) + np.abs(r))
            erring += int(np.count_nonzero(wrong.any(axis=-1)))
            beyond += int(np.count_nonzero((error > np.float32(limits.hard)).any(axis=-1)))
            peak = int(np.nan_to_num(error, nan=0.0).argmax())
            if error.flat[peak] > worst:
                worst = float(error.flat[peak])
                row, x, channel = (int(i) for i in np.unravel_index(peak, error.shape))
                y = row + y0
    count = test.shape[0] * test.shape[1]
    share = f"{plural(erring, 'pixel')} of {count} ({100 * erring / count:.3g} %) err by more than {limits.error:g}"
    if limits.relative > 0:
        share += f" and {limits.relative:g} of the value"
    where = f"; the worst {worst:.3g} at {at(x, y)}, {CHANNELS[channel]}" if worst > 0 else ""
    if 100 * erring > limits.percent * count and erring > limits.pixels:
        findings.append(Finding(EXACT, f"{share} (allowed {limits.percent:g} %{_or(limits.pixels)}){where}"))
    if beyond > limits.pixels:
        text = f"{plural(beyond, 'pixel')} of {count} err by more than {limits.hard:g}"
        findings.append(Finding(EXACT, f"{text} (allowed {limits.pixels}){where}"))
    return findings, share + where


def _or(pixels: int) -> str:
    return f" or {plural(pixels, 'pixel')}" if pixels else ""
