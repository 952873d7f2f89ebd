"""Radiance: which noise is known, what it leaves to be found, and what cannot be decided."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from raytwin.compare.blocks import Pixels
from raytwin.compare.comparison import Statistics
from raytwin.compare.decision import TESTS, Decision, Rounding, decide, enough_samples
from raytwin.compare.exact import Bound, NoiseFree, count_noise_free
from raytwin.compare.finding import Finding, Place, notes, plural
from raytwin.compare.messages import agreement, noise_findings, percent, what_could_be_seen
from raytwin.compare.metrics import METRICS, nth_largest
from raytwin.compare.noise import (
    CAP,
    Residual,
    block_means,
    capped,
    equivalent_samples,
    estimated,
    few_samples,
    rare_light,
    residual,
)
from raytwin.compare.shift import Shift, shift_findings
from raytwin.compare.significance import sidak
from raytwin.compare.untold import ESTIMATED, GIVE, UNEXPLAINED, borne_out, dense, unexplained
from raytwin.images.image import Image
from raytwin.judging import Judging

TINY = np.float32(1e-30)

SHARED = (
    "undecided: the test errs by no more than the noise it claims, but all its pixels alike: equal random numbers in "
    "every pixel? Seed each pixel apart, or give several renders of other seeds"
)

PATTERN = (
    "the errors repeat from place to place, as no noise of independent pixels does, so that the variance that the "
    "test states excuses nothing"
)

ENOUGH_BATCHES = 4
"""With fewer batches the variance is unreliable: an image fails only if the scatter between neighbours fails it too."""

FEW_BATCHES = (
    "undecided: a variance from {} batches is hardly known, and by the scatter between neighbouring pixels nothing is "
    "wrong: take at least 4 samples per pixel"
)

FEW_SAMPLES = (
    "undecided: too few random samples to know any noise: take at least 4 samples per pixel, and another image for "
    "each seed"
)

UNSAMPLED = (
    "undecided: the image has so few samples that all of them may have missed events that are rare and bright: take at "
    "least {} samples per pixel"
)

SCALED = (
    "undecided: single pixels are off by more than the other image's noise, scaled by the samples, explains, but that "
    "says nothing of rare events: give a variance or several renders"
)

LIKE_FEW = (
    "undecided: the test states no noise, and differs from the reference as {} of the reference's renderer would: "
    + GIVE
)

MOSTLY_RARE = 0.25
"""Share of an image's light in rare events above which no tile shows how many it missed."""

FEW_EVENTS_SEEN = (
    "undecided: {:.0f} % of the light of {} comes from rare events, of which a pixel saw very few: take more samples, "
    "or sample the brightest light directly"
)


class Outcome(NamedTuple):
    """What is wrong, and where (`failing`); why nothing can be decided (`doubts`); else what could have been seen."""

    findings: list[Finding]
    statistics: Statistics
    notes: tuple[Finding, ...] = ()
    doubts: tuple[str, ...] = ()
    failing: tuple[Place, ...] = ()
    excluded_bias: float | None = None


