"""Is t - r more than noise? One decision at a stated false-alarm rate, from tests that share it.

    values   every value's (t - r) / sd                           sees a wrong pixel
    tiles    the mean of t - r over 8 x 8, 16 x 16, ... pixels    sees a wrong corner
    image    the mean of t - r over everything                    sees a wrong brightness
    shift    the translation between the two (geometry.py)        sees a wrong camera

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

from raytwin.compare.blocks import SIDE, block_sums, dilate, merge, strips, unblock
from raytwin.compare.exact import Quiet
from raytwin.image import Image
from raytwin.scene import Tolerance

FIREFLY = 25.0
"""A firefly's variance over that of its block and its neighbours: five times their standard deviation."""

SURE = 20.0
"""A sum over pixels that expects more fireflies than this has seen some: missing all has probability exp(-20)."""

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


# -------------------------------------------------------------------------------------------------- distributions


def degrees_of_freedom(image: Image) -> float:
    """batches - 1, or samples - 1 where every sample was a batch; infinite where nothing is told."""
    batches = image.batches if image.batches is not None else image.samples
    return float(batches - 1) if batches > 1 else math.inf


def sidak(rate: float, tests: float) -> float:
    """1 - (1 - rate)^(1 / tests): the level of each of `tests` independent tests that share `rate`."""
    return -math.expm1(math.log1p(-rate) / tests)


def welch(parts: list[tuple[float, float]]) -> float:
    """(Σ v)² / Σ (v² / ν): the degrees of freedom of a sum of variances v that have ν each (Welch 1947, Satterthwaite).

    Adding the ν instead would trust a noisy image of two batches as much as the reference that it is held against.
    """
    total, below = sum(v for v, _ in parts), sum(v * v / nu for v, nu in parts)
    return total * total / below if below > 0 else math.inf


def two_sided(z: np.ndarray | float, dof: np.ndarray | float) -> np.ndarray:
    """P(|T| >= z) for Student's t with `dof` degrees of freedom (the Gaussian where infinite)."""
    from scipy.special import ndtr, stdtr

    finite = np.isfinite(dof)
    return 2 * np.where(finite, stdtr(np.where(finite, dof, 1.0), -np.abs(z)), ndtr(-np.abs(z)))


def quantile(p: float, dof: np.ndarray | float) -> np.ndarray:
    """z with P(|T| >= z) = p, the inverse of `two_sided`."""
    from scipy.special import ndtri, stdtrit

    finite = np.isfinite(dof)
    return np.where(finite, -stdtrit(np.where(finite, dof, 1.0), p / 2), -ndtri(p / 2))


# ------------------------------------------------------------------------------------------------ what the noise is


class Side(NamedTuple):
    """One image's noise: its mean v, that of each 8 x 8 block, and sums over its fireflies, per channel (3,).

    `first` sums the fireflies' contributions to their pixels, `second` the squares.
    """

    mean: float
    blocks: np.ndarray
    first: np.ndarray
    second: np.ndarray

    @property
    def events(self) -> np.ndarray:
        """(3,) the effective number of fireflies: their count, where all are alike."""
        return np.divide(np.square(self.first), self.second, out=np.zeros(3), where=self.second > 0)


def survey(image: Image) -> Side | None:
    """The noise of one image, in one pass; None where it has none."""
    v = image.variance
    if v is None:
        return None
    blocks = []
    first, second = np.zeros(3), np.zeros(3)
    for y0, y1, rows in strips(len(v)):
        strip = v[y0:y1]
        count = block_sums(np.ones((y1 - y0, v.shape[1], 1), np.float32), rows)
        blocks.append((block_sums(strip, rows) / count).astype(np.float32))
        # (mean sqrt(v))^2 is typical of the block even when one value of it is huge.
        typical = FIREFLY * np.square(block_sums(np.sqrt(strip), rows) / count)
        bright = unblock(strip, rows) > np.repeat(typical.astype(np.float32), SIDE, axis=1)[:, None, : v.shape[1]]
        if bright.any():
            y, x, c = np.nonzero(bright.reshape(strip.shape))
            own, c = _fireflies(v, y + y0, x, c)
            # A single event of size S in n samples lifts the mean by S/n and makes its variance (S/n)^2.
            first += np.bincount(c, np.sqrt(own), 3)
            second += np.bincount(c, own, 3)
    return Side(float(v.mean(dtype=np.float64)), np.concatenate(blocks), first, second)


