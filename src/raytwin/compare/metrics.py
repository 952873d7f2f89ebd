"""Error metrics: a table of name, formula, source and function. t: test, r: reference; means run over all values.

One more metric is one more row of METRICS.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Float
from raytwin.errors import InputError

CHUNK = 1 << 17
"""Values worked on at a time: they stay in the cache, where one pass over 12 megapixels would not."""

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


def chunks(*arrays: Float[np.ndarray, "..."]) -> Iterator[tuple[Float[np.ndarray, " n"], ...]]:
    """The same stretch of each array, flat, CHUNK values at a time."""
    flat = [a.ravel() for a in arrays]
    for i in range(0, flat[0].size, CHUNK):
        yield tuple(f[i : i + CHUNK] for f in flat)


def mean_of(
    term: Callable[[np.ndarray, np.ndarray], np.ndarray],
    test: Float[np.ndarray, "*n"],
    reference: Float[np.ndarray, "*n"],
) -> float:
    """mean(term(t, r)) over all values, summed in float64."""
    return sum(float(term(t, r).sum(dtype=np.float64)) for t, r in chunks(test, reference)) / max(test.size, 1)


def mse(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
    return mean_of(lambda t, r: np.square(t - r), test, reference)


def rmse(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
    return float(np.sqrt(mse(test, reference)))


def relmse(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
    return mean_of(_relative_square, test, reference)


def relmse_trimmed(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
    """relMSE without the 0.1 % of the values whose terms are largest: what a few fireflies do not decide."""
    worst = largest(test.size // 1000, _relative_square, test, reference)
    total = relmse(test, reference) * test.size - float(worst.sum(dtype=np.float64))
    return max(0.0, total) / max(test.size - worst.size, 1)


def _relative_square(t: np.ndarray, r: np.ndarray) -> np.ndarray:
    return np.asarray(np.square(t - r) / (np.square(r) + t.dtype.type(0.01)))


def mae(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
    return mean_of(lambda t, r: np.abs(t - r), test, reference)


def max_abs(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
    return max((float(np.abs(t - r).max()) for t, r in chunks(test, reference)), default=0.0)


def p999_abs(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
    return nth_largest(test.size // 1000, lambda t, r: np.abs(t - r), test, reference)


def p999_rel(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
    def relative(t: np.ndarray, r: np.ndarray) -> np.ndarray:
        return np.asarray(np.abs(t - r) / (np.abs(r) + t.dtype.type(0.01)))

    return nth_largest(test.size // 1000, relative, test, reference)


def psnr(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
    error = rmse(test, reference)
    with np.errstate(divide="ignore"):
        return float(20 * np.log10(np.max(reference) / error)) if error > 0 else float("inf")


def mean_ratio(test: Float[np.ndarray, "*n"], reference: Float[np.ndarray, "*n"]) -> float:
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


def nth_largest(above: int, term: Callable[..., np.ndarray], *arrays: Float[np.ndarray, "..."]) -> float:
    """The value of `term(*arrays)` that `above` others are at or above."""
    return float(largest(above + 1, term, *arrays).min())


def largest(count: int, term: Callable[..., np.ndarray], *arrays: Float[np.ndarray, "..."]) -> np.ndarray:
    """The `count` largest values of `term(*arrays)`, in any order, without sorting what lies far below them."""
    size = arrays[0].size
    sample = term(*(a.ravel()[:: max(1, size // 50_000)] for a in arrays))
    guess = np.quantile(sample, max(0.0, 1 - 2 * count / size))
    top = np.concatenate([x[x >= guess] for x in (term(*part) for part in chunks(*arrays))])
    if top.size < count:  # the sample misled
        top = np.concatenate([term(*part) for part in chunks(*arrays)])
    return np.asarray(np.partition(top, top.size - count)[top.size - count :]) if count else top[:0]


METRICS: dict[str, Metric] = {
    m.name: m
    for m in (
        Metric("rmse", "RMSE", "radiance", "sqrt(mean((t - r)^2))", "the same everywhere", rmse),
        Metric("relmse", "relMSE", "", "mean((t - r)^2 / (r^2 + 0.01))", "tev's; pbrt divides by (r + 0.01)^2", relmse),
        Metric("relmse_trimmed", "relMSE, trimmed", "", "relMSE without the 0.1 % of the values that are largest in it",
               "this project's", relmse_trimmed),
        Metric("mae", "Mean error", "radiance", "mean(|t - r|)", "the same everywhere", mae),
        Metric("max_abs", "Error, worst", "radiance", "max(|t - r|)", "the same everywhere", max_abs),
        Metric("p999_abs", "Error, 99.9 % quantile", "radiance",
               "99.9 % quantile of |t - r|, an order statistic", "this project's", p999_abs),
        Metric("p999_rel", "Relative error, 99.9 % quantile", "",
               "99.9 % quantile of |t - r| / (|r| + 0.01)", "this project's", p999_rel),
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
    finite = np.isfinite(test) & np.isfinite(reference) if not all_finite(test, reference) else None
    if finite is not None:
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
