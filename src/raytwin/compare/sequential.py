"""Compare while samples still come, and stop as soon as the verdict is certain.

Batches of both sides are pooled. The first look is at 4 samples. Each further look needs at least a fourth root of two
times as many (4, 5, 6, 7, 8, 10, 12, 14, 16, ...). A look is the whole comparison, at a level of its own:

    fail       the comparison fails at its level. The levels of all looks sum to `false_alarm_rate`, so no more than
               that share of correct pairs ever fails, however often and when they are looked at (Bonferroni)
    pass       the data speak ten to one against a bias of `detectable_bias` of the whole image (Wald's likelihood
               ratio), and 24 x 24 pixels that are off by `detectable_tile_bias` would have failed nine times in ten
    more       otherwise. When the budget is spent, the verdict is undecided, and says how many samples would decide.
               If no bias was asked for, a pass at the budget's end only needs to rule out a bias of 10 % of the image

Octave o of samples gets 1 / (o (o + 1)) of the rate, in four equal parts. A look that is left out only lowers the
rate. A look is left out if neither a pass nor a fail can be expected of it.
"""

import math
import time
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import msgspec

from raytwin.compare.comparison import Comparison
from raytwin.compare.finding import notes
from raytwin.compare.messages import percent, what_could_be_seen
from raytwin.compare.verdict import compare
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.images.image_input import LoadedImage, as_image
from raytwin.images.image_pool import ImagePool
from raytwin.judging import Judging

FIRST, PER_OCTAVE = 4, 4
"""Samples at the first look, and the most looks per doubling of the samples."""

FEWEST_TO_PASS = 8
"""Samples below which nothing passes: the noise of single pixels is not known yet."""

SOUGHT_BIAS, SOUGHT_TILE_BIAS = 0.01, 0.1
"""The bias of the whole image, and of any 24 x 24 pixels, that a pass excludes by default while the budget lasts."""

EARLY = 0.85
"""Share of the samples at which a pass is expected: look there already, since the estimate is noisy."""

SUSPICIOUS_MEAN, SUSPICIOUS_TILE = 2.5, 4.5
"""Standard deviations of the whole image, and of the worst tile: above them, the next look is as early as possible."""

EQUAL = "the renders are equal: taken as free of noise"

REPEATS = 7
"""Renders in a row that equal earlier ones: after so many, all further ones are expected to be equal, too.

One is not enough: C's srand starts equally from the seeds 0 and 1, and a few renders may all miss a rare event.
"""


def look_number(samples: float) -> int:
    """Return which look of the grid `samples` belong to: 0 up to FIRST, then a fourth of an octave each."""
    return max(0, math.ceil(PER_OCTAVE * math.log2(samples / FIRST) - 1e-9))


def look_level(rate: float, number: int) -> float:
    """Return the level of a look: all of them sum to the rate."""
    octave = number // PER_OCTAVE + 1
    return rate / (octave * (octave + 1) * PER_OCTAVE)


def first_samples(number: int) -> int:
    """Return the fewest samples of a look."""
    return FIRST if number == 0 else math.floor(FIRST * 2 ** ((number - 1) / PER_OCTAVE) + 1e-9) + 1


