"""Is t - r more than noise? One decision at a stated false-alarm rate, from tests that share it.

    values   every value's (t - r) / sd                           sees a wrong pixel
    tiles    the mean of t - r over 8 x 8, 16 x 16, ... pixels    sees a wrong corner
    image    the mean of t - r over everything                    sees a wrong brightness
    shift    the translation between the two (shift.py)           sees a wrong camera

Each of the four gets the rate 1 - (1 - rate)^(1/4), and shares it among its own values by Sidak's formula. Tiles from
16 pixels on overlap by half their side: any square of 24 pixels holds a whole one of 16.

What a variance estimated from a few batches needs, so that the rate holds:

- Student's t in the place of the Gaussian. A value has the batches' degrees of freedom; a sum over pixels has
  (sum v)^2 / sum(v^2 / nu) - 1 (Welch, Satterthwaite), nu what is known of each pixel's variance (noise.doubt): 0 when
  a single firefly carries it.
- A value whose batches happened to agree looks surer than it is. Its variance is raised to its block's mean, and to
  what the other image's variance says of it.
- A pixel that missed a rare event (a firefly) is too dark by the events' mean, or too bright if they are dark, without
  a trace in its variance. The mean of the fireflies that were seen elsewhere is therefore granted to whatever may have
  missed them all, in units of radiance or of the light, whichever is more: often a few thousandths, where widening
  every variance by a firefly's would have blinded all tests. Where both images state their samples, a variance is never
  less than the samples' ratio says of the other's.
- Where events are too dense to be fireflies, a tile that saw few of them shows too little variance. It is raised to
  what is usual around it (_at_least_usual): then Poisson's lower tail is thinner than the Gaussian's, exp(-z²/2).
- Values with a standard deviation below a tenth of the tolerance hold no noise: they are compared as exact images are,
  where neither image is sampled, and at the background. In a sampled image samples that all agree prove little: n of
  them miss an event of probability p with exp(-n p). What they may have missed is granted to values, tiles and image,
  each for its own number of samples; a sample may be as far off as the image's scale.
- Neighbours that share samples (a filter wider than the pixel): the variance of every sum is inflated by what the
  images' difference shows (noise.inflation).
- A variance that the residuals do not bear out excuses nothing (noise.capped).

An event that *nobody* sampled cannot be distinguished from a bias.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Bool, Float32, Float64, Int
from raytwin.compare.blocks import SIDE, Counts, Means, Pixels, block_counts, block_sums, slide, strips
from raytwin.compare.exact import NoiseFree
from raytwin.compare.finding import MOST_PLACES, Place, blocks_of
from raytwin.compare.noise import (
    Missed,
    Side,
    degrees_of_freedom,
    doubt,
    inflation,
    larger_variance,
    missed,
    regularised,
    samples_behind,
    survey,
    variance_ratio,
)
from raytwin.compare.scale import Bound
from raytwin.compare.significance import quantile, sidak, two_sided, welch
from raytwin.image import Image

Sums = dict[str, Float64[np.ndarray, "..."]]
Size = tuple[int, ...]

TESTS = 4
"""Tests that share the false-alarm rate: values, tiles, image, shift."""

POWER = 0.9
"""The probability with which a minimum detectable bias is detected."""

SILENT = 0.1
"""Standard deviations below this share of the tolerance count as no noise."""

MOSTLY_FIREFLIES = 0.6
"""Fireflies are left out of sums where they carry this share of the variance.

Else most events may be too close together to be recognised: tiles that hold few would lose more than is granted.
"""

DIM = 0.1
"""Channels dimmer than this share of the channels' mean are left out of the detectable relative bias."""


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
    """Tests of one kind: the worst, the level that p-values must stay above, how many of how many fell below, where.

    `detectable`: the error that the family would have found, and `excluded`: what the data speak against.
    """

    worst: Worst
    level: float
    failed: int
    tests: int
    detectable: float = math.nan
    places: tuple[Place, ...] = ()
    excluded: float = math.nan

    @property
    def passed(self) -> bool:
        return self.worst.p >= self.level


