"""The comparison's numbers in words: what each is, its unit, its limit, and why it may be missing."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from raytwin.compare import METRICS, Comparison
from raytwin.scene import Tolerance


class Number(NamedTuple):
    """`group` and `key` are the JSON's; `bound(tolerance)`: the largest allowed value."""

    group: str
    key: str
    name: str
    unit: str
    bound: Callable[[Tolerance], float] | None
    meaning: str


RADIANCE_BOUNDS: dict[str, Callable[[Tolerance], float]] = {"p999_abs": lambda t: t.p999_abs}

NUMBERS: tuple[Number, ...] = (
    Number("geometry", "mask_mismatch_pixels", "Silhouette mismatch", "pixels", lambda t: t.mask_pixels,
           "pixels whose centre sees another object"),
    Number("geometry", "depth_max_rel", "Depth, worst", "relative", None,
           "largest |t − t_ref| / t_ref where both see the same object"),
    Number("geometry", "normal_max_deg", "Normal, worst", "degrees", None,
           "largest angle between the normals where both see the same object"),
    Number("geometry", "shift_px", "Shift", "pixels", None,
           "translation between the two images"),
    *(
        Number("radiance", m.name, m.title, m.unit, RADIANCE_BOUNDS.get(m.name), m.formula)
        for m in (METRICS[name] for name in ("p999_abs", "max_abs", "rmse", "relmse", "relmse_trimmed", "mean_ratio"))
    ),
    Number("statistics", "z_mean", "Whole image", "σ", None,
           "the image's mean error over its standard deviation, worst channel"),
    Number("statistics", "z_tile_worst", "Worst tile", "σ", None, "the same for the least plausible tile"),
    Number("statistics", "pixel_fail_fraction", "Failing pixels", "share", lambda t: t.outlier_fraction,
           "pixels with a value that fails its own test"),
    Number("statistics", "minimum_detectable_bias", "Detectable bias", "relative", None,
           "the smallest error of the whole image's mean that this comparison would have caught"),
    Number("statistics", "minimum_detectable_tile_bias", "Detectable bias of a tile", "relative", None,
           "the same for any 24 x 24 patch"),
    Number("statistics", "looks", "Looks", "", None,
           "how many times the samples were tested before the verdict was certain"),
    Number("statistics", "samples_to_certainty", "Samples to certainty", "per pixel", None,
           "what each side had when the verdict was certain"),
    Number("statistics", "noise_of_samples", "Noise of about", "samples per pixel", None,
           "samples of the reference's renderer that scatter as t − r does within 8 x 8 pixels"),
    Number("perceptual", "flip_mean", METRICS["flip_hdr"].title, METRICS["flip_hdr"].unit, None,
           "how different the two look to an eye that flips between them"),
)  # fmt: skip
"""One more number is one more row."""

GROUPS = {
    "geometry": "Geometry: where things are",
    "radiance": "Radiance: how bright they are",
    "statistics": "Statistics: what noise cannot explain",
    "perceptual": "Perception: what an eye would notice",
}


class NumberRow(NamedTuple):
    """A Number with its value: `within` is True, False, or None where nothing bounds it."""

    number: Number
    value: float
    bound: float | None
    within: bool | None


FOR_EXACT = ("p999_abs", "pixel_fail_fraction")
"""Limits of images without noise; with noise the statistics decide."""


def rows(comparison: Comparison, tolerance: Tolerance | None, noisy: bool) -> Iterator[tuple[str, list[NumberRow]]]:
    """(heading, rows) of each group, of what has a value; `noisy`: one of the images has a variance.

    Without a tolerance nothing is bounded.
    """
    for group, heading in GROUPS.items():
        found = []
        for number in (n for n in NUMBERS if n.group == group):
            if (value := getattr(getattr(comparison, group), number.key)) is None:
                continue
            free = noisy and number.key in FOR_EXACT
            bound = number.bound(tolerance) if number.bound and tolerance and not free else None
            # A pass holds every bound: pixels that are allowed to see another object are excused from the others.
            found.append(
                NumberRow(number, value, bound, None if bound is None else comparison.passed or value <= bound)
            )
        if found:
            yield heading, found


def shown(value: float | None, digits: int = 3) -> str:
    """Format to `digits` significant digits, below a thousandth as 2.10e-07; a dash for what is missing.

    >>> [shown(v) for v in (0.4567, 1.0, 2.1e-7, 1e9, 0.0, -3, 123456, 999.6, None, math.nan)]
    ['0.457', '1.00', '2.10e-07', '1.00e+09', '0', '-3', '123456', '1000', '–', 'NaN']
    """
    if value is None:
        return "–"
    if not math.isfinite(value):
        return f"{value}".replace("nan", "NaN")
    if value == 0 or isinstance(value, int):
        return f"{int(value)}"
    rounded = abs(float(f"{value:.{digits - 1}e}"))
    if 1e-3 <= rounded < 10**digits:
        return f"{value:#.{digits}g}".rstrip(".")
    if 10**digits <= rounded < 1e6:
        return f"{value:.0f}"
    return f"{value:.{digits - 1}e}"


def beside(value: float | None, sigma: float | None) -> str:
    """Format to two digits of its standard deviation; to four of its own where there is none.

    >>> beside(1559.97213, 0.42), beside(1559.97213, 7.3), beside(-0.16241, 0.0031), beside(2.0, None)
    ('1559.97', '1560.0', '-0.1624', '2.000')
    """
    if value is None or not sigma or not math.isfinite(sigma):
        return shown(value, 4)
    return f"{value:.{max(0, 1 - math.floor(math.log10(sigma)))}f}"


def short(value: float) -> str:
    """Format a bound or a tick as people write it, small ones to three digits.

    >>> [short(v) for v in (1e-5, 7.038194e-6, 0.5, 2.5e-4, 20, 0)]
    ['1e-05', '7.04e-06', '0.5', '2.5e-04', '20', '0']
    """
    small = value and not 1e-3 <= abs(value) < 1e4
    mantissa, _, exponent = (f"{value:.2e}" if small else f"{value:.6g}").partition("e")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return mantissa + (f"e{exponent}" if exponent else "")


def seconds(value: float | None) -> str:
    """
    >>> [seconds(v) for v in (2.309, 41.18, 0.0451, 0.00451, 1e-5, 125.0, None)]
    ['2.31 s', '41.2 s', '45 ms', '4.5 ms', '< 0.1 ms', '125 s', '–']
    """
    if value is None:
        return "–"
    if value >= 1:
        return f"{value:.{2 if value < 10 else 1 if value < 100 else 0}f} s"
    if value >= 1e-4:
        return f"{value * 1e3:.{0 if value >= 0.01 else 1}f} ms"
    return "< 0.1 ms"
