"""Is t - r more than noise? One decision at a stated false-alarm rate, from tests that share it.

    values   every value's (t - r) / sd                           sees a wrong pixel
    tiles    the mean of t - r over 8 x 8, 16 x 16, ... pixels    sees a wrong corner
    image    the mean of t - r over everything                    sees a wrong brightness
    shift    the translation between the two (shift.py)        sees a wrong camera

Each of the four gets the rate 1 - (1 - rate)^(1/4), and shares it among its own values by Sidak's formula.

What a variance estimated from a few batches needs, so that the rate holds:

- Student's t in the place of the Gaussian. A value has the batches' degrees of freedom; a sum over pixels has
  (sum v)^2 / sum v^2 - 1, the number of pixels that carry its variance: 0 when a single firefly does.
- A value whose batches happened to agree looks surer than it is. Its variance is raised to the largest of its 3 x 3
  neighbourhood, to its block's mean, and to what the other image's variance says of it.
- A pixel that missed a rare event (a firefly) is too dark by the events' mean, without a trace in its variance. The
  mean of the fireflies that were seen elsewhere is therefore granted as a bias to every value, and to every sum over
  so few pixels that it may have missed them all: often a few thousandths of the radiance, where widening every
  variance by a firefly's would have blinded all tests.
- Values with a standard deviation below the tolerance hold no noise: they are compared as exact images are.

An event that *nobody* sampled cannot be told from a bias. Neighbouring pixels must be independent: a box filter.
"""

import math
from typing import NamedTuple

import numpy as np

from raytwin.compare.blocks import SIDE, block_sums, merge, strips
from raytwin.compare.chance import quantile, sidak, two_sided, welch
from raytwin.compare.exact import Quiet
from raytwin.compare.noise import Allowance, allowance, degrees_of_freedom, mutual, regularised, survey, variance_ratio
from raytwin.image import Image
from raytwin.scene import Tolerance

TESTS = 4

POWER = 0.9
"""The probability with which a minimum detectable bias is detected."""


class Worst(NamedTuple):
    """The least plausible of a family of tests: its deviation in standard deviations, its p-value, and where it is."""

    z: float = 0.0
    p: float = 1.0
    x: int = 0
    y: int = 0
    width: int = 1
    height: int = 1
    channel: int = 0
    error: float = 0.0

    @property
    def signed(self) -> float:
        """`z` with the sign of the error."""
        return math.copysign(self.z, self.error)


class Family(NamedTuple):
    """Tests of one kind: the worst, the level that its p-value must stay above, how many fell below."""

    worst: Worst
    level: float
    failed: int
    detectable: float = math.nan

    @property
    def passed(self) -> bool:
        return self.worst.p >= self.level


class Noise(NamedTuple):
    """What the three tests of radiance found, and the values without noise; `failed_pixels` hold a failed value."""

    value: Family
    tile: Family
    image: Family
    quiet: Quiet
    failed_pixels: int


def decide(test: Image, reference: Image, tolerance: Tolerance, rate: float) -> Noise:
    """Values, tiles, image: of two images of one shape (H, W, 3), finite, at least one of them with a variance."""
    a, b = survey(test), survey(reference)
    typical, largest = variance_ratio(test, reference, a, b, tolerance.p999_abs**2)
    noisy_sides = [s for s in (a, b) if s is not None]
    share = sidak(rate, TESTS)
    granted = allowance(noisy_sides, tolerance, test.shape[0] * test.shape[1], share)
    allowed = granted.of(1).astype(np.float32)
    dof = welch([(s.mean, degrees_of_freedom(i)) for i, s in ((test, a), (reference, b)) if s is not None])
    level = sidak(share, test.mean.size)
    threshold = float(quantile(level, dof))
    unit = np.float32(max(sum(s.mean for s in noisy_sides), 1e-30))  # keeps v^2 within float32

    sums: dict[str, list[np.ndarray]] = {k: [] for k in ("n", "d", "r", "va", "vb", "vv")}
    worst, quiet = Worst(), Quiet()
    failed_values = failed_pixels = 0
    for y0, y1, rows in strips(test.shape[0]):
        d = np.subtract(test.mean[y0:y1], reference.mean[y0:y1], dtype=np.float32)
        va = regularised(test.variance, a, y0, y1, rows)
        vb = regularised(reference.variance, b, y0, y1, rows)
        error = np.abs(d)
        silent = va + vb <= np.float32(tolerance.p999_abs) ** 2
        v = mutual(va, vb, largest)
        if silent.any():
            still = np.where(silent, error, np.float32(0))
            quiet = quiet.plus(still, int(np.count_nonzero(silent)), allowed, tolerance, y0)
            v[silent] = np.inf
            d[silent] = 0
        error -= allowed
        np.maximum(error, 0, out=error)
        error *= error
        error /= v
        peak = int(error.argmax())
        z = math.sqrt(error.flat[peak])
        if z > worst.z:
            y, x, c = (int(i) for i in np.unravel_index(peak, error.shape))
            worst = Worst(z, float(two_sided(z, dof)), x, y + y0, 1, 1, c, float(d[y, x, c]))
        if z > threshold:
            failed = error > threshold**2
            failed_values += int(np.count_nonzero(failed))
            failed_pixels += int(np.count_nonzero(failed.any(axis=-1)))

        own = np.zeros_like(d)
        for key, image in (("va", test), ("vb", reference)):
            v = np.zeros_like(d) if image.variance is None else np.where(silent, np.float32(0), image.variance[y0:y1])
            sums[key].append(block_sums(v, rows))
            own += v
        own /= unit
        own *= own
        sums["vv"].append(block_sums(own, rows) * float(unit) ** 2)
        sums["d"].append(block_sums(d, rows))
        sums["r"].append(block_sums(reference.mean[y0:y1], rows))
        sums["n"].append(block_sums(np.ones((*d.shape[:2], 1), np.float32), rows))

    grids = {k: np.concatenate(v) for k, v in sums.items()}
    return Noise(
        Family(worst, level, failed_values),
        _tiles(grids, granted, typical, share, test.shape[:2]),
        _image(grids, granted, typical, share, test.shape[:2]),
        quiet,
        failed_pixels,
    )