class Decision(NamedTuple):
    """What the three tests of radiance found, and the values without noise; `failed_pixels` hold a failed value.

    `inflation`: of the variance of sums, because neighbours share samples.
    """

    value: Family
    tile: Family
    image: Family
    noise_free: NoiseFree
    failed_pixels: int
    inflation: float

    @property
    def passed(self) -> bool:
        return self.value.passed and self.tile.passed and self.image.passed


class Rounding(NamedTuple):
    """Rounding of the file formats: `value` (H, W, 3) at most; `mean`, the part that averaging over noise leaves."""

    value: Pixels
    mean: Pixels


class Allowance(NamedTuple):
    """The error that is allowed: the bound for noise-free values, and rare events that either image may have missed.

    `unseen`: 1 / samples per pixel of the image with noise that has fewer; 0 where no variance is proof of no noise.
    `look`: this look's share of the false-alarm rate, in a sequence of looks.
    """

    bound: Bound
    by_test: Missed
    by_reference: Missed
    unseen: float = 0.0
    look: float = 1.0

    def events_missed(self, level: float) -> float:
        """Return the expected number of events that samples which all agree may have missed, at this level.

        An event of probability p occurs n p times in n samples on average, and never with probability exp(-n p).
        For two images exp(-n p - m q) allows the largest p + q if the image with fewer samples missed all of it.
        What a later look has missed, the earlier looks missed too, so that all looks share one level.
        """
        return -math.log(level / self.look)

    def of(self, error: Means, pixels: Counts | int, radiance: Means, allowed: Means | None = None) -> Means:
        """Return the allowance for mean errors (..., 3): what the test missed if it is too dark, else the reference.

        `allowed`: the bound of that radiance, where it is known already.
        """
        granted = self.bound.of(radiance) if allowed is None else allowed
        if self.by_test.bias.any() or self.by_reference.bias.any():
            dark, bright = self.by_test.of(pixels, radiance)
            brighter, darker = self.by_reference.of(pixels, radiance)
            granted = granted + np.where(error < 0, dark + darker, bright + brighter).astype(granted.dtype)
        return np.asarray(granted)

    def upper(self, pixels: Counts | int, radiance: Means) -> Means:
        """The larger of the two directions."""
        dark, bright = (self.of(np.full_like(radiance, sign * 1e-30), pixels, radiance) for sign in (-1, 1))
        return np.asarray(np.maximum(dark, bright))


def decide(
    test: Image,
    reference: Image,
    bound: Bound,
    rate: float,
    rounding: Rounding | None = None,
    by_value: bool = True,
    look: float = 1.0,
) -> Decision:
    """Test values (if `by_value`), tiles and the mean of two finite images (H, W, 3), of which one or both are noisy.

    `look`: `rate` as a share of the false-alarm rate of the whole sequence of looks.
    """
    share = sidak(rate, TESTS)
    pair = _pair_of(test, reference, bound, share, rounding, look)
    noise_free, values, failed_pixels = NoiseFree(), Family(Worst(), pair.level, 0, test.mean.size), 0
    sums: list[Sums] = []
    without: list[Sums] = []
    for strip in pair.strips():
        noise_free = _exact_values(noise_free, strip)
        if by_value:
            values, failed = _noisy_values(values, strip, pair.dof)
            failed_pixels += failed
        sums.append(_block_sums(pair, strip))
        if pair.mostly:
            without.append(_block_sums_without_fireflies(pair, strip, sums[-1]))
    grids = _joined(sums)
    blocks = ((grids["va"] + grids["vb"]) / grids["n"]).astype(np.float32)
    shared = inflation(test.mean, reference.mean, blocks)
    estimators = [Estimator(grids, pair.allowance, pair.ratio, shared)]
    if pair.mostly:
        (_, a, _), (_, b, _) = pair.sides
        fewer = pair.allowance._replace(by_test=_without_fireflies(pair.allowance.by_test, a))
        fewer = fewer._replace(by_reference=_without_fireflies(pair.allowance.by_reference, b))
        estimators.append(Estimator(_joined(without), fewer, pair.ratio, shared))
    tile, image = (family(estimators, share, test.shape[:2]) for family in (_tiles, _image))
    return Decision(values, tile, image, noise_free, failed_pixels, shared)