def _fireflies(v: np.ndarray, y: np.ndarray, x: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variance and channel of those values that stand alone: an edge is noisier than its block too, but not alone."""
    height, width = v.shape[:2]
    neighbours = np.zeros((8, len(y)), v.dtype)
    steps = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]
    for k, (dy, dx) in enumerate(steps):
        inside = (y + dy >= 0) & (y + dy < height) & (x + dx >= 0) & (x + dx < width)
        neighbours[k, inside] = v[y[inside] + dy, x[inside] + dx, c[inside]]
    own = v[y, x, c].astype(np.float64)
    alone = own > FIREFLY * np.partition(neighbours, -2, axis=0)[-2]
    return own[alone], c[alone]


class Allowance(NamedTuple):
    """The bias that is no failure, per channel (3,): `always`, and more for what may have missed all `fireflies`.

    `density` is the number of fireflies per pixel in the image that saw fewer.
    """

    always: float
    fireflies: np.ndarray
    density: np.ndarray

    def of(self, pixels: np.ndarray | int) -> np.ndarray:
        """For means over so many pixels, (..., 1) or one number, to (..., 3)."""
        return self.always + np.where(self.density * pixels < SURE, self.fireflies, 0.0)


def allowance(sides: list[Side], tolerance: Tolerance, pixels: int, share: float) -> Allowance:
    """An upper limit of the fireflies' mean, at confidence 1 - share: the larger of the two images'.

    For k events of one size the limit is that of a Poisson mean: (sqrt(k) + c / 2)^2 + 1, c the Gaussian's quantile.
    """
    from scipy.special import ndtri

    c = -float(ndtri(share))
    limits = []
    for s in sides:
        size = np.divide(s.second, s.first, out=np.zeros(3), where=s.first > 0)
        limits.append((s.first + c * np.sqrt(s.second) + (c * c / 4 + 1) * size) / pixels)
    events = np.array([s.events for s in sides])
    # Among many fireflies some have two neighbours of their kind, and pass for an edge.
    return Allowance(tolerance.p999_abs, 1.2 * np.max(limits, axis=0), events.min(axis=0) / pixels)


def variance_ratio(
    test: Image, reference: Image, a: Side | None, b: Side | None, least: float = 0.0
) -> tuple[float | None, float | None]:
    """(typical, largest) ratio of the test's variance to the reference's; None where one of the images has no noise.

    Typical is the median over pixels, or the samples' inverse ratio where too few have noise (more than `least`) in
    both; largest is that or the ratio of the means, which fireflies rule.
    """
    if a is None or b is None:
        return None, None
    step = max(1, math.isqrt(test.mean.size // 3 // 50_000))
    va, vb = (np.asarray(i.variance[::step, ::step], np.float64).ravel() for i in (test, reference))
    # Rounding makes a variance of its own, which has nothing to tell.
    both = (va > least) & (vb > least)
    typical = None
    if both.sum() >= 30:
        typical = float(np.median(va[both] / vb[both]))
    elif test.samples > 1 and reference.samples > 1:
        typical = reference.samples / test.samples
    largest = max(a.mean / b.mean if a.mean > 0 and b.mean > 0 else 0.0, typical or 0.0)
    # A ratio beyond a million compares a render with none: what one says of the other is nothing.
    return tuple(x if x and 1e-6 < x < 1e6 else None for x in (typical, largest))


def mutual(va: np.ndarray, vb: np.ndarray, ratio: float | None) -> np.ndarray:
    """The variance of t - r: each image's own, or what the other's says of it, whichever is larger."""
    if ratio is None:
        return va + vb
    ratio = va.dtype.type(ratio)
    va = np.maximum(va, ratio * vb)
    return va + np.maximum(vb, va / ratio)


def regularised(v: np.ndarray | None, side: Side | None, y0: int, y1: int, rows: int) -> np.ndarray:
    """Rows y0 to y1 of `v`: the largest of each 3 x 3 neighbourhood, but no less than the 8 x 8 block's mean."""
    if v is None or side is None:
        return np.zeros((), np.float32)
    out = dilate(v, y0, y1)
    blocks = side.blocks[y0 // SIDE : y0 // SIDE + (y1 - y0) // rows]
    in_blocks = unblock(out, rows)
    np.maximum(in_blocks, np.repeat(blocks, SIDE, axis=1)[:, None, : v.shape[1]], out=in_blocks)
    return out


# ------------------------------------------------------------------------------------------------------ the decision


def judge(test: Image, reference: Image, tolerance: Tolerance, rate: float) -> Noise:
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
            found = _detectable(s, sd, dof, granted, level)
            detectable = float(np.median(found)) if found.size else math.nan
    return Family(worst, level, failed, detectable)


def _image(grids: dict[str, np.ndarray], granted: Allowance, ratio: float | None, share: float, size) -> Family:
    s = {k: x.sum(axis=(0, 1)) for k, x in grids.items()}
    level = sidak(share, s["d"].size)
    z, sd, dof = _student(s, granted, ratio)
    p = two_sided(z, dof)
    c = int(z.argmax())
    worst = Worst(float(z[c]), float(p[c]), 0, 0, size[1], size[0], c, float(s["d"][c] / s["n"][0]))
    found = _detectable(s, sd, dof, granted, level)
    return Family(worst, level, int((p < level).sum()), float(found.max()) if found.size else math.nan)
