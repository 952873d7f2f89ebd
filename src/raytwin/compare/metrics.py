"""Error metrics: a table of name, formula, source and function. t: test, r: reference; means run over all values.

One more metric is one more row of METRICS.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Float
from raytwin.errors import InputError

CHUNK = 1 << 17
"""Values computed at a time, so that they stay in the cache."""

FLIP_PIXELS_PER_DEGREE = 67.0
"""Pixels per degree of the observer's view: FLIP's default."""
FLIP_STOPS, FLIP_EXPOSURES = (-2.0, 2.0), 5
"""Exposures that HDR-FLIP tries, first and last in stops, and their number.

Pinned: left to itself, FLIP takes them from the reference, and its numbers stop being comparable.
"""
FLIP_BRIGHT = 2.118872
"""Radiance that FLIP's ACES curve maps to 0.85: FLIP exposes a brightest pixel of this by 0 stops."""


class Metric(NamedTuple):
    """`function(test, reference) -> float` takes two linear arrays of one shape; `formula` is what it computes.

    `title` and `unit` are what pages and charts call it, the unit empty where it has none.
    """

    name: str
    title: str
    unit: str
    formula: str
    source: str
    function: Callable[[np.ndarray, np.ndarray], float]


Pair = Float[np.ndarray, "*n"]
"""A test's or a reference's values: two arrays of one shape."""

Term = Callable[..., np.ndarray]
"""What a metric computes of each value t and r."""


def in_chunks(term: Term, *arrays: Pair) -> Iterator[Float[np.ndarray, " n"]]:
    """term(*arrays), flat, CHUNK values at a time."""
    flat = [a.ravel() for a in arrays]
    for i in range(0, flat[0].size, CHUNK):
        yield term(*(f[i : i + CHUNK] for f in flat))


def mean_of(term: Term, test: Pair, reference: Pair) -> float:
    """mean(term(t, r)) over all values, summed in float64."""
    return sum(float(x.sum(dtype=np.float64)) for x in in_chunks(term, test, reference)) / test.size


