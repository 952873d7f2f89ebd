"""Is t - r more than noise? One decision at a stated false-alarm rate, from tests that share it.

    values   every value's (t - r) / sd                           sees a wrong pixel
    tiles    the mean of t - r over 8 x 8, 16 x 16, ... pixels    sees a wrong corner
    image    the mean of t - r over everything                    sees a wrong brightness
    shift    the translation between the two (shift.py)           sees a wrong camera

Each of the four gets the rate 1 - (1 - rate)^(1/4), and shares it among its own values by Sidak's formula. Tiles from
16 pixels on overlap by half their side: any square of 24 pixels holds a whole one of 16.

What a variance estimated from a few batches needs, so that the rate holds:

- Student's t in the place of the Gaussian. A value has the batches' degrees of freedom; a sum over pixels has
  (sum v)^2 / sum(v^2 / nu) - 1 (Welch, Satterthwaite).
- The third moment beside the variance: noise that is skewed against the error makes a sum look surer than it is
  (significance.less_skewed, after Johnson 1978).
- A value whose batches happened to agree looks surer than it is. Its variance is raised to its block's mean, and to
  what the other image's variance says of it, by the samples' ratio.
- A sum that expects few events may have missed them all, without a trace in its variance. How many it expects, and how
  much light they are, its neighbours tell, or all blocks (rare_events). A sum that shows their variance saw them.
- Beside an image without noise nothing tells of events that no sample of the whole image met: few samples leave such
  an error undecided (lacking_light).
- Where fireflies carry most of the variance and fall everywhere alike, sums are tested without them, too, and their
  mean is granted.
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

from raytwin.array_types import Bool, Float32, Float64
from raytwin.compare.blocks import SIDE, Blocks, Means, Pixels, block_counts, block_sums, slide, strips
from raytwin.compare.exact import NoiseFree
from raytwin.compare.finding import MOST_PLACES, Place, blocks_of
from raytwin.compare.noise import (
    TINY,
    block_means,
    degrees_of_freedom,
    fireflies,
    inflation,
    larger_variance,
    regularised,
    samples_behind,
    variance_ratio,
)
from raytwin.compare.scale import Bound
from raytwin.compare.significance import as_skewed, less_skewed, quantile, sidak, two_sided, welch
from raytwin.images.image import Image

Sums = dict[str, Float64[np.ndarray, "..."]]
Size = tuple[int, ...]
Scales = tuple[float, float]
"""What the reference's third moment is multiplied with to be the test's, and the other way; 0 where it is not known."""

Lacking = tuple[float, float]
"""Shares of the light that the test, and the reference, may lack, since no sample met a rare event."""

TESTS = 4
"""Tests that share the false-alarm rate: values, tiles, image, shift."""

POWER = 0.9
"""The probability with which a minimum detectable bias is detected."""

SILENT_SHARE = 0.1
"""Standard deviations below this share of the tolerance count as no noise."""

MOSTLY_FIREFLIES = 0.6
"""Fireflies are left out of sums where they carry this share of the variance.

Else most events may be too close together to be recognised: tiles that hold few would lose more than is granted.
"""

FEWEST_FIREFLIES = 50
"""Fireflies of an image that show whether they fall everywhere alike."""

DIM_SHARE = 0.1
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

    `sure`: how many of them not even events that no sample met explain. `detectable`: the error that the family would
    have found, and `excluded`: what the data speak against.
    """

    worst: Worst
    level: float
    failed: int
    tests: int
    detectable: float = math.nan
    places: tuple[Place, ...] = ()
    excluded: float = math.nan
    sure: int = 0

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
    def excusable(self) -> bool:
        """Whether events that no sample met may explain all that noise does not."""
        return not (self.value.sure or self.tile.sure or self.image.sure)

    @property
    def passed(self) -> bool:
        return self.value.passed and self.tile.passed and self.image.passed


class Rounding(NamedTuple):
    """Rounding of the file formats: `value` (H, W, 3) at most; `mean`, the part that averaging over noise leaves."""

    value: Pixels
    mean: Pixels