class SequentialComparison:
    """Decide about batches of renders as they come; see the module's first lines.

        check = SequentialComparison(reference)
        for seed in range(1000):
            if comparison := check.add(render(seed)):
                break

    `test` and `reference` are sides that do not grow. Renders added to a side replace it. Each is whatever
    `raytwin.compare` takes. `judging` and options are those of `compare` (`tolerance`, `noise`, `half_steps`).
    `next_look` says how many samples per pixel, or renders where their samples are unknown, the next verdict needs;
    `comparison` is the last one, decided or not. A `detectable_bias` or `detectable_tile_bias` that is given must be
    met for a pass, which takes at least `fewest_to_pass` samples per pixel.
    """

    def __init__(
        self,
        reference: Any = None,
        *,
        test: Any = None,
        judging: Judging | None = None,
        fewest_to_pass: int = FEWEST_TO_PASS,
        judge: Callable[..., Comparison] = compare,
        **options: Any,
    ) -> None:
        own = {field.name: options.pop(field.name) for field in fields(Judging) if field.name in options}
        self.judging = replace(judging or Judging(), **own)
        image, tile = self.judging.detectable_bias, self.judging.detectable_tile_bias
        self._sought = image or SOUGHT_BIAS, tile or SOUGHT_TILE_BIAS
        self.looks, self.next_look, self.fewest_to_pass = 0, FIRST, fewest_to_pass
        self.comparison: Comparison | None = None
        self.decided = False
        self._loaded: dict[str, LoadedImage] = {}
        fixed = {"test": test, "reference": reference}
        self._fixed = {name: None if side is None else self._taken(name, side) for name, side in fixed.items()}
        self._pools = {"test": ImagePool(), "reference": ImagePool()}
        self._judge, self._options, self._looked_at, self._number = judge, options, 0, -1
        self._began = time.perf_counter()

    @property
    def samples(self) -> int:
        """Samples per pixel of the growing side that has fewer. Counts renders if they do not state their samples."""
        return min((pool.weight for pool in self._pools.values() if pool.images), default=0)

    def image(self, side: str) -> Image:
        """The mean of `test` or `reference` so far."""
        pool, fixed = self._pools[side], self._fixed[side]
        if not pool.images and fixed is None:
            raise InputError(side, "an image, or renders of it", "none")
        image = pool.image if pool.images else fixed
        assert image is not None
        for loaded in self._loaded.values():
            image = loaded.fitted(image)
        return replace(image, variance=None, samples=1, batches=None) if pool.noise_free else image

    def add(self, test: Any = None, reference: Any = None) -> Comparison | None:
        """Add a render of either side, or of both. Return the verdict, or None if it needs more renders.

        A render is whatever `raytwin.compare` takes. Renders of a side are independent. An Image that states
        `batches` of its own brings their variance. A render that repeats an earlier one counts once. If all are equal
        and differ from the other side, the verdict is undecided.
        """
        for name, given in (("test", test), ("reference", reference)):
            if given is None:
                continue
            image = self._taken(name, given)
            pool = self._pools[name]
            if pool.images and image.shape != pool.shape:
                raise InputError(f"{name} render {pool.images + 1}", f"the shape {pool.shape}", image.shape)
            pool.add(image)
        if self.decided:
            return self.comparison
        if any(pool.repeats_in_a_row >= REPEATS for pool in self._pools.values()):
            return self._give_up()
        if all(pool.images <= 1 for pool in self._pools.values()) and any(p.repeats for p in self._pools.values()):
            # Asked at the first repeat alone: further ones change neither side.
            first = any(pool.repeats_in_a_row == 1 for pool in self._pools.values())
            return self._pass_without_noise() if first else None
        noisy = [pool for pool in self._pools.values() if pool.images and not pool.noise_free]
        if self.samples < self.next_look and (noisy or self.samples < 2):
            return None
        return self._look(exact=not noisy)

    def conclude(self, spent: str = "") -> Comparison:
        """Return the verdict now that no more will come; `spent`: what ended it, in words, by default the samples."""
        if not self.decided and self.samples > self._looked_at:
            self._look()
        made = self.comparison
        if made is None:
            raise InputError("renders", "at least one", "none")
        if self.decided:
            return made
        enough = self._shortfall(made, *self.judging.detectable) <= 1
        if made.verdict == "pass" and enough and self.samples >= self.fewest_to_pass:
            return self._certain(made, f"all {spent or self._counted()} were taken")
        doubts = made.findings if made.verdict == "undecided" else notes([self._what_it_takes(made, spent)])
        self.comparison = made.judged("undecided", *doubts, *notes(self._repeated()))
        return self.comparison

    # ---------------------------------------------------------------------------------- within

    def _taken(self, name: str, given: Any) -> Image:
        """The given side as an Image. Remembers the rounding of its file format, which `half_steps` overrides."""
        if isinstance(given, Image):
            return given
        self._loaded[name] = as_image(given)
        return self._loaded[name].image

    def _judged(self, judging: Judging, **options: Any) -> Comparison:
        """Compare the renders so far."""
        options |= self._options
        test, reference = self.image("test"), self.image("reference")
        if any(loaded.rounding.half is not None for loaded in self._loaded.values()):
            none = LoadedImage(reference)
            halves = tuple(self._loaded.get(name, none).rounding.half for name in ("test", "reference"))
            options = {"half_steps": halves} | options
        return self._judge(test, reference, judging=judging, **options)

    def _pass_without_noise(self) -> Comparison | None:
        """Pass where all renders so far are equal, and agree with the other side as images without noise do."""
        made = self._judged(replace(self.judging, detectable_bias=None, detectable_tile_bias=None))
        return self._certain(made, EQUAL) if made.verdict == "pass" and made.statistics.z_mean is None else None

    def _give_up(self) -> Comparison:
        """The verdict where further renders would only repeat: nothing is known of the noise if all are equal."""
        if self._looked_at < self.samples:
            self._look(exact=True)
        made = self.comparison
        assert made is not None
        if made.verdict == "pass" and any(pool.repeats and pool.images > 1 for pool in self._pools.values()):
            made = made.judged("undecided")
        if made.verdict == "undecided":
            made = made.judged("undecided", *notes(f"undecided: {text}" for text in self._repeated()))
        self.comparison, self.decided = made, True
        return made

    def _repeated(self) -> tuple[str, ...]:
        """Which renders had the pixels of earlier ones, in words."""
        said = []
        for name, pool in self._pools.items():
            if pool.repeats:
                numbers = sorted({number for pair in pool.repeats for number in pair})
                listed = f"{', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"
                whose = "" if name == "test" else " of the reference"
                same = "the same image" if pool.images == 1 else "images that repeat"
                said.append(f"seeds {listed}{whose} gave {same}: does your program use {{seed}}?")
        return tuple(said)

    def _look(self, exact: bool = False) -> Comparison | None:
        """Compare the renders so far. `exact`: all renders are equal, so further ones tell nothing new."""
        n = self.samples
        self._number = max(look_number(n), self._number + 1)
        rate = self.judging.false_alarm_rate
        level = rate if exact else look_level(rate, self._number)
        at_look = replace(self.judging, false_alarm_rate=level, detectable_bias=math.inf, detectable_tile_bias=None)
        made = self._judged(at_look, sequence_rate=rate)
        self.looks, self._looked_at = self.looks + 1, n
        self.comparison = _with(made, looks=self.looks)
        known = made.statistics.z_mean is not None
        passed = made.verdict == "pass" and (
            exact or not known or (n >= self.fewest_to_pass and self._shortfall(made, *self._sought) <= 1)
        )
        if exact or passed or made.verdict == "fail":
            spent = f"{self._counted()} and {time.perf_counter() - self._began:.2g} s"
            said = EQUAL if exact else f"certain after {spent} ({self.looks} look{'s' * (self.looks > 1)})"
            return self._certain(self.comparison, said)
        self.next_look = self._next(made, n)
        return None

    def _certain(self, made: Comparison, said: str) -> Comparison:
        self.decided = True
        if made.verdict == "pass" and made.statistics.z_mean is not None:
            image, tile = self._seen(made)
            made = made.judged(
                "pass", *what_could_be_seen(image, tile, 1.0, self.judging.false_alarm_rate), *made.findings[1:]
            )
        made = made.saying(said, *self._repeated())
        if made.verdict != "undecided":
            made = _with(made, samples_to_certainty=self.samples)
        self.comparison = made
        return made

    def _counted(self) -> str:
        counted = all(pool.samples or not pool.images for pool in self._pools.values())
        return f"{self.samples} samples per pixel" if counted else f"{self.samples} renders"

    def _seen(self, made: Comparison) -> tuple[float, float]:
        """The biases of the whole image and of 24 x 24 pixels that would have been detected."""
        excluded, s = made.excluded_bias or 0.0, made.statistics
        image = min(s.minimum_detectable_bias or 0.0, max(excluded, self._sought[0]))
        # None: no tile is lit, or none would ever show.
        dark = math.inf if excluded else 0.0
        return image, dark if s.minimum_detectable_tile_bias is None else s.minimum_detectable_tile_bias

    def _shortfall(self, made: Comparison, image: float, tile: float) -> float:
        """The factor by which the biases that may go unnoticed exceed `image` and `tile`."""
        seen = self._seen(made)[1]
        return max((made.excluded_bias or 0.0) / image, 0.0 if math.isinf(tile) else seen / tile)

    def _next(self, made: Comparison, n: int) -> int:
        """Samples at the next look: early if a fault is suspected, else when a pass is expected. At most twice n."""
        soon, s = first_samples(self._number + 1), made.statistics
        if abs(s.z_mean or 0.0) > SUSPICIOUS_MEAN or abs(s.z_tile_worst or 0.0) > SUSPICIOUS_TILE:
            return soon
        factor = self._shortfall(made, *self._sought) if made.verdict == "pass" else math.inf
        expected = 2 * n if factor > 2 else math.ceil(EARLY * n * factor**2)
        return min(2 * n, max(soon, expected, self.fewest_to_pass))

    def _what_it_takes(self, made: Comparison, spent: str) -> str:
        if made.verdict == "pass" and self.samples < self.fewest_to_pass:
            after = f" after {spent}" if spent else ""
            return f"undecided{after}: {self._counted()} can fail, but a pass takes at least {self.fewest_to_pass}"
        image, tile = self.judging.detectable
        short, (_, seen) = self._shortfall(made, image, tile), self._seen(made)
        short = max(short, (made.statistics.minimum_detectable_bias or 0.0) / image)
        more = f"about {_rounded(self.samples * short**2)} would decide" if 1 < short < math.inf else "more may decide"
        found = f"{percent(made.excluded_bias or 0.0)} of the whole image's mean (asked {percent(image)})"
        if math.isfinite(tile):
            found += f", or of {percent(seen)} of 24 x 24 pixels (asked {percent(tile)})"
        return f"undecided: after {spent or self._counted()} an error of {found} could go unnoticed: {more}"


def _with(made: Comparison, **numbers: float | None) -> Comparison:
    return msgspec.structs.replace(made, statistics=msgspec.structs.replace(made.statistics, **numbers))


def _rounded(samples: float) -> str:
    """Two digits.

    >>> _rounded(12345.0)
    '12000'
    """
    return f"{float(f'{samples:.2g}'):.0f}"
