"""Is t - r more than noise? Three of the four tests of a comparison.

    values   z = (|t - r| - granted) / sqrt(va + vb)               every value: a wrong pixel
    tiles    z = (|Σ(t - r)| / n - granted) n / sqrt(Σva + Σvb)    of 8 x 8, 16 x 16, ... pixels: a wrong corner
    image    the same over all pixels: its brightness

The fourth, the shift between the images (shift.py), sees a wrong camera. Each gets the rate 1 - (1 - rate)^(1/4), and
shares it among its own values by Sidak's formula. From 16 pixels on tiles overlap by half: any square of 24 pixels
holds a whole one of 16.

These rules hold the rate. Behind each stands how many correct renders fail without it, and with which noise
(tests/measure/sequences.py has the kinds):

- Student's t: a value has the batches' degrees of freedom, a sum (Σv)² / Σ(v² / ν) - 1: 3 of 20, four batches.
- A value's variance is at least its block's mean, where batches agree by chance: 4 of 20, exponential.
- A sum's z is corrected for skewness by its third moment (significance.less_skewed): 3 of 120, where 0 fail with it,
  lognormal 1.5 at a rate of 1 %.
- A variance is at least what the other image's says, by the ratio of their samples: 8 of 30, fireflies that the test
  hardly catches. So is a third moment, which finds faults sooner.
- Few events may be missed, as neighbours tell, in sums: 2 of 20, in 10 x 14 pixels; in values: 14 of 60, in a stripe.
- Samples that all agree may have missed one as bright as the image's scale: 18 of 20, one sample in 200 shaded.
- Beside an exact image few samples leave an error undecided that brighter events explain: 17 of 20, few fireflies.
- Sums are inflated where neighbours share samples, as under a filter wider than the pixel: 20 of 20, of 1 pixel.

A standard deviation below a tenth of the tolerance is no noise: such values are compared exactly.
An event that nobody sampled cannot be distinguished from a bias.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Bool, Float, Float32
from raytwin.compare.blocks import SIDE, Blocks, Means, Pixels, block_counts, block_sums, slide, strips, to_pixels
from raytwin.compare.exact import Bound, NoiseFree, count_noise_free
from raytwin.compare.finding import MOST_PLACES, Place, blocks_of
from raytwin.compare.noise import (
    TINY,
    Correlation,
    block_means,
    correlation,
    degrees_of_freedom,
    larger_variance,
    variance_ratio,
)
from raytwin.compare.significance import as_skewed, less_skewed, quantile, sidak, two_sided, welch
from raytwin.images.image import Image

TESTS = 4
"""Tests that share the false-alarm rate: values, tiles, image, shift."""

POWER = 0.9
"""The probability with which a minimum detectable bias is detected."""

SILENT_SHARE = 0.1
"""Standard deviations below this share of the tolerance count as no noise."""

FEW_EVENTS, RARE_EVENTS = 20.0, 60.0
"""A sum in which fewer than 20 bright events are expected may contain none. A block whose noise comes from fewer than
60 is compared with its neighbours."""

BRIGHTEST = 600.0
"""Light of the brightest event that a noisy image may have missed, as a multiple of the mean radiance there."""

FEWEST_TOLD = 3
"""Fewest samples or renders whose variance counts as stated. An estimated variance is marked by two batches."""

ENOUGH_SAMPLES, ENOUGH_AT_ONCE = 80_000, 30_000
"""Samples in the whole image after which an event of probability 1e-4 has been missed with probability exp(-8) (in a
sequence, which meets the least lucky number of samples) or exp(-3) (in one comparison)."""

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
    radiance: float = 0.0

    @property
    def signed(self) -> float:
        """`z` with the sign of the error."""
        return math.copysign(self.z, self.error)


class Family(NamedTuple):
    """Tests of one kind: the worst, the level that p-values must stay above, how many of how many fell below, where.

    `detectable`: the relative error that the family would have found with the probability POWER, and `excluded`:
    the smallest error that the data rule out.
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

    `lacking`: shares of the light that the test, and the reference, may lack, since no sample met a rare event.
    """

    value: Family
    tile: Family
    image: Family
    noise_free: NoiseFree
    failed_pixels: int
    shared: Correlation
    lacking: tuple[float, float]

    @property
    def excusable(self) -> bool:
        """Whether events that no sample met may explain the worst that noise does not."""
        failed = [family.worst for family in (self.value, self.tile, self.image) if not family.passed]
        return all(abs(w.error) < self.lacking[w.error >= 0] * abs(w.radiance) for w in failed)


class Rounding(NamedTuple):
    """Rounding of the file formats: `value` (H, W, 3) at most; `mean`, the part that averaging over noise leaves."""

    value: Pixels
    mean: Pixels


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
    known = _known(test, reference, bound, sidak(rate, TESTS), rounding, look)
    parts = list(_strips(known))
    sums, spread = _with_rare_events(_sums(known, parts), known)
    noise_free, failed_pixels = NoiseFree(), 0
    if silent := sum(int(part.silent.sum()) for part in parts):
        error = np.concatenate([np.where(part.silent, np.abs(part.error), np.float32(0)) for part in parts])
        forgiven = None if rounding is None else rounding.value
        noise_free = count_noise_free(error, silent, bound, reference.mean, forgiven)
    values = Family(Worst(), sidak(known.share, test.mean.size), 0, test.mean.size)
    for part in parts if by_value else ():
        values, failed = _values(values, part, sums, spread, known)
        failed_pixels += failed
    shared = correlation(test.mean, reference.mean, (sums.variances.sum(axis=0) / sums.pixels).astype(np.float32))
    tile, image = (family(sums, known, shared.inflation) for family in (_tiles, _image))
    lacking = _lacking(test, reference, known.share, look)
    return Decision(values, tile, image, noise_free, failed_pixels, shared, lacking)


# ------------------------------------------------------------------------------------------------ what is known


class Noisy(NamedTuple):
    """An image with a variance: its number, 0 the test's; the mean variance of its blocks, its degrees of freedom."""

    number: int
    variance: Pixels
    third: Pixels | None
    blocks: Blocks
    dof: float


