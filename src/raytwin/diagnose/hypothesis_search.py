"""Trying mistakes on the pixels of a submission: few pixels first, then all of them for what costs least.

The cost of errors e is Σ log(1 + (e/τ)²), minus the log likelihood of values that are either hit closely or missed by
any amount, so that a few odd pixels decide nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from raytwin.diagnose.budget import Budget
from raytwin.diagnose.catalogue import equivalent_forms
from raytwin.diagnose.certainty import is_good, shows
from raytwin.diagnose.changes import CAMERA, Fault
from raytwin.diagnose.explanation import Cause
from raytwin.diagnose.parametric_faults import ParametricFault, fit, promising, total
from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import RIGHT, Array, Pipeline

SCREEN = 4
"""Every fault is tried on one in so many of the pixels first."""
THIN = 3
"""Where faults are many, they are tried on one in so many of these pixels before."""
FINALISTS = 24
"""Hypotheses that are compared on all pixels, those of least cost: more cost time."""
CLEAR = 0.1
"""Share of the cost: fit no numbers once less than this is left."""
CLOSE = 4
"""Multiple of the best cost on few pixels above which a fault is not tried on all."""
TEMPTING = 16
"""Faults that are tried with every equivalent form."""
EVEN = 5e-4
"""Share of the cost without any cause: causes that differ by less are equally good."""
NEAR = 0.5
"""Share of the cost: a fault that leaves more is dropped once another leaves hardly any."""
TIED = 0.01
"""Costs of one view that tell nothing apart."""
SOME = 3
"""Views, the most wrong ones, on which it is seen which numbers are worth fitting."""
FITS = 5
"""Faults whose numbers are fitted to the end, of those whose first step explains most."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What is tried: a cause, the steps that make it, and their cost. `typical`: in the first of its ways."""

    cause: Cause
    steps: Pipeline
    cost: float = np.inf
    typical: bool = True