NoisyImage = tuple[Image, Side | None, float]
"""An image, its noise, and the degrees of freedom of its variance."""


class Strip(NamedTuple):
    """Rows from `y0` on, in blocks of `rows`: t - r, r, and the variance of t - r, infinite where there is no noise.

    `allowed`: the bound of noise-free values; `granted`: what a single value may err by for other reasons, too;
    `silent`: values without noise; `calm`: those whose samples agree, and prove little; `event`: what one unseen event
    would have changed.
    """

    y0: int
    rows: int
    error: Float32[np.ndarray, "h w 3"]
    radiance: Float32[np.ndarray, "h w 3"]
    variance: Float32[np.ndarray, "h w 3"]
    allowed: Float32[np.ndarray, "h w 3"]
    granted: Float32[np.ndarray, "h w 3"]
    silent: Bool[np.ndarray, "h w 3"]
    calm: Bool[np.ndarray, "..."]
    event: Float32[np.ndarray, "..."]


class Pair(NamedTuple):
    """Two images and what is known of their noise before a value is tested; `level`: of each value's test.

    `mostly`: fireflies carry most of the variance; `proven`: where no variance means no noise; `unit`: of variances,
    so that their squares fit float32.
    """

    sides: tuple[NoisyImage, NoisyImage]
    rounding: Rounding | None
    allowance: Allowance
    ratio: float | None
    level: float
    dof: float
    mostly: bool
    proven: Bool[np.ndarray, "h w 1"]
    unit: np.float32

    def strips(self) -> Iterator[Strip]:
        (test, a, _), (reference, b, _) = self.sides
        bound, unseen = self.allowance.bound, self.allowance.unseen
        for y0, y1, rows in strips(test.shape):
            r = np.asarray(reference.mean[y0:y1], np.float32)
            d = np.subtract(test.mean[y0:y1], r, dtype=np.float32)
            va = regularised(test.variance, a, y0, y1, rows)
            vb = regularised(reference.variance, b, y0, y1, rows)
            allowed, v = bound.of(r), va + vb
            least = np.square(np.float32(SILENT) * allowed)
            silent = v <= least
            v = larger_variance(va, vb, self.ratio, v)
            rounded = np.float32(0) if self.rounding is None else self.rounding.value[y0:y1]
            granted = self.allowance.of(d, 1, r, allowed) + rounded
            calm, event = np.zeros((), bool), np.zeros((1, 1, 1), np.float32)
            if unseen:
                calm = _agreeing(test, reference, y0, y1, least) & ~self.proven[y0:y1]
                silent &= ~calm
                np.maximum(v, least, out=v, where=calm)
                event = np.where(calm, allowed / np.float32(bound.share), np.float32(0))
                granted = granted + np.float32(self.allowance.events_missed(self.level) * unseen) * event
            v[silent] = np.inf
            yield Strip(y0, rows, d, r, v, allowed, granted, silent, calm, event)