class Known(NamedTuple):
    """The test and the reference, and what is known of their noise before anything is tested.

    `share`: of the false-alarm rate, each of TESTS'; `look`: the rate as a share of a whole sequence's; `ratio` of the
    variances; `unmet`: 1 / (samples per pixel), of the image with fewer samples, 0 if zero variance proves that there
    is no noise.
    """

    images: tuple[Image, Image]
    noisy: tuple[Noisy, ...]
    bound: Bound
    rounding: Rounding | None
    share: float
    look: float
    ratio: float | None
    unmet: float

    def missed_events(self, level: float) -> float:
        """The events that samples which all agree may have missed, at this level.

        An event of probability p occurs n p times in n samples on average, and never with probability exp(-n p).
        For two images exp(-n p - m q) allows the largest p + q if the image with fewer samples missed all of it.
        What a later look has missed, the earlier looks missed too, so that all looks share one level.
        """
        return -math.log(level / self.look)


def _known(test: Image, reference: Image, bound: Bound, share: float, rounding: Rounding | None, look: float) -> Known:
    least, unmet = (SILENT_SHARE * bound.least) ** 2, 0.0
    noisy = []
    for number, image in enumerate((test, reference)):
        if image.variance is not None:
            blocks = block_means(image.variance).astype(np.float32)
            noisy.append(Noisy(number, image.variance, image.third, blocks, degrees_of_freedom(image)))
            if float(blocks.max()) > least:
                unmet = max(unmet, 1 / (image.samples if image.samples > 1 else max(image.batches or 0, 2)))
    ratio = variance_ratio(test, reference, least)
    return Known((test, reference), tuple(noisy), bound, rounding, share, look, ratio, unmet)


def enough_samples(look: float) -> int:
    """Samples of the whole image from which on no error is excused by events that no sample found."""
    return ENOUGH_SAMPLES if look < 1 else ENOUGH_AT_ONCE


def _lacking(test: Image, reference: Image, share: float, look: float) -> tuple[float, float]:
    """The shares of light of -ln(share) events, which all samples miss with the probability `share`.

    Beside an image without noise nothing else tells of such events.
    """
    if (test.variance is None) == (reference.variance is None):
        return 0.0, 0.0
    noisy = reference if test.variance is None else test
    each = noisy.samples if noisy.samples > 1 else noisy.batches or 0
    samples = math.prod(noisy.shape[:2]) * each
    told = each >= FEWEST_TOLD
    lacking = BRIGHTEST * -math.log(share) / samples if told and samples < enough_samples(look) else 0.0
    return (0.0, lacking) if noisy is reference else (lacking, 0.0)


