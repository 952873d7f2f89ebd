"""Trying mistakes on the pixels of a submission: few pixels first, then all of them for what costs least.

The cost of errors e is Σ log(1 + (e/τ)²), minus the log likelihood of values that are either hit closely or missed by
any amount, so that a few odd pixels decide nothing. How much is tried depends on the pictures alone: a search ends
early only after STOPPED seconds, many times what it takes.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from raytwin.explain.catalogue import equivalent_forms
from raytwin.explain.changes import CAMERA, Fault
from raytwin.explain.evidence import fit_of, shows, total
from raytwin.explain.explanation import Cause
from raytwin.explain.parametric_faults import ParametricFault, nearer
from raytwin.explain.pixel_sample import PixelSample
from raytwin.explain.predict import RIGHT, Pipeline

STOPPED = 600.0
"""Wall-clock seconds, a safety net: a hundred times what a search takes, and 20 times that of the largest scenes."""
CROWD = 64
"""Objects, beyond which no numbers are fitted and no other forms are tried: that takes nine predictions of ten."""
SCREEN = 4
"""Every fault is tried on one in so many of the pixels first."""
COARSE_STRIDE = 3
"""Where faults are many, they are tried on one in so many of these pixels before."""
FINALISTS = 24
"""Hypotheses that are compared on all pixels, those of least cost: more cost time."""
CLEAR = 0.05
"""Share of the cost: where a fault leaves less, one that leaves more than RIVAL_COST_SHARE is dropped."""
RIVAL_COST_SHARE = 0.5
"""Share of the cost above which a fault is dropped beside a CLEAR one."""
CLOSE = 4
"""Multiple of the best cost on few pixels above which a fault is not tried on all."""
TEMPTING = 16
"""Faults that are tried with every equivalent form."""
EVEN = 5e-4
"""Share of the cost without any cause: causes that differ by less are equally good."""
TIED = 0.01
"""Costs of one view that tell nothing apart."""
VIEWS_FITTED = 3
"""Views, the most wrong ones, on which it is seen which numbers are worth fitting."""
FITS = 5
"""Families whose numbers are fitted to the end, of those whose first step explains most."""


class StoppedEarly(Exception):
    """The net has caught a search."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What is tried: a cause, the steps that make it, and their cost. `usual`: in the first of its ways."""

    cause: Cause
    steps: Pipeline
    cost: float = np.inf
    usual: bool = True


