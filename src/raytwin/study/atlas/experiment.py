"""What an experiment is, what comes of one, and where a curve of errors leaves its bound."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from raytwin.scene import Record

Error = float | None
"""None: the method saw that it cannot answer, and said so."""

Measure = Callable[[float, np.random.Generator, int], Mapping[str, Error]]
"""measure(parameter, rng, trials) -> the error of each method there."""

Law = Callable[[float], float]

U32, U64 = 2.0**-24, 2.0**-53
"""Unit roundoff: the most that rounding moves a number by, as a share of it."""


@dataclass(frozen=True)
class Experiment:
    """One row: a parameter is driven from where all is easy, `values` in order, and methods' errors are measured.

    `parameter`, `error`: what the axes say. `laws`: what theory says that each method's error is, to an order of
    magnitude; where it crosses the `bound` is the predicted edge. `ours`: the methods that are the product's own;
    `limit`: the value up to which these must hold the bound (None: to the last). `slack`: the factor within which a
    predicted edge must be found. `why`: two sentences. `trials` of each
    value.
    """

    name: str
    title: str
    parameter: str
    error: str
    bound: float
    values: tuple[float, ...]
    measure: Measure
    ours: tuple[str, ...]
    why: str
    source: str
    laws: Mapping[str, Law] = field(default_factory=dict)
    limit: float | None = None
    slack: float = 8.0
    trials: int = 32


class Curve(Record, frozen=True):
    """A method's error at each value; where it first exceeds the bound, and where theory says that it does."""

    errors: tuple[float | None, ...]
    breaks_at: float | None
    predicted: float | None


class Found(Record, frozen=True):
    """What came of an experiment: its fields are the keys of the JSON."""

    name: str
    parameter: str
    values: tuple[float, ...]
    bound: float
    methods: dict[str, Curve]
    why: str
    source: str


class Atlas(Record, frozen=True):
    experiments: tuple[Found, ...]


def run(experiment: Experiment) -> Found:
    """Every method at every value; each value has random numbers of its own, always the same."""
    values = experiment.values
    rows = []
    for x in values:
        rng = np.random.default_rng([*experiment.name.encode(), *math.frexp(x)[1].to_bytes(2, signed=True)])
        with np.errstate(all="ignore"):
            rows.append(experiment.measure(x, rng, experiment.trials))
    methods = {name: tuple(_plain(row[name]) for row in rows) for name in rows[0]}
    curves = {
        name: Curve(errors, breaks_at(values, errors, experiment.bound), predicted(experiment, name, values))
        for name, errors in methods.items()
    }
    return Found(
        experiment.name, experiment.parameter, values, experiment.bound, curves, experiment.why, experiment.source
    )


def _plain(error: Error) -> Error:
    """A plain finite number: what is no number at all is an error of 1e9."""
    return error if error is None else float(error) if math.isfinite(error) else 1e9


def breaks_at(values: Sequence[float], errors: Sequence[Error], bound: float) -> float | None:
    """The first value at which the error exceeds the bound, on the line between neighbours where both axes are
    logarithmic; None where it never does."""
    for i, (x, e) in enumerate(zip(values, errors, strict=True)):
        if e is None or e <= bound:
            continue
        before = errors[i - 1] if i else None
        if not before:
            return x
        return _between(values[i - 1], x, math.log(bound / before) / math.log(e / before))
    return None


def predicted(experiment: Experiment, method: str, values: Sequence[float]) -> float | None:
    """Where the method's law crosses the bound within the values: None where it does not, or where there is no law."""
    law, low, high = experiment.laws.get(method), values[0], values[-1]
    if law is None or law(high) <= experiment.bound:
        return None
    if law(low) > experiment.bound:
        return low
    for _ in range(30):  # a law crosses its bound once
        middle = _between(low, high, 0.5)
        low, high = (low, middle) if law(middle) > experiment.bound else (middle, high)
    return float(f"{high:.4g}")


def _between(a: float, b: float, share: float) -> float:
    return math.exp(math.log(a) + (math.log(b) - math.log(a)) * share)


def digits(error: Error) -> float | None:
    """How many decimal digits an error leaves, 0 to 16; None where the method refused."""
    if error is None:
        return None
    return 16.0 if error <= 1e-16 else min(max(0.0, -math.log10(error)), 16.0)


def spaced(first: float, last: float, count: int) -> tuple[float, ...]:
    """`count` values in equal ratios."""
    return tuple(float(f"{x:.3g}") for x in np.geomspace(first, last, count))