def p999(term: Term, test: Pair, reference: Pair) -> float:
    """The value of term(t, r) that a thousandth of the others are at or above."""
    return nth_largest(test.size // 1000, term, test, reference)


def absolute(test: np.ndarray, reference: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(test - reference))


def relative(test: np.ndarray, reference: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(test - reference) / (np.abs(reference) + test.dtype.type(0.01)))


def relative_square(test: np.ndarray, reference: np.ndarray) -> np.ndarray:
    return np.asarray(np.square(test - reference) / (np.square(reference) + test.dtype.type(0.01)))


def rmse(test: Pair, reference: Pair) -> float:
    return math.sqrt(mean_of(lambda t, r: np.square(t - r), test, reference))


def relmse_trimmed(test: Pair, reference: Pair) -> float:
    """relMSE without the 0.1 % of the values whose terms are largest: what a few fireflies do not decide."""
    worst = largest(test.size // 1000, relative_square, test, reference)
    total = mean_of(relative_square, test, reference) * test.size - float(worst.sum(dtype=np.float64))
    return max(0.0, total) / max(test.size - worst.size, 1)


def max_abs(test: Pair, reference: Pair) -> float:
    return max(float(x.max()) for x in in_chunks(absolute, test, reference))


def psnr(test: Pair, reference: Pair) -> float:
    error = rmse(test, reference)
    with np.errstate(divide="ignore"):
        return float(20 * np.log10(np.max(reference) / error)) if error > 0 else float("inf")


def mean_ratio(test: Pair, reference: Pair) -> float:
    below = float(np.mean(reference, dtype=np.float64))
    return float(np.mean(test, dtype=np.float64)) / below if below else float("nan")


def flip_hdr(test: Float[np.ndarray, "..."], reference: Float[np.ndarray, "..."]) -> float:
    """Mean of HDR-FLIP's map by OpenImageIO; NaN where that is not installed."""
    if test.ndim != 3 or test.shape[-1] != 3 or test.shape != reference.shape:
        raise InputError("FLIP", "two images of one shape (H, W, 3)", f"{test.shape} and {reference.shape}")
    if not all_finite(test, reference):  # OpenImageIO gives NaN pixels a finite error
        raise InputError("FLIP", "finite radiance", "NaN or infinity")
    if not flip_is_installed():
        return math.nan
    import OpenImageIO as oiio

    pair = [oiio.ImageBuf(np.ascontiguousarray(np.maximum(i, 0), np.float32)) for i in (reference, test)]
    first, last = FLIP_STOPS
    # FLIP's exposures begin at log2(bright / maximum), end at log2(bright / median), and are as many as there are
    # stops between them, rounded up: a hundred-thousandth of a stop more makes four stops five exposures.
    found = oiio.ImageBufAlgo.FLIP_diff(
        *pair,
        maxluminance=FLIP_BRIGHT * 2.0**-first,
        medianluminance=FLIP_BRIGHT * 2.0 ** -(last + 1e-5),
        ppd=FLIP_PIXELS_PER_DEGREE,
        tonemapper="aces",
    )
    return float(found.spec().get_float_attribute("FLIP:meanerror", math.nan))


def flip_is_installed() -> bool:
    """The extra `flip`."""
    return find_spec("OpenImageIO") is not None


def nth_largest(above: int, term: Term, *arrays: Pair) -> float:
    """The value of `term(*arrays)` that `above` others are at or above."""
    return float(largest(above + 1, term, *arrays).min())


def largest(count: int, term: Term, *arrays: Pair) -> Float[np.ndarray, " {count}"]:
    """The `count` largest values of `term(*arrays)`, in any order, without sorting what lies far below them."""
    size = arrays[0].size
    sample = term(*(a.ravel()[:: max(1, size // 50_000)] for a in arrays))
    guess = np.quantile(sample, max(0.0, 1 - 2 * count / size))
    top = np.concatenate([x[x >= guess] for x in in_chunks(term, *arrays)])
    if top.size < count:  # the sample misled
        top = np.concatenate(list(in_chunks(term, *arrays)))
    return np.asarray(np.partition(top, top.size - count)[top.size - count :]) if count else top[:0]


METRICS: dict[str, Metric] = {
    m.name: m
    for m in (
        Metric("rmse", "RMSE", "radiance", "sqrt(mean((t - r)^2))", "the same everywhere", rmse),
        Metric("relmse", "relMSE", "", "mean((t - r)^2 / (r^2 + 0.01))", "tev's; pbrt divides by (r + 0.01)^2",
               partial(mean_of, relative_square)),
        Metric("relmse_trimmed", "relMSE, trimmed", "", "relMSE without the 0.1 % of the values that are largest in it",
               "this project's", relmse_trimmed),
        Metric("mae", "Mean error", "radiance", "mean(|t - r|)", "the same everywhere", partial(mean_of, absolute)),
        Metric("max_abs", "Error, worst", "radiance", "max(|t - r|)", "the same everywhere", max_abs),
        Metric("p999_abs", "Error, 99.9 % quantile", "radiance",
               "99.9 % quantile of |t - r|, an order statistic", "this project's",
               partial(p999, absolute)),
        Metric("p999_rel", "Relative error, 99.9 % quantile", "",
               "99.9 % quantile of |t - r| / (|r| + 0.01)", "this project's", partial(p999, relative)),
        Metric("psnr", "PSNR", "dB", "20 log10(max(r) / rmse), dB", "peak is the reference's maximum, not 1", psnr),
        Metric("mean_ratio", "Ratio of means", "", "mean(t) / mean(r)", "the same everywhere", mean_ratio),
        Metric("flip_hdr", "FLIP, mean", "0 to 1",
               f"mean HDR-FLIP, exposures {FLIP_STOPS[0]:g} to {FLIP_STOPS[1]:g} in {FLIP_EXPOSURES}, ACES, "
               f"{FLIP_PIXELS_PER_DEGREE:g} px/degree",
               "Andersson et al. 2021, by OpenImageIO", flip_hdr),
    )
}  # fmt: skip


def measure(
    test: Float[np.ndarray, "..."], reference: Float[np.ndarray, "..."], names: Iterable[str]
) -> dict[str, float | None]:
    """The named metrics over the values that are finite in both images; null where one has no value.

    FLIP sees whole pictures: it is null where any value is not finite.
    """
    missing = dict.fromkeys(names)
    wanted = list(missing)
    if test.shape != reference.shape:
        return missing
    if not all_finite(test, reference):
        finite = np.isfinite(test) & np.isfinite(reference)
        test, reference = test[finite], reference[finite]
        wanted = [n for n in wanted if n != "flip_hdr"]
    if not test.size:
        return missing
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        numbers = {name: METRICS[name].function(test, reference) for name in wanted}
    return missing | {name: x if math.isfinite(x) else None for name, x in numbers.items()}


def all_finite(*arrays: Float[np.ndarray, "..."]) -> bool:
    """Two reductions decide, and no array of flags is made: NaN and infinity both show in the extremes."""
    return all(math.isfinite(a.min()) and math.isfinite(a.max()) for a in arrays)
