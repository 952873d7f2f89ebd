"""Trying mistakes on the pixels of a submission: few pixels first, then all of them for what costs least.

The cost of errors e is Σ log(1 + (e/τ)²), minus the log likelihood of values that are either hit closely or missed by
any amount, so that a few odd pixels decide nothing. How much is tried depends on the pictures alone, never on the
clock.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from raytwin.explain.catalogue import equivalent_forms
from raytwin.explain.changes import CAMERA, Fault
from raytwin.explain.evidence import fit_of, shows, total
from raytwin.explain.explanation import Cause
from raytwin.explain.parametric_faults import ParametricFault, nearer
from raytwin.explain.pixel_sample import PixelSample
from raytwin.explain.predict import NO_MISTAKE, Pipeline

MANY_OBJECTS = 64
"""Number of objects above which no numbers are fitted and no other forms are tried: both take 90 % of the time."""
SCREEN_STRIDE = 4
"""Every fault is tried on every so many-th of the sampled pixels first."""
COARSE_STRIDE = 3
"""Many faults are tried on every so many-th of those pixels before."""
FINALISTS = 24
"""Hypotheses of least cost that are compared on all sampled pixels."""
CLEAR_COST_SHARE = 0.05
"""Where a fault leaves less than this share of the cost, those that leave more than RIVAL_COST_SHARE are dropped."""
RIVAL_COST_SHARE = 0.5
"""Share of the cost above which a fault is dropped beside a clear one."""
TRIED_ON_ALL_WITHIN = 4
"""Multiple of the best cost on few pixels above which a fault is not tried on all."""
MAX_FAULTS_IN_OTHER_FORMS = 16
"""Best faults that are tried in every equivalent form of the tracer."""
EQUAL_COST = 5e-4
"""Share of the unexplained cost by which causes may differ and still count as equally good."""
TIED_COST = 0.01
"""Difference of two costs of one view that tells nothing."""
MAX_VIEWS_FITTED = 3
"""Most wrong views on which the first step of every fit is tried."""
MAX_FAMILIES_FITTED = 5
"""Families that are fitted to the end: those whose first step explains most."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What is tried: a cause, the steps that make it, and their cost. `usual`: in the first of its ways."""

    cause: Cause
    steps: Pipeline
    cost: float = np.inf
    usual: bool = True


@dataclass(eq=False)
class Search:
    """The samples of all views, and one in SCREEN_STRIDE of their pixels (`few`), the most wrong view first.

    `unexplained`: the cost without any cause.
    """

    samples: list[PixelSample]
    few: list[PixelSample] = field(init=False)
    unexplained: float = field(init=False)

    def __post_init__(self) -> None:
        few = sorted(
            (s.only(slice(None, None, SCREEN_STRIDE)) for s in self.samples), key=lambda s: -total([s], NO_MISTAKE)
        )
        other = next((s for s in few if s.view.rung != few[0].view.rung), few[0])
        self.few = sorted(few, key=lambda s: (s is not few[0], s is not other))
        self.unexplained = total(self.samples, NO_MISTAKE)

    def causes(self, faults: Sequence[Fault], families: Sequence[ParametricFault] = ()) -> list[Hypothesis]:
        """The causes that cost least, the best first; of families where no fault leaves nothing."""
        ways = [
            Hypothesis(Cause(f.name, f.stage, f.sentence), way, usual=not k)
            for f in faults for k, way in enumerate(f.ways)
        ]  # fmt: skip
        tried = self._screened(ways)
        objects = max(len(s.view.scene.objects) if s.view.scene else 0 for s in self.samples)
        forms = [replace(g, steps=form) for g in self._tempting(tried) for form in equivalent_forms(g.steps)]
        tried += self._screened(forms if objects <= MANY_OBJECTS else [])
        tried = sorted(tried, key=lambda g: g.cost)[:FINALISTS]
        near = [g for g in tried if g.cost < TRIED_ON_ALL_WITHIN * tried[0].cost + 1e-2 * self.unexplained]
        found = ranked(
            [replace(g, cost=total(self.samples, g.steps)) for g in near], faults, EQUAL_COST * self.unexplained
        )
        if families and objects <= MANY_OBJECTS and not (found and fit_of(self.samples, found[0].steps).is_good):
            found = sorted((*found, *self._fitted(families)), key=lambda g: g.cost)
        return found

    def _tempting(self, tried: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The best way of each fault that may be meant; another camera meets surfaces correctly."""
        best = {guess.cause.name: guess for guess in reversed(tried)}
        some = sorted(best.values(), key=lambda g: g.cost)[:MAX_FAULTS_IN_OTHER_FORMS]
        if some and some[0].cost < CLEAR_COST_SHARE * self.unexplained:
            some = [g for g in some if EQUAL_COST * self.unexplained < g.cost < RIVAL_COST_SHARE * self.unexplained]
        return [g for g in some if g.cause.stage != CAMERA]

    def _screened(self, guesses: list[Hypothesis]) -> list[Hypothesis]:
        """Those that cost least, by one view after the other; a quarter is left each time, and what costs hardly more.

        Many are tried on a third of the first view's pixels before.
        """
        sums, wrong, views = np.zeros(len(guesses)), 0.0, self.few
        if len(guesses) > 2 * FINALISTS:
            views = [views[0].only(slice(None, None, COARSE_STRIDE)), *views]
        for sample in views:
            sums = sums + [sample.cost(sample.errors(guess.steps)) for guess in guesses]
            wrong += total([sample], NO_MISTAKE)
            few = max(FINALISTS, sums.size // 4)
            limit = float(np.sort(sums)[few - 1]) + TIED_COST if few < sums.size else np.inf
            if sums.size and sums.min() < CLEAR_COST_SHARE * wrong:  # where one explains all, the others have to
                limit = min(limit, RIVAL_COST_SHARE * wrong)
            chosen = [int(k) for k in np.argsort(sums, kind="stable") if sums[k] <= limit]
            guesses, sums = [guesses[k] for k in chosen], sums[chosen]
        return [replace(g, cost=cost / len(views)) for g, cost in zip(guesses, sums.tolist(), strict=True)]

    def _fitted(self, families: Sequence[ParametricFault]) -> Iterator[Hypothesis]:
        """The numbers that explain most, of the families that are worth fitting."""
        begun = []
        for family in families:
            steps = (nearer(family, self.few[:MAX_VIEWS_FITTED], p, 1) for p in (family.start, *family.tries))
            begun.append((*min(steps, key=lambda x: x[1]), family))
        for p, _, family in sorted(begun, key=lambda x: x[1])[:MAX_FAMILIES_FITTED]:
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