def _pair_of(test: Image, reference: Image, bound: Bound, share: float, rounding: Rounding | None, look: float) -> Pair:
    a, b = survey(test, reference.mean), survey(reference, test.mean)
    sides = (test, a, degrees_of_freedom(test)), (reference, b, degrees_of_freedom(reference))
    noisy = [s for s in (a, b) if s is not None]
    behind = (samples_behind(image, side, SILENT * bound.least) for image, side, _ in sides)
    unseen = max((1 / n for n in behind if n), default=0.0)
    seen = any(s.fireflies[0].size for s in noisy)
    light = reference.mean.mean(axis=(0, 1), dtype=np.float64) if seen else np.ones(3)
    missing = missed(a, b, (test.samples, reference.samples), math.prod(test.shape[:2]), share, light)
    carried, total = sum(float(s.second.sum()) for s in noisy), sum(s.mean for s in noisy)
    return Pair(
        sides,
        rounding,
        Allowance(bound, *missing, unseen, look),
        variance_ratio(test, reference, (SILENT * bound.least) ** 2),
        sidak(share, test.mean.size),
        welch([(s.mean, nu) for _, s, nu in sides if s is not None]),
        carried > MOSTLY_FIREFLIES * total * test.mean.size,
        _proven(reference, unseen),
        np.float32(max(total, 1e-30)),
    )


# ------------------------------------------------------------------------------------------------ values


def _exact_values(found: NoiseFree, strip: Strip) -> NoiseFree:
    """|t - r| <= bound, of each value without noise."""
    if not strip.silent.any():
        return found
    still = np.where(strip.silent, np.abs(strip.error), np.float32(0))
    count = int(np.count_nonzero(strip.silent))
    return found.plus(still, count, strip.allowed, strip.granted - strip.allowed, strip.y0)


def _noisy_values(found: Family, strip: Strip, dof: float) -> tuple[Family, int]:
    """z = max(|t - r| - granted, 0) / sqrt(v), Student's t, of each value; and how many pixels of the strip fail."""
    square = np.maximum(np.abs(strip.error) - strip.granted, 0)
    square *= square
    square /= strip.variance
    peak, threshold = int(square.argmax()), float(quantile(found.level, dof))
    z = math.sqrt(square.flat[peak])
    if z > found.worst.z:
        y, x, c = (int(i) for i in np.unravel_index(peak, square.shape))
        error = float(strip.error[y, x, c])
        found = found._replace(worst=Worst(z, float(two_sided(z, dof)), x, y + strip.y0, 1, 1, c, error))
    if not z > threshold:
        return found, 0
    failed = square > threshold**2
    pixels = np.asarray(failed.any(axis=-1))
    places = (*found.places, *blocks_of(pixels, strip.y0))[:MOST_PLACES]
    count = found.failed + int(np.count_nonzero(failed))
    return found._replace(failed=count, places=places), int(np.count_nonzero(pixels))


def _agreeing(
    test: Image, reference: Image, y0: int, y1: int, least: Float32[np.ndarray, "h w 3"]
) -> Bool[np.ndarray, "h w 3"]:
    """Whether all samples agree: a value's own variances, of both images, add up to a 16th of `least` at most."""
    parts = [i.variance[y0:y1] for i in (test, reference) if i.variance is not None]
    return np.asarray(sum(parts, np.zeros_like(least)) <= least / 16)


def _proven(reference: Image, unseen: float) -> Bool[np.ndarray, "h w 1"]:
    """Return (H, W, 1): where a variance of 0 proves no noise; in sampled images only well inside the background."""
    from scipy.ndimage import binary_dilation

    if not unseen:
        return np.ones((*reference.shape[:2], 1), bool)
    if reference.surface is None:
        return np.zeros((*reference.shape[:2], 1), bool)
    return np.asarray(~binary_dilation(reference.surface.mask, np.ones((3, 3), bool))[..., None])


# ------------------------------------------------------------------------------------------------ sums