@dataclass(frozen=True, eq=False)
class RadianceTest:
    """Two finite images of one shape, in units of `unit`, and how closely they must agree.

    `look`: the false-alarm rate as a share of a whole sequence's. `half_steps`: what the file formats may have rounded
    off. `excused`: pixels that see another object, and may.
    """

    test: Image
    reference: Image
    judging: Judging
    bound: Bound
    unit: float
    look: float
    half_steps: tuple[Pixels | None, Pixels | None]
    excused: int
    shift: Shift | None

    @property
    def pixels(self) -> int:
        return self.test.shape[0] * self.test.shape[1]

    @cached_property
    def shown(self) -> Residual:
        """The scatter of t - r."""
        return residual(self.test.mean, self.reference.mean)

    @cached_property
    def of_samples(self) -> float | None:
        """Samples per pixel of the reference's renderer that have the test's noise; None where nothing tells."""
        return None if self.reference.variance is None else equivalent_samples(self.reference, self.shown)

    def run(self) -> Outcome:
        """By the stated noise; where that fails and a side states none, by what the scatter shows."""
        filled = self._filled()
        unstated = [
            name
            for name, image in (("the test", filled.test), ("the reference", filled.reference))
            if image.variance is None and image.samples != 1  # one sample is how a renderer without noise comes
        ]
        first = filled._by_stated_noise()
        if filled is not self and any(f.kind == "value" for f in first.findings):
            # Of rare events in a pixel the other image says nothing.
            sums = [f for f in first.findings if f.kind != "value"]
            first = first._replace(findings=sums, doubts=first.doubts if sums else (SCALED,))
        if first.findings and (hardly_sampled(filled.test) or hardly_sampled(filled.reference)):
            return first._replace(doubts=(FEW_SAMPLES,))
        if first.findings and self.test.variance is None and (few := self._like_few_samples()):
            return first._replace(doubts=(LIKE_FEW.format(few),))
        claims = [block_means(i.variance) for i in (self.test, self.reference) if i.variance is not None]
        if not unstated or not (claims or first.findings):
            return first
        known = sum(claims, np.zeros(3))
        doubtful = bool(first.findings) or unexplained(self.shown, known)
        return self._by_scatter(first, unstated) if doubtful and dense(self.shown, known, self.bound.least) else first

    def exactly(self) -> Outcome:
        """Compare images without noise, value by value."""
        test, reference = self.test.mean, self.reference.mean
        error = np.subtract(test, reference)
        np.abs(error, out=error)
        rounding = self._rounding()[0]
        forgiven = None if rounding is None else rounding.value
        noise_free = count_noise_free(error, error.size, self.bound, reference, forgiven)
        findings = self._noise_free_findings(noise_free)
        p999 = nth_largest(error.size // 1000, np.asarray, error) * self.unit
        if findings:
            relative = METRICS["p999_rel"].function(*(image * np.float32(self.unit) for image in (test, reference)))
            text = f"99.9 % quantile of the error: {p999:.3g} absolute, {relative:.3g} relative"
            findings.append(Finding("exact", text))
        allowed = self.judging.bounds.p999_abs * self.bound.scale * self.unit
        statistics = Statistics(pixel_fail_fraction=noise_free.outliers / self.pixels)
        noise_free = noise_free._replace(error=noise_free.error * self.unit)
        return Outcome(findings, statistics, (agreement(p999, allowed, noise_free),), failing=noise_free.places)

    # ---------------------------------------------------------------------------------- noise that is stated

    def _filled(self) -> "RadianceTest":
        """A variance that is not stated follows from the other image's where both state their samples."""
        test, reference = self.test, self.reference
        if test.samples > 1 and reference.samples > 1:
            if test.variance is None and reference.variance is not None:
                return replace(self, test=_with_noise_of(test, reference))
            if reference.variance is None and test.variance is not None:
                return replace(self, reference=_with_noise_of(reference, test))
        return self

    def _rounding(self) -> tuple[Rounding | None, Image, Image]:
        """What is granted to the formats' steps; the images with the steps' own noise.

        A value is off by at most half a step h. In a mean of values with noise of variance v, rounding leaves
        h exp(-pi² v / (2 h²)), since noise carries it over many steps, and adds the variance h² / 3 to each.
        """
        if all(half is None for half in self.half_steps):
            return None, self.test, self.reference
        value, mean = np.zeros((2, *self.test.shape), np.float32)
        images = []
        for image, half in zip((self.test, self.reference), self.half_steps, strict=True):
            if half is not None:
                left = np.ones_like(half)
                if image.variance is not None:
                    left = np.exp(-(np.pi**2) / 2 * image.variance / np.maximum(np.square(half), TINY))
                    image = replace(image, variance=image.variance + np.square(half) / np.float32(3))
                value += half
                mean += half * left
            images.append(image)
        return Rounding(value, mean), images[0], images[1]

    def _by_stated_noise(self) -> Outcome:
        rounding, test, reference = self._rounding()
        if test.variance is None and reference.variance is None:
            return self.exactly()
        if test.variance is not None:
            test = replace(test, variance=capped(test.variance, self.shown))
        made = decide(test, reference, self.bound, self.judging.false_alarm_rate, rounding, look=self.look)
        outcome = self._answered(made)
        if outcome.findings:
            return outcome._replace(doubts=self._doubts(outcome, test, reference))
        if test.variance is not None and made.shared.patterned:
            bare = replace(self, test=replace(test, variance=None, samples=0, batches=None))._by_stated_noise()
            if bare.findings:
                return bare._replace(findings=[Finding("tile", PATTERN), *bare.findings])
        return outcome

    def _doubts(self, outcome: Outcome, test: Image, reference: Image) -> tuple[str, ...]:
        """Why the findings prove nothing: few batches, rare events, or noise that all pixels of the test share."""
        kinds, few = {f.kind for f in outcome.findings}, fewest_batches(test, reference)
        if few < ENOUGH_BATCHES and "exact" not in kinds and not self._decided_by_scatter().findings:
            return (FEW_BATCHES.format(few),)
        share, whose = max((rare_light(test), "the test"), (rare_light(reference), "the reference"))
        if kinds <= {"tile", "value"} and share > MOSTLY_RARE:
            return (FEW_EVENTS_SEEN.format(100 * share, whose),)
        return (SHARED,) if self._shares_noise() else outcome.doubts

    def _shares_noise(self) -> bool:
        """Return whether the error is about what the test's variance allows, but nearly equal in all pixels."""
        claimed = self.test.variance
        if claimed is None or (block_means(claimed) > CAP * self.shown.square).mean() <= 0.5:
            return False
        error = float(np.square(np.subtract(self.test.mean, self.reference.mean, dtype=np.float32)).mean(dtype=float))
        stated = float(claimed.mean(dtype=float))
        return stated / 50 < error < 16 * stated and float(np.median(self.shown.square)) < error / 4

    def _noise_free_findings(self, noise_free: NoiseFree) -> list[Finding]:
        noise_free = noise_free._replace(error=noise_free.error * self.unit)
        return noise_free.findings(self.judging.bounds, self.bound.scale * self.unit, self.pixels, self.excused)

    def _answered(self, made: Decision) -> Outcome:
        findings = self._noise_free_findings(made.noise_free) + noise_findings(made, self.unit)
        rate, inflation = self.judging.false_alarm_rate, made.shared.inflation
        if self.shift is not None:
            findings += shift_findings(self.shift, sidak(rate, TESTS), inflation)
        image, tile = made.image.detectable, made.tile.detectable
        statistics = Statistics(
            z_mean=made.image.worst.signed,
            z_tile_worst=made.tile.worst.signed,
            pixel_fail_fraction=(made.failed_pixels + made.noise_free.outliers) / self.pixels,
            minimum_detectable_bias=finite(image),
            minimum_detectable_tile_bias=finite(tile),
        )
        doubts: tuple[str, ...] = ()
        if findings and made.excusable and all(f.kind in ("image", "tile", "value") for f in findings):
            doubts = (UNSAMPLED.format(enough_samples(self.look) // self.pixels + 1),)
        of = (image, "the whole image's mean"), (tile, "24 x 24 pixels")
        missed = [
            f"{percent(found)} of {what} (a pass needs {percent(limit)})"
            for (found, what), limit in zip(of, self.judging.detectable, strict=True)
            if found > limit
        ]
        if not findings and missed:
            text = f"undecided: so noisy that an error of less than {', or of '.join(missed)} would have been missed"
            doubts = (f"{text}: take more samples",)
        failing = tuple(dict.fromkeys((*made.tile.places, *made.value.places, *made.noise_free.places)))
        seen = what_could_be_seen(image, tile, inflation, rate)
        return Outcome(findings, statistics, seen, doubts, failing, finite(made.image.excluded))

    # ---------------------------------------------------------------------------------- noise that nobody states

    def _like_few_samples(self) -> str:
        """How many samples of the reference's renderer explain tiles and image by their noise; empty where none do."""
        n = few_samples(self.of_samples)
        if not n:
            return ""
        noisy = replace(self, test=_with_noise_of(replace(self.test, samples=n), self.reference))
        excused = all(f.kind == "value" for f in noisy._by_stated_noise().findings)  # of rare events n says nothing
        return f"{plural(n, 'sample')} per pixel" if excused else ""

    def _by_scatter(self, first: Outcome, unstated: list[str]) -> Outcome:
        """Decide with the scatter of t - r within blocks as noise: for tiles and the image, not for single pixels.

        It may fail an image, but passes one only if the reference's own noise confirms the scatter.
        """
        outcome = self._decided_by_scatter()
        known = borne_out(self.test.mean, self.reference.mean, self.shown, self.bound.least)
        if outcome.findings:
            return outcome if known or not any(f.kind == "exact" for f in first.findings) else first
        which = f"{' and '.join(unstated)} {'have' if len(unstated) > 1 else 'has'} no variance"
        if not known:
            return outcome._replace(doubts=(*outcome.doubts, f"undecided: {which}, and {UNEXPLAINED}: {GIVE}"))
        if outcome.doubts:
            return outcome._replace(doubts=(*outcome.doubts, f"{which}: {ESTIMATED}: {GIVE}"))
        return outcome._replace(notes=(*outcome.notes, *notes([f"{which}: {ESTIMATED}"])))

    def _decided_by_scatter(self) -> Outcome:
        test = replace(self.test, variance=estimated(self.test.mean, self.reference.mean), samples=0, batches=2)
        reference = replace(self.reference, variance=None, samples=0, batches=None)
        rate = self.judging.false_alarm_rate
        rounding, test, _ = replace(self, test=test, reference=reference)._rounding()
        made = decide(test, reference, self.bound, rate, rounding, by_value=False, look=self.look)
        return self._answered(made)


def _with_noise_of(image: Image, other: Image) -> Image:
    """The image with the other's noise, as its own samples make it."""
    assert other.variance is not None
    more = np.float32(other.samples / image.samples)
    third = np.zeros_like(other.variance) if other.third is None else other.third * more**2
    return replace(image, variance=other.variance * more, batches=other.batches, third=third)


def finite(x: float) -> float | None:
    """Return the number, or None in the place of NaN and infinity, which JSON has not."""
    return x if np.isfinite(x) else None


def fewest_batches(*images: Image) -> int:
    """Return the least number of batches of the images that have a variance."""
    return min(
        i.batches if i.batches is not None else i.samples or ENOUGH_BATCHES for i in images if i.variance is not None
    )


def hardly_sampled(image: Image) -> bool:
    """A random render of so few samples that not even the scatter between neighbouring pixels shows its noise."""
    return image.variance is None and image.batches == 1 and image.samples < ENOUGH_BATCHES
