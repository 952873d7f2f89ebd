"""How well a change of the tracer explains what is wrong: what it hits, what it leaves, whether noise could do it."""

from collections.abc import Sequence

import numpy as np

from raytwin.diagnose.localize import whereabouts
from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import RIGHT, Array, Pipeline
from raytwin.diagnose.tolerance_mask import doubtful

SURE = 0.995
"""Share of the squared error that is explained by what leaves nothing."""

DOUBTED = 0.1
"""Share of the pixels: if more stay wrong, differences between right tracers do not explain it."""

ROUNDED = 3e-5
"""Share of the scale that single precision may round off."""

LOOSE = 0.01
"""Share of the pixels that may be off by more."""

SIGNIFICANT = 4.0
"""Standard errors by which a cause has to bring noisy pixels nearer."""

FAR = 25.0
"""Squared standard deviations: a noisy pixel that is farther off counts as this far."""


def shows(samples: Sequence[PixelSample], steps: Pipeline) -> bool:
    """Whether the change exceeds the tolerance anywhere."""
    with np.errstate(invalid="ignore"):
        return any((~(np.abs(s.predict(steps) - s.predict(RIGHT)) <= s.tau)).any() for s in samples)


def explained_share(samples: Sequence[PixelSample], steps: Pipeline) -> tuple[float, Array]:
    """The share of the squared error that is explained, of all and of each view (NaN where that was right before)."""
    before = np.array([s.squared(s.predict(RIGHT)) for s in samples])
    after = np.array([s.squared(s.predict(steps)) for s in samples])
    whole = 1 - after.sum() / before.sum() if before.sum() > 0 else 0.0
    some = before > 1e-6 * before.sum()
    with np.errstate(all="ignore"):
        each = np.where(some, 1 - after / before, np.where(after > 1e-6 * before.sum(), 0.0, np.nan))
    return float(whole), each


def is_good(samples: Sequence[PixelSample], steps: Pipeline) -> bool:
    """Nothing is left to be explained."""
    hit, kept = hit_shares(samples, steps)
    return kept > 0.99 and hit > 0.95 and (hit > 0.98 or explained_share(samples, steps)[0] > SURE)


def hit_shares(samples: Sequence[PixelSample], steps: Pipeline) -> tuple[float, float]:
    """Return the share of wrong pixels that is predicted closely, and the share of right ones that stays right.

    A wrong pixel is hit where at most half of its error is left: it may be wrong by hardly more.
    """
    hit = []
    for s in samples:
        e = s.errors(steps)
        hit.append(((e <= 4 * s.tau) & (~s.wrong | (e <= s.errors(RIGHT) / 2)), s))
    shares = []
    for wrong in (True, False):
        weights = np.concatenate([s.weight * (s.wrong == wrong) for _, s in hit])
        good = np.concatenate([h for h, _ in hit])
        shares.append(float((weights * good).sum() / weights.sum()) if weights.sum() > 0 else 1.0)
    return shares[0], shares[1]


def is_likelier(samples: Sequence[PixelSample], steps: Pipeline) -> bool:
    """Whether the cause brings pixels that have noise nearer, by more than the best of many causes does by chance.

    Within the noise it may move them any way. Where pixels without noise are wrong, they speak for themselves.
    """
    gains = []
    for s in samples:
        sigma = np.where(s.slack > 0, s.slack / 3, np.inf)
        with np.errstate(invalid="ignore", over="ignore"):
            before, after = (
                np.minimum(np.square((s.shown - made) / sigma), FAR) for made in (s.predict(RIGHT), s.predict(steps))
            )
        gains.append(s.weight * np.nan_to_num(before - after).sum(axis=-1))
    gain = np.concatenate(gains)
    if is_firm(samples) or not any(np.any(s.slack > 0) for s in samples):
        return bool(gain.sum() >= 0)
    return bool(gain.sum() > SIGNIFICANT * np.sqrt(np.square(gain).sum()))


def is_firm(samples: Sequence[PixelSample]) -> bool:
    """Whether most of the wrong pixels are wrong beyond all noise."""
    wrong, firm = 0.0, 0.0
    for s in samples:
        off = np.abs(s.shown - s.predict(RIGHT)) - 2 * s.slack > s.tau
        wrong += float((s.weight * s.wrong).sum())
        firm += float((s.weight * (s.wrong & off.any(axis=-1))).sum())
    return firm > wrong / 2


def is_exact(samples: Sequence[PixelSample], steps: Pipeline) -> bool:
    """Whether nearly every pixel is hit to rounding: a fitted number that only comes near is no proof of its cause."""
    off = [float((s.weight * (s.errors(steps) > ROUNDED * s.scale)).sum()) for s in samples]
    return max(off) < LOOSE


def left_over(samples: Sequence[PixelSample], steps: Pipeline) -> tuple[int, str]:
    """Pixels that stay wrong though no tracer with these steps shows them so: how many, and where."""
    errors, count = [], 0
    for s in samples:
        e = s.errors(steps)
        off = e > 4 * s.tau
        if off.any() and off.sum() <= DOUBTED * off.size:
            off[off] = ~doubtful(s.only(off).predict, s.scale, steps)
        errors.append(np.where(off, e, 0.0))
        count += int(off.sum())
    return count, whereabouts(samples, errors).split("; ")[0] if count else ""


def are_alike(sight: PixelSample, a: Array, b: Array) -> bool:
    """Two predictions that these pixels do not tell apart."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(a - b) - sight.slack
    if sight.view.points:
        apart = np.where(np.isnan(a) & np.isnan(b), 0.0, apart)
    return float((sight.weight * ~(apart.max(axis=-1) <= 4 * sight.tau)).sum()) < 1e-3