def _block_sums(pair: Pair, strip: Strip, out: Bool[np.ndarray, "h w 3"] | None = None) -> Sums:
    """Σ(t - r), Σr, n, Σv of both images, Σv²/ν, Σrounding over blocks of 8 x 8: what z of any tile is made from.

        z = max(|Σ(t - r)| / n - granted, 0) / (sqrt(Σva + Σvb) / n),  ν = (Σva + Σvb)² / Σ(v²/ν) - 1

    `out`: values that are left out, by default those without noise. Where fireflies carry most of the variance, each is
    one event, with one degree of freedom.
    """
    out = strip.silent if out is None else out
    y0, y1, some_out = strip.y0, strip.y0 + len(strip.error), bool(out.any())
    d = np.where(out, np.float32(0), strip.error) if some_out else strip.error
    found: Sums = {"d": block_sums(d, strip.rows), "r": block_sums(strip.radiance, strip.rows)}
    found["n"], none = block_counts(d, strip.rows), np.zeros_like(found["d"])
    found["vv"] = none
    for key, (image, side, nu) in zip(("va", "vb"), pair.sides, strict=True):
        if side is None or image.variance is None:
            found[key] = none
            continue
        v = np.where(out, np.float32(0), image.variance[y0:y1]) if some_out else image.variance[y0:y1]
        found[key] = block_sums(v, strip.rows)
        vv = doubt(v, image.mean[y0:y1], nu)
        if pair.mostly:
            vv[_within(side, y0, y1)] = 1
        v = v / pair.unit
        vv *= v
        vv *= v
        found["vv"] = found["vv"] + block_sums(vv, strip.rows) * float(pair.unit) ** 2
    found["round"] = none if pair.rounding is None else block_sums(pair.rounding.mean[y0:y1], strip.rows)
    if pair.allowance.unseen:
        found["calm"] = block_sums(strip.calm.astype(np.float32), strip.rows)
        found["size"] = block_sums(strip.event, strip.rows)
    return found


def _joined(strips_sums: list[Sums]) -> Sums:
    return {key: np.concatenate([sums[key] for sums in strips_sums]) for key in strips_sums[0]}


# ------------------------------------------------------------------------------------------------ without fireflies


def _block_sums_without_fireflies(pair: Pair, strip: Strip, whole: Sums) -> Sums:
    """The same sums over the values that are no firefly of either image; `whole`: those over all."""
    ends = strip.y0, strip.y0 + len(strip.error)
    places = [_within(side, *ends) for _, side, _ in pair.sides if side is not None]
    if not any(y.size for y, _, _ in places):
        return whole
    out = strip.silent.copy()
    for place in places:
        out[place] = True
    return _block_sums(pair, strip, out)


def _without_fireflies(missing: Missed, side: Side | None) -> Missed:
    """What is granted where a side's fireflies, if it has any, are left out."""
    return missing.always if side is not None and side.fireflies[0].size else missing


def _within(side: Side, y0: int, y1: int) -> tuple[Int[np.ndarray, " n"], ...]:
    """The fireflies in rows y0 to y1, as places within them."""
    y, x, c = side.fireflies
    inside = (y >= y0) & (y < y1)
    return y[inside] - y0, x[inside], c[inside]


# ------------------------------------------------------------------------------------------------ tiles and the image


class Estimator(NamedTuple):
    """One way to test sums: the sums, what they may err by, the ratio of variances, and their inflation."""

    sums: Sums
    allowance: Allowance
    ratio: float | None
    inflation: float


class _Tested(NamedTuple):
    """|mean error| beyond the allowance, in standard deviations, for sums (..., 3), and what it was computed from.

    `always`: granted whatever the level; `event`: by how much one event that all samples missed would have changed it.
    """

    z: Means
    sd: Means
    dof: Means
    granted: Means
    radiance: Means
    error: Means
    always: Means
    event: Means


def _student(estimators: list[Estimator], level: float, apart: int = 0) -> _Tested:
    """For each sum take the more sensitive estimator: with its fireflies, or without them, allowing for their mean.

    `apart`: steps from a tile to the next that shares no pixel with it; 0 where there is none.
    """
    made = [_estimate(estimator, level, apart) for estimator in estimators]
    if len(made) == 1:
        return made[0]
    least = [t.granted + t.sd * quantile(level, t.dof) for t in made]
    return _Tested(*(np.where(least[1] < least[0], y, x) for x, y in zip(*made, strict=True)))