@dataclass(eq=False)
class Search:
    """The samples of all views, one in so many of their pixels (`small`), and the time that is left.

    `unexplained`: the cost without any cause.
    """

    samples: list[PixelSample]
    budget: Budget
    small: list[PixelSample] = field(init=False)
    unexplained: float = field(init=False)

    def __post_init__(self) -> None:
        self.small = [s.only(slice(None, None, SCREEN)) for s in self.samples]
        self.unexplained = total(self.samples, RIGHT)

    def weighed(self, guess: Hypothesis) -> Hypothesis:
        """With its cost on all pixels."""
        return replace(guess, cost=total(self.samples, guess.steps))

    def explained_by(self, found: Sequence[Hypothesis]) -> bool:
        """Whether the best leaves nothing to be explained."""
        return bool(found) and is_good(self.samples, found[0].steps)

    def causes(self, faults: Sequence[Fault], families: Sequence[ParametricFault] = ()) -> list[Hypothesis]:
        """Return the causes that cost least, the best first."""
        ways = [
            Hypothesis(Cause(f.name, f.stage, f.sentence), way, typical=not k)
            for f in faults for k, way in enumerate(f.ways)
        ]  # fmt: skip
        exact = ranked(self._in_other_forms(self._screened(ways)), faults, EVEN * self.unexplained)
        if not families or (exact and exact[0].cost < CLEAR * self.unexplained and self.explained_by(exact)):
            return exact
        return sorted((*exact, *self._fitted(families)), key=lambda g: g.cost)

    def _fitted(self, families: Sequence[ParametricFault]) -> list[Hypothesis]:
        """The numbers that explain most, of the faults that are worth fitting and that there is time for."""
        over, fitted = (lambda: self.budget.over), []
        for family in promising(families, self._order()[:SOME], FITS, over):
            if over():
                break
            p, cost = fit(family, self.small, over)
            if cost > 0.9 * self.unexplained:
                continue
            p, cost = fit(replace(family, start=p, tries=()), self.samples, over)
            if not family.possible(p) or not shows(self.samples, family.make(p)):
                continue
            cause = Cause(family.name, family.stage, family.sentence(p, self._scenes()), len(p))
            fitted.append(Hypothesis(cause, family.make(p), cost + 0.01 * self.unexplained * len(p)))
        return fitted

    def _scenes(self) -> list[Any]:
        return [s.view.scene for s in self.samples if s.view.scene]

    def _in_other_forms(self, tried: list[Hypothesis]) -> list[Hypothesis]:
        """The best, each also with what right tracers do in one way or another; their cost on all pixels."""
        best = {guess.cause.name: guess for guess in reversed(tried)}
        some = sorted(best.values(), key=lambda g: g.cost)[:TEMPTING]
        if some and some[0].cost < CLEAR / 2 * self.unexplained:
            some = [g for g in some if EVEN * self.unexplained < g.cost < NEAR * self.unexplained]
        # Another camera meets surfaces correctly.
        some = [g for g in some if g.cause.stage != CAMERA]
        forms = [replace(g, steps=form, cost=np.inf) for g in some for form in equivalent_forms(g.steps)]
        tried += self._screened(forms)
        tried = sorted(tried, key=lambda g: g.cost)[:FINALISTS]
        near = [g for g in tried if g.cost < CLOSE * tried[0].cost + 1e-2 * self.unexplained]
        return [self.weighed(g) for k, g in enumerate(near) if not (k and self.budget.over)]

    def _screened(self, guesses: list[Hypothesis]) -> list[Hypothesis]:
        """Those that cost least, by one view after the other; a quarter is left each time, and what costs hardly more.

        Many are tried on a third of the first view's pixels before.
        """
        sums, wrong, views, order = np.zeros(len(guesses)), 0.0, 0, self._order()
        if len(guesses) > 2 * FINALISTS:
            order = [order[0].only(slice(None, None, THIN)), *order]
        for sight in order:
            each: list[float] = []
            for guess in guesses:
                if self.budget.over:
                    break
                each.append(sight.cost(sight.errors(guess.steps)))
            if len(each) < len(guesses) and views:
                break  # what is left was tried on some views
            guesses, sums, views = guesses[: len(each)], sums[: len(each)] + each, views + 1
            wrong += total([sight], RIGHT)
            limit = _limit(sums, wrong)
            chosen = [int(k) for k in np.argsort(sums, kind="stable") if sums[k] <= limit]
            guesses, sums = [guesses[k] for k in chosen], sums[chosen]
        return [replace(guess, cost=cost / max(views, 1)) for guess, cost in zip(guesses, sums.tolist(), strict=True)]

    def _order(self) -> list[PixelSample]:
        """The view that is most wrong, then the one of another rung that is, then the others."""
        worst = sorted(self.small, key=lambda s: -total([s], RIGHT))
        second = next((s for s in worst if s.view.rung != worst[0].view.rung), worst[0])
        return [worst[0], *([second] if second is not worst[0] else []), *(s for s in worst[1:] if s is not second)]


def _limit(sums: Array, wrong: float) -> float:
    """The cost up to which a hypothesis stays, of `wrong` without any: where one explains all, the others have to."""
    few = max(FINALISTS, sums.size // 4)
    limit = float(np.sort(sums)[few - 1]) + TIED if few < sums.size else np.inf
    return min(limit, NEAR * wrong) if sums.size and sums.min() < CLEAR / 2 * wrong else limit


def ranked(guesses: Sequence[Hypothesis], faults: Sequence[Fault], even: float) -> list[Hypothesis]:
    """The best way of each fault, by cost alone; then the other ways. Of faults that cost the same (but for `even`) the
    one that is seen in its typical form comes first, then the one that stands first in the catalogue.
    """
    rank = {f.name: k for k, f in enumerate(faults)}
    best: dict[str, Hypothesis] = {}
    others = []
    usual = set()
    for guess in sorted(guesses, key=lambda g: g.cost):
        name = guess.cause.name
        if best.setdefault(name, guess) is not guess:
            others.append(guess)
        if guess.typical and guess.cost <= best[name].cost + even:
            usual.add(name)
    place = {name: (round(g.cost / max(even, 1e-12)), name not in usual, rank[name]) for name, g in best.items()}
    return [*(best[name] for name in sorted(place, key=lambda n: place[n])), *others]