class Strip(NamedTuple):
    """Rows from `top` on, in blocks of `rows` x 8 pixels: t - r, r, and the variance of t - r, infinite if `silent`.

    `allowed`: what a value without noise may err by; `granted`: what a single value may err by beyond its noise;
    `silent`: values without noise; `agreeing`: those whose samples all agree, which may have missed an event.
    """

    top: int
    rows: int
    error: Float32[np.ndarray, "h w 3"]
    radiance: Float32[np.ndarray, "h w 3"]
    variance: Float32[np.ndarray, "h w 3"]
    allowed: Float32[np.ndarray, "h w 3"]
    granted: Float32[np.ndarray, "h w 3"]
    silent: Bool[np.ndarray, "h w 3"]
    agreeing: Bool[np.ndarray, "h w 3"] | None

    @property
    def here(self) -> slice:
        """Its rows of the image."""
        return slice(self.top, self.top + len(self.error))

    def of_blocks(self, blocks: Blocks) -> Float32[np.ndarray, "h w 3"]:
        """The whole image's blocks (by, bx, 3) for each value of the strip."""
        mine = blocks[self.top // SIDE : self.top // SIDE + len(self.error) // self.rows]
        return to_pixels(mine.astype(np.float32), *self.error.shape[:2])

    def total(self, x: Pixels) -> Blocks:
        """Sums over its blocks, to which values without noise add nothing."""
        return block_sums(np.where(self.silent, np.float32(0), x) if self.silent.any() else x, self.rows)


def _strips(known: Known) -> Iterator[Strip]:
    (test, reference), bound = known.images, known.bound
    missed = known.unmet * known.missed_events(sidak(known.share, test.mean.size)) / bound.share
    for top, end, rows in strips(test.shape):
        radiance = np.asarray(reference.mean[top:end], np.float32)
        error = np.subtract(test.mean[top:end], radiance, dtype=np.float32)
        each = [np.zeros((), np.float32)] * 2
        for image in known.noisy:
            blocks = to_pixels(image.blocks[top // SIDE :], end - top, error.shape[1])
            each[image.number] = np.maximum(image.variance[top:end], blocks, dtype=np.float32)
        granted = allowed = bound.of(radiance)
        least = np.square(np.float32(SILENT_SHARE) * allowed)
        silent, agreeing = each[0] + each[1] <= least, None
        variance = larger_variance(each[0], each[1], known.ratio)
        if known.rounding is not None:
            granted = granted + known.rounding.value[top:end]
        if known.unmet:
            own = sum((image.variance[top:end] for image in known.noisy), np.zeros_like(least))
            agreeing = np.asarray(own <= least / 16)
            silent &= ~agreeing
            variance = np.where(agreeing, np.maximum(variance, least), variance)
            granted = np.where(agreeing, granted + np.float32(missed) * allowed, granted)
        variance = np.where(silent, np.float32(np.inf), variance)
        yield Strip(top, rows, error, radiance, variance, allowed, granted, silent, agreeing)


# ------------------------------------------------------------------------------------------------ values


def _values(
    found: Family, part: Strip, sums: "Sums", spread: Float[np.ndarray, "2 by bx 3"], known: Known
) -> tuple[Family, int]:
    """z = max(|t - r| - granted, 0) / sqrt(v), Student's t, of each value; and how many pixels of the strip fail."""
    beyond, variance = np.abs(part.error) - part.granted, part.variance
    if spread.any():
        dark = part.error < 0
        beyond -= np.where(dark, *(part.of_blocks(light / sums.pixels) for light in sums.missed_light))
        variance = np.maximum(variance, np.where(dark, *(part.of_blocks(blocks) for blocks in spread)))
    beyond = np.maximum(beyond, 0, out=beyond)
    square = np.square(beyond, out=beyond)
    square /= variance
    dof = welch([(float(image.blocks.mean()), image.dof) for image in known.noisy])
    peak, threshold = int(square.argmax()), float(quantile(found.level, dof))
    z = math.sqrt(square.flat[peak])
    if z > found.worst.z:
        y, x, c = (int(i) for i in np.unravel_index(peak, square.shape))
        error, radiance = float(part.error[y, x, c]), float(part.radiance[y, x, c])
        found = found._replace(worst=Worst(z, float(two_sided(z, dof)), x, y + part.top, 1, 1, c, error, radiance))
    if not z > threshold:
        return found, 0
    failed = square > threshold**2
    pixels = np.asarray(failed.any(axis=-1))
    places = (*found.places, *blocks_of(pixels, part.top, known.images[0].shape[0]))[:MOST_PLACES]
    count = found.failed + int(np.count_nonzero(failed))
    return found._replace(failed=count, places=places), int(np.count_nonzero(pixels))


# ------------------------------------------------------------------------------------------------ sums


class Sums(NamedTuple):
    """Sums over blocks or tiles (..., y, x, 3) of `error` t - r, `radiance` r, and what their noise is known by.

    `variances` and `thirds` (2, y, x, 3): of the test's and the reference's noise, and their third moments; `squares`:
    Σ v² / ν; `rounding`: what averaging leaves of it; `agreeing`: how many values have samples that all agree.
    `missed_*` (2, y, x, 3): light, variance and number of the events that may make it too dark, or too bright.
    """

    pixels: Float[np.ndarray, "*n 1"]
    error: Means
    radiance: Means
    variances: Float[np.ndarray, "2 *n 3"]
    thirds: Float[np.ndarray, "2 *n 3"]
    squares: Means
    rounding: Means
    agreeing: Means
    missed_light: Float[np.ndarray, "2 *n 3"]
    missed_variance: Float[np.ndarray, "2 *n 3"]
    missed_number: Float[np.ndarray, "2 *n 3"]

    def each(self, function: Callable[[np.ndarray], np.ndarray]) -> "Sums":
        """Apply `function` to every field."""
        return Sums(*map(function, self))


def _sums(known: Known, parts: list[Strip]) -> Sums:
    """Sums over all blocks of 8 x 8 pixels.

    A third moment that is not known is the covariance of v and t - r: a mean and its own variance share just that.
    """
    found = []
    for part in parts:
        pixels, error = block_counts(part.error, part.rows), part.total(part.error)
        squares, rounding, agreeing = np.zeros((3, *error.shape))
        variances, thirds, none = np.zeros((3, 2, *error.shape))
        for image in known.noisy:
            k, v = image.number, image.variance[part.here]
            variances[k] = part.total(v)
            squares += part.total(np.square(v)) / image.dof
            if image.third is not None:
                thirds[k] = part.total(image.third[part.here])
            else:
                thirds[k] = (1 - 2 * k) * (part.total(v * part.error) - error * variances[k] / pixels)
        if known.rounding is not None:
            rounding = block_sums(known.rounding.mean[part.here], part.rows)
        if part.agreeing is not None:
            agreeing = block_sums(part.agreeing.astype(np.float32), part.rows)
        radiance = block_sums(part.radiance, part.rows)
        found.append(Sums(pixels, error, radiance, variances, thirds, squares, rounding, agreeing, none, none, none))
    return Sums(*(np.concatenate(x, axis=-3) for x in zip(*found, strict=True)))


def third_against(thirds: Float[np.ndarray, "2 *n 3"], known: Known) -> Float[np.ndarray, "2 *n 3"]:
    """The third moments of sums of t - r that make them look too dark, and too bright, where events were missed.

    What one image has seen of them, the other must have, by its number of samples, where it knows of any.
    """
    to_test, to_reference = 0.0, 0.0
    if known.ratio is not None:
        to_test, to_reference = (
            0.0 if image.third is None else scale
            for image, scale in zip(known.images[::-1], (known.ratio**2, known.ratio**-2), strict=True)
        )
    up, down = np.maximum(thirds, 0), np.maximum(-thirds, 0)
    dark = np.maximum(up[0], to_test * up[1]) + np.maximum(down[1], to_reference * down[0])
    bright = np.maximum(down[0], to_test * down[1]) + np.maximum(up[1], to_reference * up[0])
    return np.stack([dark, bright])


def _with_rare_events(sums: Sums, known: Known) -> tuple[Sums, Float[np.ndarray, "2 by bx 3"]]:
    """The sums with what blocks may have missed of few events; and how far, as a variance, single values may be off.

    k events of size S make the light k S, the variance k S² and the third moment k S³. A block lacks what its
    neighbours saw on average, or all blocks: at most (sqrt(k) + c / 2)² + 1 of k, c the Gaussian's quantile.
    """
    from scipy.ndimage import maximum_filter, uniform_filter
    from scipy.special import ndtri

    variance, third = (
        larger_variance(sums.variances[0], sums.variances[1], known.ratio),
        third_against(sums.thirds, known),
    )
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        number = np.where(third > 0, variance**3 / np.square(third), np.inf)
        rare = number < RARE_EVENTS
        light = np.where(rare, variance * variance / third, 0)
    number, variance = np.where(rare, number, 0), np.where(rare, variance, 0)
    everywhere, quantile = number.sum(axis=(1, 2), keepdims=True), -float(ndtri(known.share))
    most = (np.sqrt(everywhere) + quantile / 2) ** 2 + 1
    most = np.divide(most, everywhere, out=np.zeros_like(everywhere), where=everywhere > 0) / sums.pixels.sum()
    brightness = sums.radiance / sums.pixels  # where there is more light there may be more
    brightness = np.maximum(brightness / np.maximum(brightness.mean(axis=(0, 1)), TINY), 1)

    around = uniform_filter(sums.pixels, (3, 3, 1), mode="nearest")

    def from_neighbours(
        seen: Float[np.ndarray, "2 by bx 3"], factor: np.ndarray | float
    ) -> Float[np.ndarray, "2 by bx 3"]:
        neighbours = uniform_filter(seen, (1, 3, 3, 1), mode="nearest") / around
        return np.asarray(sums.pixels * np.maximum(neighbours, most * seen.sum(axis=(1, 2), keepdims=True) * factor))

    sums = sums._replace(
        missed_light=from_neighbours(light, brightness),
        missed_variance=from_neighbours(variance, np.square(brightness)),
        missed_number=from_neighbours(number, 1.0),
    )
    return sums, maximum_filter(variance / sums.pixels, (1, 3, 3, 1))


Tests = Float[np.ndarray, "*n"]
"""A value for each of several tests."""


class Deviations(NamedTuple):
    """`z`: |mean error| beyond `granted`, in standard deviations, of sums (..., 3). The other fields are its parts."""

    z: Tests
    sd: Tests
    dof: Tests
    granted: Tests
    radiance: Tests
    error: Tests
    skewness: Tests

    def least(self, level: float) -> Tests:
        """The smallest z at which each test fails."""
        return as_skewed(quantile(level, self.dof), self.skewness)


def _deviations(sums: Sums, known: Known, shared: float, level: float) -> Deviations:
    """`shared`: the inflation of a sum's variance; its third moment has its square."""
    n, bound = sums.pixels, known.bound
    own, variance = sums.variances.sum(axis=0), larger_variance(sums.variances[0], sums.variances[1], known.ratio)
    dof = np.divide(np.square(own), sums.squares, out=np.full_like(own, np.inf), where=sums.squares > 0) / shared - 1
    dof = np.maximum(dof, 0.5)
    sd = np.maximum(np.sqrt(variance * shared) / n, 1e-3 * bound.least)  # where all agree: no division by 0
    error, radiance = sums.error / n, sums.radiance / n
    event = np.where(sums.agreeing > 0, known.unmet * bound.of(radiance) / bound.share / n, 0.0)
    granted = bound.of(radiance) + sums.rounding / n + known.missed_events(level) * event
    # The light of the few events that a sum may have missed: all, unless it shows their variance.
    spread = sums.missed_variance
    shown = np.divide(variance, spread, out=np.zeros_like(spread), where=spread > 0)
    missed = sums.missed_light * np.maximum(1 - shown, 0) * (sums.missed_number < FEW_EVENTS) / n
    with np.errstate(divide="ignore", invalid="ignore"):
        skewness = np.nan_to_num(third_against(sums.thirds, known) * shared**2 / (sd * n) ** 3)
    beyond = np.maximum(np.abs(error) - granted - np.where(error < 0, *missed), 0)
    z = less_skewed(np.nan_to_num(beyond / sd, nan=np.inf, posinf=np.inf), np.where(error < 0, *skewness))
    z = np.nan_to_num(z, nan=np.inf, posinf=np.inf)
    return Deviations(z, sd, dof, granted + missed.max(axis=0), radiance, error, skewness.max(axis=0))


# ------------------------------------------------------------------------------------------------ tiles


def _tiles(sums: Sums, known: Known, shared: float) -> Family:
    """Tiles of 8, 16, 32, ... pixels, up to half of the image's longer side; `detectable` is for 24 x 24, anywhere.

    `places`: those of the smallest side at which any fails.
    """
    height, width = known.images[0].shape[:2]
    scales = [(SIDE, SIDE, sums)]
    while 4 * scales[-1][0] <= max(height, width):
        side, step, finer = scales[-1]
        apart = side // step
        coarser = finer.each(lambda x, apart=apart: slide(x[..., ::apart, ::apart, :]))  # type: ignore[misc]
        scales.append((2 * side, side, coarser))
    tests = sum(here.error.size for _, _, here in scales)
    level = sidak(known.share, tests)
    gaussian_limit = float(quantile(level, math.inf))
    worst, failed, detectable = Worst(width=SIDE, height=SIDE), 0, math.nan
    found: tuple[Place, ...] = ()
    for k, (side, step, here) in enumerate(scales):
        tested = _deviations(here, known, shared, level)
        # Student's tails are wider than the Gaussian's: only tests that fail by the Gaussian need Student's p.
        needs_student_t = tested.z >= min(gaussian_limit, float(tested.z.max()))
        p = np.ones_like(tested.z)
        p[needs_student_t] = two_sided(tested.z[needs_student_t], tested.dof[needs_student_t])
        below = p < level
        failed += int(np.count_nonzero(below))

        def place(y: int, x: int, side: int = side, step: int = step) -> Place:
            return Place(x * step, y * step, min(side, width - x * step), min(side, height - y * step))

        found = found or tuple(place(y, x) for y, x in np.argwhere(below.any(axis=-1))[:MOST_PLACES].tolist())
        # The smallest p; of equal ones, the largest z.
        y, x, c = min(np.argwhere(p == p.min()).tolist(), key=lambda at, tested=tested: -tested.z[tuple(at)])  # type: ignore[misc]
        if (p[y, x, c], -tested.z[y, x, c]) < (worst.p, -worst.z):
            z, p_value, error, radiance = (
                float(values[y, x, c]) for values in (tested.z, p, tested.error, tested.radiance)
            )
            worst = Worst(z, p_value, *place(y, x), c, error, radiance)
        if k == min(1, len(scales) - 1):
            detectable = _seen_somewhere(tested, level)
    return Family(worst, level, failed, tests, detectable, found)


def _seen_somewhere(tested: Deviations, level: float) -> float:
    """Return the relative error of the mean of a random tile that is found with probability POWER."""
    from scipy.optimize import brentq
    from scipy.special import ndtr

    lit = tested.radiance > 0
    if not lit.any():
        return math.nan
    some = Deviations(*(x[lit][:: max(1, int(lit.sum()) // 3000)] for x in tested))
    least = some.least(level)

    def lacks(log_bias: float) -> float:
        beyond = (math.exp(log_bias) * some.radiance - some.granted) / some.sd - least
        return POWER - float(ndtr(np.nan_to_num(beyond, nan=-np.inf)).mean())

    low, high = math.log(1e-9), math.log(1e9)
    return math.inf if lacks(high) > 0 else math.exp(brentq(lacks, low, high, xtol=1e-3))


# ------------------------------------------------------------------------------------------------ the image


def _image(sums: Sums, known: Known, shared: float) -> Family:
    """The mean over everything; `detectable`: relative to its mean, in the worst channel of those that are not dim."""
    from scipy.special import ndtri

    level, (height, width) = sidak(known.share, 3), known.images[0].shape[:2]
    tested = _deviations(sums.each(lambda x: x.sum(axis=(-3, -2))), known, shared, level)
    p = two_sided(tested.z, tested.dof)
    c = int(tested.z.argmax())
    worst = Worst(
        float(tested.z[c]), float(p[c]), 0, 0, width, height, c, float(tested.error[c]), float(tested.radiance[c])
    )
    lit = tested.radiance > DIM_SHARE * tested.radiance.mean()
    found = (tested.granted + tested.sd * (tested.least(level) + ndtri(POWER)), excluded_bias(tested))
    detectable, excluded = (float((x / tested.radiance)[lit].max()) if lit.any() else math.nan for x in found)
    return Family(worst, level, int((p < level).sum()), 3, detectable, excluded=excluded)


def excluded_bias(tested: Deviations) -> Means:
    """Return the smallest bias b of means that the data rule out by a likelihood ratio of 1 / (1 - POWER).

    The likelihood ratio of b and of none is exp(-(b' |e| - b'² / 2) / sd²), b' what b has beyond the granted error e
    (Wald 1945): a correct mean excludes b with a third of the samples that a test of a fixed number needs to find it.
    Even if it is tested at every look, an image with the bias b passes with probability 1 - POWER at most.
    """
    error, sd = (
        np.abs(tested.error),
        tested.sd * quantile(2 * (1 - POWER), tested.dof) / quantile(2 * (1 - POWER), math.inf),
    )
    return np.asarray(tested.granted + error + np.sqrt(np.square(error) - 2 * np.square(sd) * math.log(1 - POWER)))