def _at_least_usual(variance: Means, s: Sums, apart: int) -> Means:
    """Return the tiles' variances, none less than the third least of it and its 8 neighbours, in units of their light.

    A tile that saw none of a few rare events claims too little. Edges and quiet places rarely fill seven of nine tiles.
    """
    from scipy.ndimage import rank_filter

    light = np.square(s["r"]) / s["n"]
    relative = np.divide(variance, light, out=np.zeros_like(variance), where=light > 0)
    places = np.zeros((2 * apart + 1, 2 * apart + 1, 1), bool)
    places[::apart, ::apart] = True
    usual = rank_filter(relative, 2, footprint=places, mode="nearest") * light
    return np.asarray(np.where(variance > 0, np.maximum(variance, usual), variance))


def _estimate(estimator: Estimator, level: float, apart: int = 0) -> _Tested:
    s, shared = estimator.sums, estimator.inflation
    v = s["va"] + s["vb"]
    dof = np.divide(np.square(v), s["vv"], out=np.zeros_like(v), where=s["vv"] > 0) / shared - 1
    dof = np.maximum(dof, 0.5)
    variance = larger_variance(s["va"], s["vb"], estimator.ratio)
    if apart:
        variance = _at_least_usual(variance, s, apart)
    sd = np.sqrt(variance * shared) / s["n"]
    floor = 1e-3 * estimator.allowance.bound.least  # where all is calm: no division by 0
    sd, dof = np.maximum(sd, floor), np.where(sd > floor, dof, np.inf)
    allowance, error, radiance = estimator.allowance, s["d"] / s["n"], s["r"] / s["n"]
    event = np.zeros_like(sd)
    if allowance.unseen:
        np.divide(allowance.unseen * s["size"], s["calm"] * s["n"], out=event, where=s["calm"] > 0)
    missing = allowance.events_missed(level) * event
    rounded = s["round"] / s["n"]
    beyond = np.maximum(np.abs(error) - allowance.of(error, s["n"], radiance) - rounded - missing, 0)
    z = np.divide(beyond, sd, out=np.zeros_like(sd), where=sd > 0)
    always = allowance.upper(s["n"], radiance) + rounded
    z = np.nan_to_num(z, nan=np.inf, posinf=np.inf)
    return _Tested(z, sd, dof, always + missing, radiance, error, always, event)


