"""How well a change of the tracer explains pictures: what it hits, what it spoils, whether noise could do it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from raytwin.explain.pixel_sample import PixelSample
from raytwin.explain.predict import NO_MISTAKE, Array, Pipeline

NOTHING_LEFT = 0.995
"""Share of the squared error that is explained by what leaves nothing."""
ROUNDED_WITHIN = 3e-5
"""Share of the scale that single precision may round off."""
MAX_SHARE_LOOSE = 0.01
"""Share of the pixels that may be off by more."""
SIGNIFICANT = 4.0
"""Standard errors by which a cause has to bring noisy pixels nearer."""
MAX_SQUARED_SIGMAS = 25.0
"""Squared standard deviations: a noisy pixel that is farther off counts as this far."""


class Fit(NamedTuple):
    """`hit`: share of the wrong pixels that is predicted; `kept`: of the correct ones that stays correct; `explained`:
    of the squared error; `least`: of the view that is explained least; `exact`: nearly all is hit to rounding.
    """

    hit: float
    kept: float
    explained: float
    least: float
    exact: bool

    @property
    def is_good(self) -> bool:
        """Nothing is left to be explained."""
        return self.kept > 0.99 and self.hit > 0.95 and (self.hit > 0.98 or self.explained > NOTHING_LEFT)


def total(samples: Sequence[PixelSample], steps: Pipeline) -> float:
    """The mean cost."""
    return float(np.mean([s.cost(s.errors(steps)) for s in samples]))


def fit_of(samples: Sequence[PixelSample], steps: Pipeline) -> Fit:
    """How well the change explains the views.

    A wrong pixel is hit where at most half of its error is left: it may be wrong by hardly more than the tolerance.
    """
    shares = np.zeros((2, 2))  # correct or wrong before; missed or hit
    before, after, off = (np.zeros(len(samples)) for _ in range(3))
    for k, s in enumerate(samples):
        e = s.errors(steps)
        hit = (e <= 4 * s.tau) & (~s.wrong | (e <= s.errors(NO_MISTAKE) / 2))
        np.add.at(shares, (s.wrong.astype(int), hit.astype(int)), s.weight)
        before[k], after[k] = (s.squared(s.predict(way)) for way in (NO_MISTAKE, steps))
        off[k] = (s.weight * (e > ROUNDED_WITHIN * s.scale)).sum()
    kept, hit_share = (float(many / (none + many)) if none + many > 0 else 1.0 for none, many in shares)
    all_before = max(before.sum(), 1e-300)
    spoiled = (before <= 1e-6 * all_before) & (after > 1e-6 * all_before)
    wrong = before > 1e-6 * all_before
    each = np.where(spoiled, 0.0, 1 - after / np.maximum(before, 1e-300))[spoiled | wrong]
    explained = float(1 - after.sum() / all_before) if before.sum() > 0 else 0.0
    return Fit(hit_share, kept, explained, float(each.min(initial=1.0)), bool(off.max() < MAX_SHARE_LOOSE))


def shows(samples: Sequence[PixelSample], steps: Pipeline) -> bool:
    """Whether the change exceeds the tolerance anywhere."""
    with np.errstate(invalid="ignore"):
        return any((~(np.abs(s.predict(steps) - s.predict(NO_MISTAKE)) <= s.tau)).any() for s in samples)


def is_firm(samples: Sequence[PixelSample]) -> bool:
    """Whether most of the wrong pixels are wrong beyond all noise."""
    wrong, firm = 0.0, 0.0
    for s in samples:
        off = np.abs(s.shown - s.predict(NO_MISTAKE)) - 2 * s.slack > s.tau
        wrong += float((s.weight * s.wrong).sum())
        firm += float((s.weight * (s.wrong & off.any(axis=-1))).sum())
    return firm > wrong / 2


def is_likelier(samples: Sequence[PixelSample], steps: Pipeline) -> bool:
    """Whether the cause brings pixels that have noise nearer, by more than the best of many causes does by chance.

    Within the noise it may move them any way. Where pixels without noise are wrong, they speak for themselves.
    """
    gains = []
    for s in samples:
        sigma = np.where(s.slack > 0, s.slack / 3, np.inf)
        with np.errstate(invalid="ignore", over="ignore"):
            before, after = (
                np.minimum(np.square((s.shown - made) / sigma), MAX_SQUARED_SIGMAS)
                for made in (s.predict(NO_MISTAKE), s.predict(steps))
            )
        gains.append(s.weight * np.nan_to_num(before - after).sum(axis=-1))
    gain = np.concatenate(gains)
    if is_firm(samples) or not any(np.any(s.slack > 0) for s in samples):
        return bool(gain.sum() >= 0)
    return bool(gain.sum() > SIGNIFICANT * np.sqrt(np.square(gain).sum()))


def are_alike(sample: PixelSample, a: Array, b: Array) -> bool:
    """Two predictions that these pixels do not tell apart."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(a - b) - sample.slack
    if sample.view.points:
        apart = np.where(np.isnan(a) & np.isnan(b), 0.0, apart)
    return float((sample.weight * ~(apart.max(axis=-1) <= 4 * sample.tau)).sum()) < 1e-3