def _student(s: dict[str, np.ndarray], granted: Allowance, ratio: float | None):
    """(|mean error| beyond the allowance over its standard deviation, that deviation, degrees of freedom) of sums."""
    v = s["va"] + s["vb"]
    dof = np.maximum(np.divide(np.square(v), s["vv"], out=np.zeros_like(v), where=s["vv"] > 0) - 1, 0.5)
    sd = np.sqrt(mutual(s["va"], s["vb"], ratio)) / s["n"]
    beyond = np.maximum(np.abs(s["d"] / s["n"]) - granted.of(s["n"]), 0)
    z = np.divide(beyond, sd, out=np.zeros_like(sd), where=sd > 0)
    return np.nan_to_num(z, nan=np.inf, posinf=np.inf), sd, dof


def _detectable(s: dict[str, np.ndarray], sd: np.ndarray, dof: np.ndarray, granted: Allowance, level: float):
    """The smallest error relative to the reference's mean that is found with probability POWER, of each sum."""
    from scipy.special import ndtri

    with np.errstate(divide="ignore", invalid="ignore"):
        least = (granted.of(s["n"]) + sd * (quantile(level, dof) + ndtri(POWER))) / (s["r"] / s["n"])
    return least[np.isfinite(least) & (least > 0)]


def _tiles(grids: dict[str, np.ndarray], granted: Allowance, ratio: float | None, share: float, size) -> Family:
    """Tiles of 8, 16, 32, ... pixels, up to half of the image's longer side; `detectable` is for 16 x 16."""
    height, width = size
    scales = [(SIDE, grids)]
    while 4 * scales[-1][0] <= max(height, width):
        side, s = scales[-1]
        scales.append((2 * side, {k: merge(x) for k, x in s.items()}))
    level = sidak(share, sum(s["d"].size for _, s in scales))
    doubtful = float(quantile(level, math.inf))
    worst, failed, detectable = Worst(width=SIDE, height=SIDE), 0, math.nan
    for k, (side, s) in enumerate(scales):
        z, sd, dof = _student(s, granted, ratio)
        # Student's tails are wider than the Gaussian's: only what a Gaussian would doubt needs them.
        doubt = z >= min(doubtful, float(z.max()))
        p = np.ones_like(z)
        p[doubt] = two_sided(z[doubt], dof[doubt])
        failed += int(np.count_nonzero(p < level))
        least = np.flatnonzero(p == p.min())
        i = int(least[z.flat[least].argmax()])
        if (p.flat[i], -z.flat[i]) < (worst.p, -worst.z):
            y, x, c = (int(j) for j in np.unravel_index(i, z.shape))
            w, h = min(side, width - x * side), min(side, height - y * side)
            mean = float(s["d"][y, x, c] / s["n"][y, x, 0])
            worst = Worst(float(z.flat[i]), float(p.flat[i]), x * side, y * side, w, h, c, mean)
        if k == min(1, len(scales) - 1):
            seen = _detectable(s, sd, dof, granted, level)
            detectable = float(np.median(seen)) if seen.size else math.nan
    return Family(worst, level, failed, detectable)


def _image(grids: dict[str, np.ndarray], granted: Allowance, ratio: float | None, share: float, size) -> Family:
    s = {k: x.sum(axis=(0, 1)) for k, x in grids.items()}
    level = sidak(share, s["d"].size)
    z, sd, dof = _student(s, granted, ratio)
    p = two_sided(z, dof)
    c = int(z.argmax())
    worst = Worst(float(z[c]), float(p[c]), 0, 0, size[1], size[0], c, float(s["d"][c] / s["n"][0]))
    least = _detectable(s, sd, dof, granted, level)
    return Family(worst, level, int((p < level).sum()), float(least.max()) if least.size else math.nan)