def _tiles(estimators: list[Estimator], share: float, size: Size) -> Family:
    """Tiles of 8, 16, 32, ... pixels, up to half of the image's longer side; `detectable` is for 24 x 24, anywhere."""
    height, width = size
    scales = [(SIDE, SIDE, estimators)]
    while 4 * scales[-1][0] <= max(height, width):
        side, step, finer = scales[-1]
        apart = side // step
        coarser = [w._replace(sums={k: slide(x[::apart, ::apart]) for k, x in w.sums.items()}) for w in finer]
        scales.append((2 * side, side, coarser))
    tests = sum(w[0].sums["d"].size for _, _, w in scales)
    level = sidak(share, tests)
    doubtful = float(quantile(level, math.inf))
    worst, failed, detectable = Worst(width=SIDE, height=SIDE), 0, math.nan
    found: list[Place] = []
    for k, (side, step, here) in enumerate(scales):
        t = _student(here, level, side // step)
        # Student's tails are wider than the Gaussian's: only what a Gaussian would doubt needs them.
        unsure = t.z >= min(doubtful, float(t.z.max()))
        p = np.ones_like(t.z)
        p[unsure] = two_sided(t.z[unsure], t.dof[unsure])
        failed += int(np.count_nonzero(p < level))
        for y, x in np.argwhere((p < level).any(axis=-1))[: MOST_PLACES - len(found)].tolist():
            place = Place(x * step, y * step, min(side, width - x * step), min(side, height - y * step))
            if not any(_holds(place, finer) for finer in found):
                found.append(place)
        least = np.flatnonzero(p == p.min())
        i = int(least[t.z.flat[least].argmax()])
        if (p.flat[i], -t.z.flat[i]) < (worst.p, -worst.z):
            y, x, c = (int(j) for j in np.unravel_index(i, p.shape))
            w, h = min(side, width - x * step), min(side, height - y * step)
            worst = Worst(float(t.z.flat[i]), float(p.flat[i]), x * step, y * step, w, h, c, float(t.error.flat[i]))
        if k == min(1, len(scales) - 1):
            detectable = _seen_somewhere(t, level)
    return Family(worst, level, failed, tests, detectable, tuple(found))


def _holds(outer: Place, inner: Place) -> bool:
    return (
        outer.x <= inner.x
        and outer.y <= inner.y
        and outer.x + outer.width >= inner.x + inner.width
        and outer.y + outer.height >= inner.y + inner.height
    )


def _seen_somewhere(t: _Tested, level: float) -> float:
    """Return the relative error of the mean of a random tile that is found with probability POWER."""
    from scipy.optimize import brentq
    from scipy.special import ndtr

    lit = t.radiance > 0
    pick = slice(None, None, max(1, int(lit.sum()) // 3000))
    radiance, sd, granted = (x[lit][pick] for x in (t.radiance, t.sd, t.granted))
    if not radiance.size:
        return math.nan
    least = quantile(level, t.dof[lit][pick])

    def power(log_bias: float) -> float:
        beyond = math.exp(log_bias) * radiance - granted
        z = np.divide(beyond, sd, out=np.where(beyond > 0, np.inf, -np.inf), where=sd > 0)
        return float(ndtr(z - least).mean())

    low, high = math.log(1e-9), math.log(1e9)
    if power(high) < POWER:
        return math.inf
    return math.exp(brentq(lambda x: power(x) - POWER, low, high, xtol=1e-3)) if power(low) < POWER else 0.0


def _image(estimators: list[Estimator], share: float, size: Size) -> Family:
    """The mean over everything; `detectable`: relative to its mean, in the worst channel that is not DIM."""
    from scipy.special import ndtri

    level = sidak(share, 3)
    t = _student([w._replace(sums={k: x.sum(axis=(0, 1)) for k, x in w.sums.items()}) for w in estimators], level)
    p = two_sided(t.z, t.dof)
    c = int(t.z.argmax())
    worst = Worst(float(t.z[c]), float(p[c]), 0, 0, size[1], size[0], c, float(t.error[c]))
    least = t.granted + t.sd * (quantile(level, t.dof) + ndtri(POWER))
    lit = t.radiance > DIM * t.radiance.mean()
    if not lit.any():
        return Family(worst, level, int((p < level).sum()), 3)
    detectable, excluded = (float((x / t.radiance)[lit].max()) for x in (least, _excluded(t)))
    return Family(worst, level, int((p < level).sum()), 3, detectable, excluded=excluded)


def _excluded(t: _Tested) -> Means:
    """Return the smallest bias b of means that the data rule out by a likelihood ratio of 1 / (1 - POWER).

    The likelihood ratio of b, of which M events hide M t.event, and of none is exp(-M - (b' |e| - b'² / 2) / sd²) with
    b' = b - M t.event (Wald 1945): a correct mean excludes b with a third of the samples that a test of a fixed number
    needs to find it. At every look anew, an image with the bias b passes with 1 - POWER at most.
    """
    most = -math.log(1 - POWER)
    e, sd = np.abs(t.error), t.sd * quantile(2 * (1 - POWER), t.dof) / quantile(2 * (1 - POWER), math.inf)
    v = np.square(sd)
    # The largest b over all M: b' - |e| = sd² / t.event, where M is neither 0 nor all of the ratio.
    apart = np.divide(v, t.event, out=np.full_like(v, np.inf), where=t.event > 0)
    apart = np.clip(apart, e, np.sqrt(np.square(e) + 2 * v * most))
    hidden = most - np.divide(np.square(apart) - np.square(e), 2 * v, out=np.zeros_like(v), where=v > 0)
    return np.asarray(t.always + e + apart + hidden * t.event)
