"""Render both sides in rounds until the verdict is certain: no sample is thrown away, and none is rendered twice."""

import itertools
import math
import re
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from raytwin.compare import Comparison, SequentialComparison
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.images.image_input import one_batch
from raytwin.progress import Stages
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.user_renderers import UserRenderer

if TYPE_CHECKING:
    from raytwin.study.settings import CompareSettings

MOST_SAMPLES = 1024
"""Samples per pixel of either side that are taken at most, unless a budget is given."""

FEWEST_TO_PASS_UNLIKE = 32
"""Samples per pixel that a pass takes where the sides have different light: most edges show from 16 on."""

CALLS = 4
"""Renders of a user's program in a round: without several nothing is known of its noise."""

Render = Callable[[int, int], Image]
"""(samples, seed) -> an image that is independent of those of other seeds."""

UNITS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


class Budget(NamedTuple):
    """What may be spent: samples per pixel of either side, seconds. `words`: as the user said it."""

    samples: float = MOST_SAMPLES
    seconds: float = math.inf
    words: str = ""


def parse_budget(text: str) -> Budget:
    """
    >>> parse_budget("256"), parse_budget("1.5min").seconds
    (Budget(samples=256.0, seconds=inf, words=''), 90.0)
    """
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|min|h|)\s*", text)
    number = float(match[1]) if match else 0.0
    if not match or not number > 0 or (not match[2] and number != int(number)):
        raise InputError("--budget", "samples per pixel, as 256, or a time, as 30s, 5min or 1h", text)
    if not match[2]:
        return Budget(samples=number)
    return Budget(samples=math.inf, seconds=number * UNITS[match[2]], words=f"{text.strip()} of the budget")


def round_seed(seed: int, number: int) -> int:
    """Return a round's own seed: the same in every run, so that the cache has what an earlier run rendered."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


class Rounds:
    """The rounds of one comparison. A side whose `Render` is None stays what `check` was made with.

    `calls`: at most this many renders of the test per round (`calls_per_round`), of seeds 0, 1, 2 and so on;
    `reference_calls`: likewise.
    """

    def __init__(
        self,
        check: SequentialComparison,
        test: Render | None,
        reference: Render | None,
        seed: int,
        stages: Stages,
        calls: float = 1,
        reference_calls: float = 1,
    ) -> None:
        self.check, self.seed, self.stages = check, seed, stages
        self.calls = {"test": calls, "reference": reference_calls}
        self._sides = {"test": (test, "tracer"), "reference": (reference, "twin")}
        self._made = {"test": 0, "reference": 0}

    def decide(self, budget: Budget) -> Comparison:
        """Render and look until the verdict is certain or the budget is spent."""
        began = time.perf_counter()
        while not self.check.decided:
            have, spent = self.check.samples, time.perf_counter() - began
            if have >= budget.samples or (have and spent > budget.seconds):
                return self.check.conclude(budget.words)
            self.render(int(min(self.check.next_look, budget.samples)) - have)
        assert self.check.comparison is not None
        return self.check.comparison

    def extend(self, samples: int) -> None:
        """Render up to so many samples per pixel, for those who look at the images: the verdict stands."""
        if self.check.samples < samples:
            self.render(samples - self.check.samples)

    def render(self, samples: int) -> None:
        """Add so many samples per pixel to each side, and look where it is time to."""
        made: dict[str, list[Image]] = {"test": [], "reference": []}
        for side, (render, stage) in self._sides.items():
            if render is None:
                continue
            parts = _parts(samples, self.calls[side])
            with self.stages.stage(stage):
                made[side] = [render(count, self._seed(side)) for count in parts]
        with self.stages.stage("compare"):
            for test, reference in itertools.zip_longest(made["test"], made["reference"]):
                self.check.add(test, reference)

    def _seed(self, side: str) -> int:
        self._made[side] += 1
        number = self._made[side] - 1
        return number if side == "test" and self.calls[side] > 1 else round_seed(self.seed, number)


def _parts(samples: int, most: float) -> list[int]:
    """So many samples in `most` parts, as even as can be; no more parts than samples."""
    count = int(min(most, samples))
    return [samples // count + (i < samples % count) for i in range(count)]


def calls_per_round(subject: Renderer) -> float:
    """Return how often a renderer is called in a round: once, or as often as it takes to know its noise.

    It is infinity for a program that cannot be asked for several samples at once.
    """
    if not (isinstance(subject, UserRenderer) and subject.noisy):
        return 1
    return CALLS if subject.samples else math.inf


def sample_more(subject: Renderer, scene: Any) -> Render:
    """Return what renders further samples of a scene; the image of a renderer without noise, whatever is asked for."""

    def render(samples: int, seed: int) -> Image:
        if not subject.noisy:
            return subject(scene, seed)
        if not isinstance(subject, UserRenderer):
            return subject.with_samples(samples)(scene, seed)
        image = replace(subject, renders=1, samples=samples if subject.samples else 0)(scene, seed)
        return image if subject.samples else one_batch(image)

    return render


ENOUGH_FOR_A_CAUSE = 64
"""Samples per pixel of an image that fails: a cause is hard to find in noise."""


def render_sides(
    subject: Renderer, scene: Any, reference: Render, judge: Callable[..., Comparison], chosen: "CompareSettings",
    stages: Stages, noisy: bool, alike: bool = True,
) -> tuple[Image, Image, Comparison]:  # fmt: skip
    """Return the subject's image, the `reference`, and what `judge` says of them.

    Both come in rounds, but where all samples are alike, or their number is given. `noisy`: the reference is. `alike`:
    both have the same light; a subject with other light and noise of its own is compared at its own level, which is
    done once.
    """
    # A method's name says its samples.
    takes = subject.noisy and (isinstance(subject, UserRenderer) or not chosen.subject)
    if chosen.samples is not None or not (noisy or takes) or (takes and not alike):
        if isinstance(subject, UserRenderer) and subject.samples:
            subject = subject.with_samples(max(1, chosen.twin_samples // subject.renders))
        with stages.stage("tracer"):
            made = subject(scene, chosen.seed)
        with stages.stage("twin"):
            right = reference(chosen.twin_samples, chosen.seed)
        with stages.stage("compare"):
            return made, right, judge(made, right, judging=chosen.judging)

    fixed: dict[str, Image] = {}
    with stages.stage("tracer"):
        fixed |= {} if takes else {"test": subject(scene, chosen.seed)}
    with stages.stage("twin"):
        fixed |= {} if noisy else {"reference": reference(1, chosen.seed)}
    fewest = {} if alike else {"fewest_to_pass": FEWEST_TO_PASS_UNLIKE}
    check = SequentialComparison(
        fixed.get("reference"), test=fixed.get("test"), judge=judge, judging=chosen.judging, **fewest
    )
    test, twin = sample_more(subject, scene) if takes else None, reference if noisy else None
    rounds = Rounds(check, test, twin, chosen.seed, stages, calls_per_round(subject))
    found = rounds.decide(chosen.spending)
    if found.verdict == "fail" and alike:
        rounds.extend(ENOUGH_FOR_A_CAUSE)
    return check.image("test"), check.image("reference"), found
