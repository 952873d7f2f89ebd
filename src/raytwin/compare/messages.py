"""The verdict in words that a person reads."""

import math

from raytwin.compare.decision import POWER, Decision, Family, Worst
from raytwin.compare.exact import NoiseFree
from raytwin.compare.finding import CHANNELS, Finding, Place, at, notes, plural
from raytwin.compare.significance import quantile

HARDLY_LIT = 1e4
"""Ratio of error to reference above which the reference counts as black: the message states the absolute error."""

COMMON_SHARE = 0.05
"""Share of a pixel's variance, common to all pixels of a tile or image, below which the reason names it (equal random
numbers, one lamp's choice for all): 161 of 200 pairs of correct renders whose tiles shared 5 % failed."""

CERTAIN = 1e-12
"""Probabilities below this count as certainty: the message leaves them out."""


def percent(x: float) -> str:
    """
    >>> [percent(x) for x in (0.0123, 0.99, 3.456, 1e9, math.inf)]
    ['1.2 %', '99 %', '346 %', 'any size', 'any size']
    """
    return f"{100 * x:.2g} %" if 100 * x < 99.5 else f"{100 * x:.0f} %" if x < 100 else "any size"


def deviations(z: float) -> str:
    """
    >>> [deviations(z) for z in (4.567, 45.67, 4050.0)]
    ['4.57 standard deviations', '46 standard deviations', 'far beyond noise']
    """
    return "far beyond noise" if z >= 1000 else f"{z:.{2 if z < 10 else 0}f} standard deviations"


def noise_findings(made: Decision, unit: float) -> list[Finding]:
    """Return a finding per family that noise does not explain: how large, where, how sure. `unit`: of radiance."""
    findings = []
    for kind, family in (("image", made.image), ("tile", made.tile), ("value", made.value)):
        if family.passed:
            continue
        w = family.worst
        off = f"{_amount(w.error, w.radiance, unit)} in {CHANNELS[w.channel]}"
        sure = deviations(w.z)
        if w.p >= CERTAIN:
            sure += f", p = {w.p:.1g} where noise may have {family.level:.1g}"
        where = {
            "image": "the whole image",
            "tile": f"the {w.width} x {w.height} tile at {at(w.x, w.y)}",
            "value": f"the pixel {at(w.x, w.y)}",
        }[kind]
        if kind != "value" and (share := shared_share(w, family.level)) < COMMON_SHARE:
            sure += f", unless {'all' if kind == 'image' else 'its'} pixels share {percent(share)} of their variance: "
            sure += "seed each pixel apart"
        text = f"{where} is {off} ({sure}){_others(kind, family, made.failed_pixels)}"
        findings.append(Finding(kind, text, Place(w.x, w.y, w.width, w.height)))
    return findings


def shared_share(worst: Worst, level: float) -> float:
    """The share of each pixel's variance that, common to all pixels, makes `worst` no more than its level allows.

    z standard deviations of the mean of n independent pixels are z / sqrt(n) of one pixel's.
    """
    return (worst.z / float(quantile(level, math.inf))) ** 2 / (worst.width * worst.height)


def _amount(error: float, area: float, unit: float) -> str:
    """Return in words how far a mean is from the expected one."""
    if area <= 0 or error > HARDLY_LIT * area:
        return f"{abs(error) * unit:.3g} too {'bright' if error > 0 else 'dark'}"
    if error > 10 * area:
        return f"{1 + error / area:.0f} times too bright"
    return f"{100 * abs(error) / area:.3g} % too {'bright' if error > 0 else 'dark'}"


def _others(kind: str, family: Family, failed_pixels: int) -> str:
    if kind == "tile" and family.failed > 1:
        return f"; {family.failed} of {family.tests} tiles are beyond noise"
    if kind == "value" and failed_pixels > 1:
        return f"; so {'is' if failed_pixels == 2 else 'are'} {plural(failed_pixels - 1, 'other pixel')}"
    return ""


def what_could_be_seen(image: float, tile: float, inflation: float, rate: float) -> tuple[Finding, ...]:
    """Return which errors of the `image` and a `tile` a pass would have caught, and whether neighbours share noise."""
    of_tile = f"or of {percent(tile)} in any 24 x 24 patch"
    if not math.isfinite(tile):
        of_tile = "but perhaps none in a 24 x 24 patch, however large"
    text = (
        f"no difference beyond noise (false-alarm rate {rate:g}); would have caught, {10 * POWER:g} times in 10, a "
        f"brightness error of {percent(image)}, {of_tile}"
    )
    if inflation < 1.2:
        return notes([text])
    shared = (
        "neighbouring pixels share their noise (a reconstruction filter wider than the pixel?): means have "
        f"{inflation:.2g} times the variance of independent pixels"
    )
    return notes([text, shared])


def agreement(p999: float, allowed: float, noise_free: NoiseFree) -> Finding:
    """Return the note on noise-free images that agree."""
    text = f"the images agree: 99.9 % of the values to {p999:.2g} (allowed {allowed:.2g})"
    if noise_free.error <= 10 * allowed or math.isinf(allowed):
        return Finding("note", f"{text}, all to {noise_free.error:.2g}")
    count = max(noise_free.outliers, 1)
    more = f"{plural(count, 'pixel')} {'errs' if count == 1 else 'err'} by more"
    worst = f"the worst by {noise_free.error:.2g} at {at(noise_free.x, noise_free.y)}"
    return Finding("note", f"{text}; {more}, {worst}", Place(noise_free.x, noise_free.y))