class Unseen(NamedTuple):
    """What samples that all agree may have missed: `share`: 1 / samples per pixel of the image with fewer, 0
    where no variance is proof of no noise. `look`: this look's share of the false-alarm rate.
    """

    share: float = 0.0
    look: float = 1.0

    def events(self, level: float) -> float:
        """Return the expected number of events that samples which all agree may have missed, at this level.

        An event of probability p occurs n p times in n samples on average, and never with probability exp(-n p).
        For two images exp(-n p - m q) allows the largest p + q if the image with fewer samples missed all of it.
        What a later look has missed, the earlier looks missed too, so that all looks share one level.
        """
        return -math.log(level / self.look)


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
    strips = list(pair.strips())
    grids = _all_block_sums(pair, strips, [strip.silent for strip in strips])
    grids |= rare_events(grids, pair.ratio, pair.scales, share)
    rare = any(grids[f"wide {way}"].any() for way in WAYS)
    without = _without_fireflies(pair, strips, share) if rare else None
    for strip in strips:
        noise_free = _exact_values(noise_free, strip)
        if by_value:
            values, failed = _noisy_values(values, strip, grids, pair.dof, pair.lacking)
            failed_pixels += failed
    blocks = ((grids["va"] + grids["vb"]) / grids["n"]).astype(np.float32)
    shared = inflation(test.mean, reference.mean, blocks)
    estimators = [
        Estimator(sums, bound, pair.unseen, pair.lacking, pair.ratio, pair.scales, shared)
        for sums in (grids, without)
        if sums is not None
    ]
    tile, image = (family(estimators, share, test.shape[:2]) for family in (_tiles, _image))
    return Decision(values, tile, image, noise_free, failed_pixels, shared)