@dataclass(eq=False)
class Search:
    """The samples of all views, and one in SCREEN of their pixels (`few`), the most wrong view first.

    `unexplained`: the cost without any cause.
    """

    samples: list[PixelSample]
    few: list[PixelSample] = field(init=False)
    unexplained: float = field(init=False)
    began: float = field(init=False)

    def __post_init__(self) -> None:
        few = sorted((s.only(slice(None, None, SCREEN)) for s in self.samples), key=lambda s: -total([s], RIGHT))
        other = next((s for s in few if s.view.rung != few[0].view.rung), few[0])
        self.few = sorted(few, key=lambda s: (s is not few[0], s is not other))
        self.unexplained = total(self.samples, RIGHT)
        self.began = time.monotonic()

    def causes(self, faults: Sequence[Fault], families: Sequence[ParametricFault] = ()) -> list[Hypothesis]:
        """The causes that cost least, the best first; of families where no fault leaves nothing."""
        ways = [
            Hypothesis(Cause(f.name, f.stage, f.sentence), way, usual=not k)
            for f in faults for k, way in enumerate(f.ways)
        ]  # fmt: skip
        tried = self._screened(ways)
        objects = max(len(s.view.scene.objects) if s.view.scene else 0 for s in self.samples)
        forms = [replace(g, steps=form) for g in self._tempting(tried) for form in equivalent_forms(g.steps)]
        tried += self._screened(forms if objects <= CROWD else [])
        tried = sorted(tried, key=lambda g: g.cost)[:FINALISTS]
        near = [g for g in tried if g.cost < CLOSE * tried[0].cost + 1e-2 * self.unexplained]
        found = ranked([self._weighed(g) for g in near], faults, EVEN * self.unexplained)
        if families and objects <= CROWD and not (found and fit_of(self.samples, found[0].steps).is_good):
            found = sorted((*found, *self._fitted(families)), key=lambda g: g.cost)
        return found

    def _in_time(self) -> None:
        if time.monotonic() - self.began > STOPPED:
            raise StoppedEarly

    def _weighed(self, guess: Hypothesis) -> Hypothesis:
        """With its cost on all pixels."""
        self._in_time()
        return replace(guess, cost=total(self.samples, guess.steps))

    def _tempting(self, tried: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The best way of each fault that may be meant; another camera meets surfaces correctly."""
        best = {guess.cause.name: guess for guess in reversed(tried)}
        some = sorted(best.values(), key=lambda g: g.cost)[:TEMPTING]
        if some and some[0].cost < CLEAR * self.unexplained:
            some = [g for g in some if EVEN * self.unexplained < g.cost < RIVAL_COST_SHARE * self.unexplained]
        return [g for g in some if g.cause.stage != CAMERA]

    def _screened(self, guesses: list[Hypothesis]) -> list[Hypothesis]:
        """Those that cost least, by one view after the other; a quarter is left each time, and what costs hardly more.

        Many are tried on a third of the first view's pixels before.
        """
        sums, wrong, views = np.zeros(len(guesses)), 0.0, self.few
        if len(guesses) > 2 * FINALISTS:
            views = [views[0].only(slice(None, None, COARSE_STRIDE)), *views]
        for sample in views:
            sums = sums + list(self._costs(sample, guesses))
            wrong += total([sample], RIGHT)
            few = max(FINALISTS, sums.size // 4)
            limit = float(np.sort(sums)[few - 1]) + TIED if few < sums.size else np.inf
            if sums.size and sums.min() < CLEAR * wrong:  # where one explains all, the others have to
                limit = min(limit, RIVAL_COST_SHARE * wrong)
            chosen = [int(k) for k in np.argsort(sums, kind="stable") if sums[k] <= limit]
            guesses, sums = [guesses[k] for k in chosen], sums[chosen]
        return [replace(g, cost=cost / len(views)) for g, cost in zip(guesses, sums.tolist(), strict=True)]

    def _costs(self, sample: PixelSample, guesses: Sequence[Hypothesis]) -> Iterator[float]:
        for guess in guesses:
            self._in_time()
            yield sample.cost(sample.errors(guess.steps))

    def _fitted(self, families: Sequence[ParametricFault]) -> Iterator[Hypothesis]:
        """The numbers that explain most, of the families that are worth fitting."""
        begun = []
        for family in families:
            self._in_time()
            steps = (nearer(family, self.few[:VIEWS_FITTED], p, 1) for p in (family.start, *family.tries))
            begun.append((*min(steps, key=lambda x: x[1]), family))
        for p, _, family in sorted(begun, key=lambda x: x[1])[:FITS]:
            self._in_time()
            p, _ = nearer(family, self.few, p)
            if total(self.few, family.make(p)) > 0.9 * self.unexplained:
                continue
            p, _ = nearer(family, self.samples, p)
            if not family.possible(p) or not shows(self.samples, family.make(p)):
                continue
            scenes = [s.view.scene for s in self.samples if s.view.scene]
            cause = Cause(family.name, family.stage, family.sentence(p, scenes), len(p))
            cost = total(self.samples, family.make(p)) + 0.01 * self.unexplained * len(p)
            yield Hypothesis(cause, family.make(p), cost)


def ranked(guesses: Sequence[Hypothesis], faults: Sequence[Fault], even: float) -> list[Hypothesis]:
    """The best way of each fault, by cost alone; then the other ways. Of faults that cost the same (but for `even`) the
    one that is seen in its usual form comes first, then the one that stands first in the catalogue.
    """
    rank = {f.name: k for k, f in enumerate(faults)}
    guesses = sorted(guesses, key=lambda g: g.cost)
    best = {g.cause.name: g for g in reversed(guesses)}
    usual = {g.cause.name for g in guesses if g.usual and g.cost <= best[g.cause.name].cost + even}
    place = {name: (round(g.cost / max(even, 1e-12)), name not in usual, rank[name]) for name, g in best.items()}
    first = [best[name] for name in sorted(place, key=lambda name: place[name])]
    return [*first, *(g for g in guesses if g is not best[g.cause.name])]
