"""Two runs on one machine, method by method: ratios of seconds and errors with their intervals, and a verdict."""

from typing import NamedTuple

import numpy as np

from raytwin.bench.bench_record import Bench
from raytwin.bench.frontier import ratio_interval
from raytwin.errors import InputError

SLOWER, LESS_ACCURATE = 1.05, 1.02
"""Ratios up to these are not worth a word."""
ROUNDING = 1e-6
"""RMSEs below this are float32's rounding, which changes with the last digit of a camera; they count as this."""
UNDETECTED_SLOWDOWN = 1.5
"""A method is undecided where only a slowdown by more than this would have been seen."""


class MethodChange(NamedTuple):
    """new / old: `seconds` and `error` as (ratio, low, high), the interval at 99 %; `verdict` in words, '' for none."""

    method: str
    width: int
    height: int
    seconds: tuple[float, float, float]
    error: tuple[float, float, float]
    verdict: str

    @property
    def seen(self) -> float:
        """The least slowdown that would have been called one: its interval, as wide as this, lies above SLOWER."""
        ratio, low, _ = self.seconds
        return SLOWER * ratio / low if low > 0 else float("inf")


class Changes(NamedTuple):
    """`drift`: the median of all ratios of seconds; `doubts`: why the two runs may not be comparable."""

    changes: tuple[MethodChange, ...]
    drift: float
    doubts: tuple[str, ...]

    @property
    def worse(self) -> tuple[MethodChange, ...]:
        return tuple(c for c in self.changes if "slower" in c.verdict or "less accurate" in c.verdict)

    @property
    def undecided(self) -> tuple[MethodChange, ...]:
        """Methods that may have become slower by a factor worth knowing: too few repeats, or too much noise."""
        return tuple(c for c in self.changes if "slower" not in c.verdict and c.seen > UNDETECTED_SLOWDOWN)


def against(new: Bench, old: Bench) -> Changes:
    """How the methods that both runs measured at the same size have changed. InputError where they share none.

    A method is slower where the whole interval lies above SLOWER, less accurate where that of its RMSE lies above
    LESS_ACCURATE; errors below the truth's floor, or below ROUNDING, count as that.
    """
    before = {(r.method, r.width, r.height): r for r in old.repeats}
    floors = {(r.method, r.width, r.height): max(r.truth_floor, ROUNDING) for r in (*old.rows, *new.rows)}
    pairs = [(r, before[r.method, r.width, r.height]) for r in new.repeats if (r.method, r.width, r.height) in before]
    if not pairs:
        raise InputError("--against", "a run with methods and sizes of this one", "none in common")
    times = [ratio_interval(now.seconds, then.seconds) for now, then in pairs]
    drift = float(np.median([ratio for ratio, _, _ in times]))
    changes = []
    for (now, then), seconds in zip(pairs, times, strict=True):
        floor = floors[now.method, now.width, now.height]
        error = errors_ratio(now.rmse, then.rmse, floor)
        changes.append(
            MethodChange(now.method, now.width, now.height, seconds, error, better_or_worse(seconds, error, drift))
        )
    doubts = [
        f"another {name}: {new.machine[name]}, before {was}"
        for name, was in old.machine.items()
        if new.machine.get(name) != was
    ]
    doubts += [f"another scene: {new.scene}, before {old.scene}"] if new.scene != old.scene else []
    doubts += [
        f"another {n}: {new.versions[n]}, before {v}" for n, v in old.versions.items() if new.versions.get(n, v) != v
    ]
    references = {(t.name, t.width, t.height): t.samples for t in old.truths}
    doubts += [
        f"another reference of {t.name}, {t.width} x {t.height}: {t.samples} samples per pixel, before {samples}; "
        "errors may change with it"
        for t in new.truths
        if (samples := references.get((t.name, t.width, t.height), t.samples)) != t.samples
    ]
    return Changes(tuple(changes), drift, tuple(doubts))


def errors_ratio(now: tuple[float, ...], then: tuple[float, ...], floor: float) -> tuple[float, float, float]:
    """The ratio of the RMSEs; without noise there is one of each, and nothing to resample."""
    ours, theirs = (np.maximum(np.asarray(errors), floor) for errors in (now, then))
    if len(ours) == 1 or len(theirs) == 1:
        ratio = float(np.median(ours) / np.median(theirs))
        return ratio, ratio, ratio
    return ratio_interval(ours.tolist(), theirs.tolist())


def better_or_worse(seconds: tuple[float, float, float], error: tuple[float, float, float], drift: float) -> str:
    words = []
    ratio, low, high = seconds
    if low > SLOWER:
        words.append("slower" if ratio > SLOWER * drift else "slower, as all are")
    elif high < 1 / SLOWER:
        words.append("faster" if ratio < drift / SLOWER else "faster, as all are")
    if error[1] > LESS_ACCURATE:
        words.append("less accurate")
    elif error[2] < 1 / LESS_ACCURATE:
        words.append("more accurate")
    return ", ".join(words)