NoisyImage = tuple[Image, Blocks | None, float]
"""An image, the mean variance of its blocks, and the degrees of freedom of its variance."""


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

    `proven`: where no variance means no noise; `unit`: of variances, so that their squares fit float32.
    """

    sides: tuple[NoisyImage, NoisyImage]
    rounding: Rounding | None
    bound: Bound
    unseen: Unseen
    ratio: float | None
    level: float
    dof: float
    proven: Bool[np.ndarray, "h w 1"]
    unit: np.float32
    lacking: Lacking
    scales: Scales

    def strips(self) -> Iterator[Strip]:
        (test, a, _), (reference, b, _) = self.sides
        bound, unseen = self.bound, self.unseen
        for y0, y1, rows in strips(test.shape):
            r = np.asarray(reference.mean[y0:y1], np.float32)
            d = np.subtract(test.mean[y0:y1], r, dtype=np.float32)
            va = regularised(test.variance, a, y0, y1, rows)
            vb = regularised(reference.variance, b, y0, y1, rows)
            allowed, v = bound.of(r), va + vb
            least = np.square(np.float32(SILENT_SHARE) * allowed)
            silent = v <= least
            v = larger_variance(va, vb, self.ratio, v)
            granted = allowed if self.rounding is None else allowed + self.rounding.value[y0:y1]
            calm, event = np.zeros((), bool), np.zeros((1, 1, 1), np.float32)
            if unseen.share:
                calm = _agreeing(test, reference, y0, y1, least) & ~self.proven[y0:y1]
                silent &= ~calm
                np.maximum(v, least, out=v, where=calm)
                event = np.where(calm, allowed / np.float32(bound.share), np.float32(0))
                granted = granted + np.float32(unseen.events(self.level) * unseen.share) * event
            v[silent] = np.inf
            yield Strip(y0, rows, d, r, v, allowed, granted, silent, calm, event)


def _pair_of(test: Image, reference: Image, bound: Bound, share: float, rounding: Rounding | None, look: float) -> Pair:
    sides = tuple((i, None if i.variance is None else block_means(i.variance).astype(np.float32), degrees_of_freedom(i))
                  for i in (test, reference))  # fmt: skip
    noisy = [(float(blocks.mean()), nu) for _, blocks, nu in sides if blocks is not None]
    behind = (samples_behind(image, blocks, SILENT_SHARE * bound.least) for image, blocks, _ in sides)
    unseen = max((1 / n for n in behind if n), default=0.0)
    ratio = variance_ratio(test, reference, (SILENT_SHARE * bound.least) ** 2)
    return Pair(
        sides,  # type: ignore[arg-type]
        rounding,
        bound,
        Unseen(unseen, look),
        ratio,
        sidak(share, test.mean.size),
        welch(noisy),
        _proven(reference, unseen),
        np.float32(max(sum(v for v, _ in noisy), 1e-30)),
        lacking_light(test, reference, share, look),
        (
            0.0 if ratio is None or reference.third is None else ratio**2,
            0.0 if ratio is None or test.third is None else ratio**-2,
        ),
    )


BRIGHTEST = 600.0
"""Times the light: events that are brighter are not thought of."""

FEWEST_TOLD = 3
"""Samples or renders: two batches are those of a variance that was estimated, of however many samples."""

ENOUGH_SAMPLES = 80_000
"""Samples of the whole image: of events that are no rarer than one in 10 000 they have met some, but for exp(-8)."""

ENOUGH_AT_ONCE = 30_000
"""The same for a comparison made once: the looks of a sequence meet the least lucky of all numbers of samples."""


def enough_samples(look: float) -> int:
    """Samples of the whole image from which on no error is laid to events that none of them met."""
    return ENOUGH_SAMPLES if look < 1 else ENOUGH_AT_ONCE


def excusable(error: Means, radiance: Means, lacking: Lacking) -> Bool[np.ndarray, "..."]:
    """Whether events that no sample met may explain the error."""
    return np.asarray(np.abs(error) < np.where(error < 0, lacking[0], lacking[1]) * np.abs(radiance))


def lacking_light(test: Image, reference: Image, share: float, look: float) -> Lacking:
    """The share of its light that the test, or the reference, may lack because no pixel's sample met an event.

    Beside an image without noise nothing tells of such events. -ln(share) of them are missed by all samples with the
    probability `share`.
    """
    if (test.variance is None) == (reference.variance is None):
        return 0.0, 0.0
    noisy = reference if test.variance is None else test
    each = noisy.samples if noisy.samples > 1 else noisy.batches or 0
    samples = math.prod(noisy.shape[:2]) * each
    told = each >= FEWEST_TOLD
    lacking = BRIGHTEST * -math.log(share) / samples if told and samples < enough_samples(look) else 0.0
    return (0.0, lacking) if test.variance is None else (lacking, 0.0)


# ------------------------------------------------------------------------------------------------ values


def _exact_values(found: NoiseFree, strip: Strip) -> NoiseFree:
    """|t - r| <= bound, of each value without noise."""
    if not strip.silent.any():
        return found
    still = np.where(strip.silent, np.abs(strip.error), np.float32(0))
    count = int(np.count_nonzero(strip.silent))
    return found.plus(still, count, strip.allowed, strip.granted - strip.allowed, strip.y0)


def _noisy_values(found: Family, strip: Strip, grids: Sums, dof: float, lacking: Lacking) -> tuple[Family, int]:
    """z = max(|t - r| - granted, 0) / sqrt(v), Student's t, of each value; and how many pixels of the strip fail."""
    rows = slice(strip.y0 // SIDE, strip.y0 // SIDE + len(strip.error) // strip.rows)
    lent = [grids[f"lent {way}"][rows] / grids["n"][rows] for way in WAYS]
    square, variance = np.abs(strip.error) - strip.granted, strip.variance
    if any(x.any() for x in lent):
        dark, bright = (to_rows(x, strip) for x in lent)
        square -= np.where(strip.error < 0, dark, bright)
        dark, bright = (to_rows(grids[f"wide {way}"][rows], strip) for way in WAYS)
        variance = np.maximum(variance, np.where(strip.error < 0, dark, bright))
    square = np.maximum(square, 0)
    square *= square
    square /= variance
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
    sure = found.sure + int(np.count_nonzero(failed & ~excusable(strip.error, strip.radiance, lacking)))
    return found._replace(failed=count, sure=sure, places=places), int(np.count_nonzero(pixels))


def to_rows(blocks: Blocks, strip: Strip) -> Float32[np.ndarray, "h w 3"]:
    return np.repeat(np.repeat(blocks.astype(np.float32), strip.rows, axis=0), SIDE, axis=1)[:, : strip.error.shape[1]]


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

WAYS = "dark", "bright"


def _all_block_sums(pair: Pair, strips: list[Strip], left_out: list[Bool[np.ndarray, "h w 3"]]) -> Sums:
    """The sums of all strips, one below the other."""
    found = [_block_sums(pair, strip, out) for strip, out in zip(strips, left_out, strict=True)]
    return {key: np.concatenate([sums[key] for sums in found]) for key in found[0]}


def _block_sums(pair: Pair, strip: Strip, out: Bool[np.ndarray, "h w 3"]) -> Sums:
    """Σ(t - r), Σr, n, Σv of both images, Σv²/ν, Σκ, Σrounding over blocks of 8 x 8: what z of any tile is made from.

        z = max(|Σ(t - r)| / n - granted, 0) / (sqrt(Σva + Σvb) / n),  ν = (Σva + Σvb)² / Σ(v²/ν) - 1

    κ is the third moment. Where it is not known, it is the covariance of v and t - r: a mean and its own variance share
    just that. `out`: values that are left out, those without noise among them.
    """
    y0, y1, some_out = strip.y0, strip.y0 + len(strip.error), bool(out.any())

    def kept(values: Pixels) -> Pixels:
        return np.where(out, np.float32(0), values) if some_out else values

    d = kept(strip.error)
    found: Sums = {"d": block_sums(d, strip.rows), "r": block_sums(strip.radiance, strip.rows)}
    found["n"], none = block_counts(d, strip.rows), np.zeros_like(found["d"])
    found["vv"] = none
    for key, sign, (image, _, nu) in zip("ab", (1, -1), pair.sides, strict=True):
        if image.variance is None:
            found[f"v{key}"] = found[f"k{key}"] = none
            continue
        v = kept(image.variance[y0:y1])
        found[f"v{key}"] = block_sums(v, strip.rows)
        if image.third is not None:
            found[f"k{key}"] = block_sums(kept(image.third[y0:y1]), strip.rows)
        else:
            together = block_sums(v * d, strip.rows) - found["d"] * found[f"v{key}"] / found["n"]
            found[f"k{key}"] = sign * together
        vv = np.square(v / pair.unit)
        found["vv"] = found["vv"] + block_sums(vv, strip.rows) * (float(pair.unit) ** 2 / nu)
    found["round"] = none if pair.rounding is None else block_sums(pair.rounding.mean[y0:y1], strip.rows)
    if pair.unseen.share:
        found["calm"] = block_sums(strip.calm.astype(np.float32), strip.rows)
        found["size"] = block_sums(strip.event, strip.rows)
    return found


def third_against(s: Sums, scales: Scales) -> tuple[Means, Means]:
    """The third moments of sums of t - r that make them look too dark, and too bright, where events were missed.

    What one image has seen of them, the other must have, by its number of samples.
    """
    up, down, other_up, other_down = (np.maximum(x, 0) for x in (s["ka"], -s["ka"], s["kb"], -s["kb"]))
    to_test, to_reference = scales
    up_both, down_both = np.maximum(up, to_test * other_up), np.maximum(down, to_test * other_down)
    other_up, other_down = np.maximum(other_up, to_reference * up), np.maximum(other_down, to_reference * down)
    return up_both + other_down, down_both + other_up


FEW_EVENTS, RARE_EVENTS = 20.0, 60.0
"""A sum that expects fewer events may have missed them all; a block that saw fewer tells of its neighbours' events."""


def rare_events(s: Sums, ratio: float | None, scales: Scales, share: float) -> Sums:
    """What blocks may have missed of few events: their light, variance and number, and how far a value may be off.

    k events of size S make the light k S, the variance k S² and the third moment k S³. A block lacks what its
    neighbours saw on average, or all blocks: at most (sqrt(k) + c / 2)² + 1 of k, c the Gaussian's quantile.
    """
    from scipy.ndimage import maximum_filter, uniform_filter
    from scipy.special import ndtri

    variance, n, c = larger_variance(s["va"], s["vb"], ratio), s["n"], -float(ndtri(share))
    lit = s["r"] / n
    lit = np.maximum(lit / np.maximum(lit.mean(axis=(0, 1)), TINY), 1)  # where there is more light there may be more
    found: Sums = {}
    for way, third in zip(WAYS, third_against(s, scales), strict=True):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            number = np.where(third > 0, variance**3 / np.square(third), np.inf)
            rare = number < RARE_EVENTS
            light = np.where(rare, variance * variance / third, 0)
        number, spread = np.where(rare, number, 0), np.where(rare, variance, 0)
        k = number.sum(axis=(0, 1))
        most = np.divide((np.sqrt(k) + c / 2) ** 2 + 1, k, out=np.zeros_like(k), where=k > 0)
        for what, seen, factor in (("lent", light, lit), ("spread", spread, lit * lit), ("number", number, 1.0)):
            everywhere = n * (most * seen.sum(axis=(0, 1)) / n.sum())
            found[f"{what} {way}"] = np.maximum(uniform_filter(seen, (3, 3, 1), mode="nearest"), everywhere * factor)
        found[f"wide {way}"] = maximum_filter(spread / n, (3, 3, 1))
    return found


# ------------------------------------------------------------------------------------------------ without fireflies


def _without_fireflies(pair: Pair, strips: list[Strip], share: float) -> Sums | None:
    """The sums over the values that are no firefly of either image, if fireflies carry most of the variance; else None.

    What is left is too dark by the fireflies' mean, or too bright if they are dark, which is granted: for k of one size
    the upper limit of a Poisson mean, (sqrt(k) + q / 2)² + 1, q the Gaussian's quantile; with more light, more.
    """
    from scipy.special import ndtri

    carried, total, masks = 0.0, 0.0, []
    first, second = np.zeros((2, 3)), np.zeros((2, 3))  # of those that are brighter than the other image, and darker
    for strip in strips:
        out = strip.silent.copy()
        for sign, (image, _, _) in zip((1, -1), pair.sides, strict=True):
            if image.variance is None:
                continue
            v = image.variance[strip.y0 : strip.y0 + len(out)]
            total += float(v.sum(dtype=np.float64))
            y, x, c = np.nonzero(fireflies(v, strip.rows))
            out[y, x, c] = True
            own = v[y, x, c].astype(np.float64)
            carried += float(own.sum())
            kind = c + 3 * (sign * strip.error[y, x, c] < 0)
            # A single event of size S in n samples lifts the mean by S/n and makes its variance (S/n)^2.
            first += np.bincount(kind, np.sqrt(own), 6).reshape(2, 3)
            second += np.bincount(kind, own, 6).reshape(2, 3)
        masks.append(out)
    if not carried > MOSTLY_FIREFLIES * total or not _scattered(strips, masks):
        return None
    sums = _all_block_sums(pair, strips, masks)
    q = -float(ndtri(share))
    size = np.divide(second, first, out=np.zeros((2, 3)), where=first > 0)
    # Some of them have hidden among others.
    most = 1.2 * (first + q * np.sqrt(second) + (q * q / 4 + 1) * size) / sums["n"].sum()
    light = np.maximum(sums["r"].sum(axis=(0, 1)) / sums["n"].sum(), TINY)
    (bright, dark), more = most, np.maximum(sums["r"] / light, sums["n"])
    tested, referred = (image.variance is not None for image, _, _ in pair.sides)
    sums |= {"lent dark": more * (tested * bright + referred * dark)}
    sums |= {"lent bright": more * (tested * dark + referred * bright)}
    none = np.zeros_like(sums["d"])
    return sums | {f"{what} {way}": none for what in ("spread", "number") for way in WAYS}


# ------------------------------------------------------------------------------------------------ tiles and the image


def _scattered(strips: list[Strip], fireflies: list[Bool[np.ndarray, "h w 3"]]) -> bool:
    """Whether fireflies are enough to tell that they fall anywhere alike, and so few that none hides among others.

    Poisson numbers have the variance of their mean, within sqrt(2 / blocks).
    """
    counts = np.concatenate(
        [
            block_sums((out & ~strip.silent).astype(np.float32), strip.rows).max(axis=-1)
            for strip, out in zip(strips, fireflies, strict=True)
        ]
    )
    pixels, mean = sum(strip.error[..., 0].size for strip in strips), float(counts.mean())
    alike = float(counts.var()) < mean * (1 + 3 * math.sqrt(2 / counts.size))
    return bool(alike and FEWEST_FIREFLIES <= counts.sum() < pixels / 10)


class Estimator(NamedTuple):
    """The sums, what they may err by, the ratio of variances, and their inflation."""

    sums: Sums
    bound: Bound
    unseen: Unseen
    lacking: Lacking
    ratio: float | None
    scales: Scales
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
    skewness: Means


def _estimate(estimator: Estimator, level: float) -> _Tested:
    s, shared = estimator.sums, estimator.inflation
    v = s["va"] + s["vb"]
    dof = np.divide(np.square(v), s["vv"], out=np.full_like(v, np.inf), where=s["vv"] > 0) / shared - 1
    dof = np.maximum(dof, 0.5)
    variance = larger_variance(s["va"], s["vb"], estimator.ratio)
    third = third_against(s, estimator.scales)
    sd = np.sqrt(variance * shared) / s["n"]
    floor = 1e-3 * estimator.bound.least  # where all is calm: no division by 0
    sd, dof = np.maximum(sd, floor), np.where(sd > floor, dof, np.inf)
    error, radiance = s["d"] / s["n"], s["r"] / s["n"]
    event = np.zeros_like(sd)
    if estimator.unseen.share:
        np.divide(estimator.unseen.share * s["size"], s["calm"] * s["n"], out=event, where=s["calm"] > 0)
    missing = estimator.unseen.events(level) * event
    dark, bright = (_missed(s, way, variance) / s["n"] for way in WAYS)
    always = estimator.bound.of(radiance) + s["round"] / s["n"]
    granted = always + np.where(error < 0, dark, bright)
    with np.errstate(divide="ignore", invalid="ignore"):
        skewness = np.nan_to_num(np.stack(third) * shared**2 / (sd * s["n"]) ** 3)
    beyond = np.maximum(np.abs(error) - granted - missing, 0)
    z = np.divide(beyond, sd, out=np.zeros_like(sd), where=sd > 0)
    z = less_skewed(np.nan_to_num(z, nan=np.inf, posinf=np.inf), np.where(error < 0, skewness[0], skewness[1]))
    always = always + np.maximum(dark, bright)
    return _Tested(
        np.nan_to_num(z, nan=np.inf, posinf=np.inf),
        sd,
        dof,
        always + missing,
        radiance,
        error,
        always,
        event,
        skewness.max(axis=0),
    )


def _more_sensitive(estimators: list[Estimator], level: float) -> _Tested:
    """For each sum take the more sensitive estimator: with its fireflies, or without them, allowing for their mean."""
    made = [_estimate(estimator, level) for estimator in estimators]
    if len(made) == 1:
        return made[0]
    least = [t.granted + t.sd * as_skewed(quantile(level, t.dof), t.skewness) for t in made]
    return _Tested(*(np.where(least[1] < least[0], y, x) for x, y in zip(*made, strict=True)))


def _missed(s: Sums, way: str, variance: Means) -> Means:
    """The light of the few events that a sum may have missed: all, unless it shows their variance."""
    spread = s[f"spread {way}"]
    shown = np.divide(variance, spread, out=np.zeros_like(variance), where=spread > 0)
    return np.asarray(s[f"lent {way}"] * np.maximum(1 - shown, 0) * (s[f"number {way}"] < FEW_EVENTS))


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
    worst, failed, sure, detectable = Worst(width=SIDE, height=SIDE), 0, 0, math.nan
    found: list[Place] = []
    for k, (side, step, here) in enumerate(scales):
        t = _more_sensitive(here, level)
        # Student's tails are wider than the Gaussian's: only what a Gaussian would doubt needs them.
        unsure = t.z >= min(doubtful, float(t.z.max()))
        p = np.ones_like(t.z)
        p[unsure] = two_sided(t.z[unsure], t.dof[unsure])
        failed += int(np.count_nonzero(p < level))
        sure += int(np.count_nonzero((p < level) & ~excusable(t.error, t.radiance, estimators[0].lacking)))
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
    return Family(worst, level, failed, tests, detectable, tuple(found), sure=sure)


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
    least = as_skewed(quantile(level, t.dof[lit][pick]), t.skewness[lit][pick])

    def power(log_bias: float) -> float:
        beyond = math.exp(log_bias) * radiance - granted
        z = np.divide(beyond, sd, out=np.where(beyond > 0, np.inf, -np.inf), where=sd > 0)
        return float(ndtr(z - least).mean())

    low, high = math.log(1e-9), math.log(1e9)
    if power(high) < POWER:
        return math.inf
    return math.exp(brentq(lambda x: power(x) - POWER, low, high, xtol=1e-3)) if power(low) < POWER else 0.0


def _image(estimators: list[Estimator], share: float, size: Size) -> Family:
    """The mean over everything; `detectable`: relative to its mean, in the worst channel of those that are not dim."""
    from scipy.special import ndtri

    level = sidak(share, 3)
    t = _more_sensitive(
        [w._replace(sums={k: x.sum(axis=(0, 1)) for k, x in w.sums.items()}) for w in estimators], level
    )
    p = two_sided(t.z, t.dof)
    c = int(t.z.argmax())
    worst = Worst(float(t.z[c]), float(p[c]), 0, 0, size[1], size[0], c, float(t.error[c]))
    least = t.granted + t.sd * (as_skewed(quantile(level, t.dof), t.skewness) + ndtri(POWER))
    lit = t.radiance > DIM_SHARE * t.radiance.mean()
    failed = p < level
    sure = int((failed & ~excusable(t.error, t.radiance, estimators[0].lacking)).sum())
    if not lit.any():
        return Family(worst, level, int(failed.sum()), 3, sure=sure)
    detectable, excluded = (float((x / t.radiance)[lit].max()) for x in (least, _excluded(t)))
    return Family(worst, level, int(failed.sum()), 3, detectable, excluded=excluded, sure=sure)


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
