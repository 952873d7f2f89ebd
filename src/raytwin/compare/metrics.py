"""Error metrics: a table of name, formula, source and function. t: test, r: reference; means run over all values.

One more metric is one more row of METRICS.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from raytwin.array_types import Float, Float32
from raytwin.errors import InputError

CHUNK = 1 << 17
"""Values worked on at a time: they stay in the cache, where one pass over 12 megapixels would not."""

FLIP_PIXELS_PER_DEGREE = 67.0
"""Pixels per degree of the observer's view: FLIP's default."""
FLIP_EXPOSURES = {"startExposure": -2.0, "stopExposure": 2.0, "numExposures": 5, "tonemapper": "ACES"}
"""Pinned: left to itself, FLIP takes them from the reference, and its numbers stop being comparable."""


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
    return mean_of(lambda t, r: np.square(t - r) / (np.square(r) + t.dtype.type(0.01)), test, reference)


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
    return _flip(np.maximum(test, 0), np.maximum(reference, 0), "HDR", FLIP_EXPOSURES)[1]


def flip_map(test: Float[np.ndarray, "..."], reference: Float[np.ndarray, "..."]) -> Float32[np.ndarray, "h w"] | None:
    """(H, W) float32, HDR-FLIP of each pixel, 0 to 1; None where it is not installed or the images do not suit."""
    if not flip_is_installed() or test.shape != reference.shape or not all_finite(test, reference):
        return None
    return _flip(np.maximum(test, 0), np.maximum(reference, 0), "HDR", FLIP_EXPOSURES)[0][..., 0]


def flip_ldr(test: Float[np.ndarray, "..."], reference: Float[np.ndarray, "..."]) -> float:
    return _flip(np.clip(test, 0, 1), np.clip(reference, 0, 1), "LDR", {})[1]


def flip_is_installed() -> bool:
    """The extra `flip`: NVIDIA's package has no wheel for every machine."""
    return find_spec("flip_evaluator") is not None


def _flip(
    test: Float[np.ndarray, "..."], reference: Float[np.ndarray, "..."], kind: str, settings: dict[str, Any]
) -> tuple[Float32[np.ndarray, "h w c"], float]:
    """The map (H, W, 1 or 3) and its mean."""
    # NVIDIA's package prints and exits where an argument displeases it, and gives NaN pixels a finite error.
    if test.ndim != 3 or test.shape[-1] != 3 or test.shape != reference.shape:
        raise InputError("FLIP", "two images of one shape (H, W, 3)", f"{test.shape} and {reference.shape}")
    if not (np.isfinite(test).all() and np.isfinite(reference).all()):
        raise InputError("FLIP", "finite radiance", "NaN or infinity")
    if not flip_is_installed():
        return np.full((*test.shape[:2], 1), np.nan, np.float32), float("nan")
    import flip_evaluator

    pair = [np.ascontiguousarray(i, np.float32) for i in (reference, test)]
    settings = {"ppd": FLIP_PIXELS_PER_DEGREE, **settings}
    found, mean, _ = flip_evaluator.evaluate(*pair, kind, inputsRGB=False, applyMagma=False, parameters=settings)
    return np.asarray(found), float(mean)


def nth_largest(above: int, term: Callable[..., np.ndarray], *arrays: Float[np.ndarray, "..."]) -> float:
    """The value of `term(*arrays)` that `above` others are at or above, without sorting what lies far below it."""
    size = arrays[0].size
    sample = term(*(a.ravel()[:: max(1, size // 50_000)] for a in arrays))
    guess = np.quantile(sample, max(0.0, 1 - 2 * (above + 1) / size))
    top = np.concatenate([x[x >= guess] for x in (term(*part) for part in chunks(*arrays))])
    if top.size <= above:  # the sample misled
        top = np.concatenate([term(*part) for part in chunks(*arrays)])
    return float(np.partition(top, top.size - 1 - above)[top.size - 1 - above])


METRICS: dict[str, Metric] = {
    m.name: m
    for m in (
        Metric("rmse", "RMSE", "radiance", "sqrt(mean((t - r)^2))", "the same everywhere", rmse),
        Metric("relmse", "relMSE", "", "mean((t - r)^2 / (r^2 + 0.01))", "tev's; pbrt divides by (r + 0.01)^2", relmse),
        Metric("mae", "Mean error", "radiance", "mean(|t - r|)", "the same everywhere", mae),
        Metric("max_abs", "Error, worst", "radiance", "max(|t - r|)", "the same everywhere", max_abs),
        Metric("p999_abs", "Error, 99.9 % quantile", "radiance",
               "99.9 % quantile of |t - r|, an order statistic", "this project's", p999_abs),
        Metric("p999_rel", "Relative error, 99.9 % quantile", "",
               "99.9 % quantile of |t - r| / (|r| + 0.01)", "this project's", p999_rel),
        Metric("psnr", "PSNR", "dB", "20 log10(max(r) / rmse), dB", "peak is the reference's maximum, not 1", psnr),
        Metric("mean_ratio", "Ratio of means", "", "mean(t) / mean(r)", "the same everywhere", mean_ratio),
        Metric("flip_hdr", "FLIP, mean", "0 to 1",
               f"mean HDR-FLIP, exposures {FLIP_EXPOSURES['startExposure']:g} to {FLIP_EXPOSURES['stopExposure']:g} "
               f"in {FLIP_EXPOSURES['numExposures']}, {FLIP_EXPOSURES['tonemapper']}, "
               f"{FLIP_PIXELS_PER_DEGREE:g} px/degree",
               "Andersson et al. 2021, NVIDIA's flip-evaluator", flip_hdr),
        Metric("flip_ldr", "LDR-FLIP, mean", "0 to 1",
               f"mean LDR-FLIP of radiance clipped to 0..1, {FLIP_PIXELS_PER_DEGREE:g} px/degree",
               "Andersson et al. 2020, NVIDIA's flip-evaluator", flip_ldr),
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
        wanted = [n for n in wanted if not n.startswith("flip")]
    if not test.size:
        return missing
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        numbers = {name: METRICS[name].function(test, reference) for name in wanted}
    return missing | {name: x if math.isfinite(x) else None for name, x in numbers.items()}


def all_finite(*arrays: Float[np.ndarray, "..."]) -> bool:
    """Two reductions decide, and no array of flags is made: NaN and infinity both show in the extremes."""
    return all(math.isfinite(a.min()) and math.isfinite(a.max()) for a in arrays)
