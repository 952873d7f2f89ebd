"""Kinds of noise that renderers have, as samples: skewed, rare, in places, negative, clustered.

`KINDS` is the table: a name to a `Kind`, which draws samples of a truth (H, W, 3) and knows their mean. The rules of
the verdict were shaped by SHAPING. HELD_OUT and FRESH were drawn up beside them, and first looked at when the rules
were finished; a kind of HELD_OUT that failed then has shaped a rule since, and those of FRESH none.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from measure.noise_models import FILTERS, picture
from scipy.ndimage import convolve1d

HEIGHT, WIDTH = 24, 32
SMALL = picture(HEIGHT, WIDTH).astype(np.float32)
"""So small that thousands of sequences take minutes."""

Samples = np.ndarray
"""(n, H, W, 3): a render's samples, one after the other."""

Rng = np.random.Generator
Noise = Callable[[Rng, np.ndarray, int], Samples]


class Kind(NamedTuple):
    """Samples of a truth, and their mean."""

    noise: Noise
    mean: Callable[[np.ndarray], np.ndarray] = lambda truth: truth


def factors(draw: Callable[[Rng, tuple[int, ...]], np.ndarray], channels: int = 1) -> Kind:
    """The light times random numbers of mean 1: alike in all channels, or of their own in each of three."""
    return Kind(lambda rng, truth, n: truth * draw(rng, (n, *truth.shape[:2], channels)).astype(np.float32))


def gaussian(sd: float) -> Noise:
    return lambda rng, truth, n: truth + (sd * truth) * rng.standard_normal((n, *truth.shape), np.float32)


def exponential(rng: Rng, truth: np.ndarray, n: int) -> Samples:
    return truth * rng.standard_exponential((n, *truth.shape), np.float32)


def chosen(rng: Rng, p: float | np.ndarray, truth: np.ndarray, n: int) -> np.ndarray:
    """(n, H, W, 1) of 0 and 1: a share p of the samples, alike in all channels."""
    return (rng.random((n, *truth.shape[:2], 1), np.float32) < p).astype(np.float32)


def events(
    p: float | np.ndarray, size: float, sd: float = 0.03, where: np.ndarray | float = 1.0, of_light: bool = False
) -> Kind:
    """Noise `sd`, and events of `size` in a share p of the samples, in units of the light if `of_light`."""

    def added(truth: np.ndarray) -> np.ndarray:
        lit = np.broadcast_to(np.float32(size) * np.asarray(where, np.float32), (*truth.shape[:2], 1))
        return lit * truth if of_light else lit

    def noise(rng: Rng, truth: np.ndarray, n: int) -> Samples:
        return gaussian(sd)(rng, truth, n) + chosen(rng, p, truth, n) * added(truth)

    return Kind(noise, lambda truth: truth + np.asarray(p, np.float32) * added(truth))


def box(y0: int, y1: int, x0: int, x1: int) -> np.ndarray:
    there = np.zeros((HEIGHT, WIDTH, 1), np.float32)
    there[y0:y1, x0:x1] = 1
    return there


def filtered(name: str) -> Kind:
    """Exponential noise under a reconstruction filter: neighbours share their samples."""
    radius, weight = FILTERS[name]
    kernel = weight(np.arange(-math.ceil(radius), math.ceil(radius) + 1) * 1.0)

    def blurred(x: np.ndarray, first: int) -> np.ndarray:
        for axis in (first, first + 1):
            x = convolve1d(x, kernel / kernel.sum(), axis=axis, mode="mirror")
        return x

    return Kind(lambda *given: blurred(exponential(*given), 1), lambda truth: blurred(truth, 0))


def shaded(p: float) -> Noise:
    """Light that a share p of the samples finds hidden: most pixels' samples agree, and no variance tells of the rest.

    A quarter of the picture has exponential noise.
    """

    def noise(rng: Rng, truth: np.ndarray, n: int) -> Samples:
        out = truth / (1 - p) * chosen(rng, 1 - p, truth, n)
        rows = truth.shape[0] // 4
        out[:, :rows] = exponential(rng, truth[:rows], n)
        return out

    return noise


CONTRAST = SMALL**4 + np.float32(0.002)


def lobes(x: np.ndarray) -> np.ndarray:
    return np.sinc(x) * np.sinc(x / 3) * (np.abs(x) < 3)


def ringing(light: np.ndarray, places: tuple[np.ndarray, np.ndarray], axes: tuple[int, int]) -> np.ndarray:
    """Light under Lanczos' filter, of samples at these places (0 to 1) of their pixels, along each axis.

    Each sample is splatted with the kernel's weights over 7 x 7 pixels.
    """
    for axis, at in zip(axes, places, strict=True):
        light = sum(np.roll(light * lobes(step + 0.5 - at).astype(np.float32), step, axis) for step in range(-3, 4))
    return light


def lanczos(rng: Rng, truth: np.ndarray, n: int) -> Samples:
    """Exponential noise of a bright disc under a filter with negative lobes, whatever the truth."""
    light = CONTRAST * rng.standard_exponential((n, *truth.shape), np.float32)
    return ringing(light, tuple(rng.random((n, *truth.shape[:2], 1)) for _ in range(2)), (1, 2))


def under_lanczos(truth: np.ndarray) -> np.ndarray:
    """The mean of `lanczos`: over places of the samples in their pixels."""
    at, mean = (np.arange(40) + 0.5) / 40, CONTRAST
    for axis in (0, 1):
        mean = np.mean([ringing(mean, (np.float64(x),), (axis,)) for x in at], axis=0)
    return mean.astype(np.float32)


def control_variates(rng: Rng, truth: np.ndarray, n: int) -> Samples:
    """An estimate less another of the same light, whose mean is added: often negative, with either tail."""
    first, second = (rng.standard_exponential((n, *truth.shape), np.float32) for _ in range(2))
    return truth * (1.5 * first - 0.8 * second + 0.3)


def lognormal(sigma: float) -> Kind:
    return factors(lambda rng, size: np.exp(sigma * rng.standard_normal(size, np.float32) - sigma**2 / 2))


def sparse(p: float) -> Kind:
    """Light that a share p of the samples meets, as a small lamp's."""
    return factors(lambda rng, size: (rng.random(size, np.float32) < p) / p)


SHAPING: dict[str, Kind] = {
    "Gaussian": Kind(gaussian(0.3)),
    "exponential": Kind(exponential),
    "one sample in eight": sparse(1 / 8),
    "one sample in 200 shaded": Kind(shaded(0.005)),
    "many fireflies": events(1e-3, 30.0, sd=0.3),
    "few fireflies": events(1e-4, 100.0, sd=0.3),
    "rare events": events(1e-3, 100.0, sd=0.3, of_light=True),
    "tent filter": filtered("tent"),
    "Mitsuba's default film": filtered("Mitsuba's Gaussian"),
    "Gaussian filter, 1 pixel": filtered("Gaussian, 1 pixel"),
    "rare events in 10 x 14 pixels": events(0.01, 30.0, where=box(6, 16, 9, 23)),
    ".0003 x 300 everywhere": events(3e-4, 300.0),
    "two points, .02": sparse(0.02),
    "dark spikes": factors(lambda rng, size: (rng.random(size, np.float32) >= 0.02) / 0.98),
    "Weibull .5": factors(lambda rng, size: 0.5 * rng.standard_exponential(size, np.float32) ** 2),
    "lognormal 1": lognormal(1.0),
    "lognormal 1.5": lognormal(1.5),
    "control variates": Kind(control_variates),
    "events of the light, .001 x 5": events(1e-3, 5.0, of_light=True),
    "events of the light, .003 x 2": events(3e-3, 2.0, of_light=True),
    "events of the light, .01 x 1": events(1e-2, 1.0, of_light=True),
    "events of the light, .003 x 20": events(3e-3, 20.0, of_light=True),
    "events of the light, .0015 x 6": events(1.5e-3, 6.0, of_light=True),
    "Lanczos": Kind(lanczos, under_lanczos),
}


# ------------------------------------------------------------------------------------------ kinds that shaped no rule


def mixed_tiles(rng: Rng, truth: np.ndarray, n: int) -> Samples:
    """Exponential noise in one tile, light of one sample in thirty in the next."""
    y, x = np.mgrid[: truth.shape[0], : truth.shape[1]] // 8
    dense = ((x + y) % 2 == 0)[..., None]
    return np.where(dense, exponential(rng, truth, n), truth * 30 * chosen(rng, 1 / 30, truth, n))


def clusters(rng: Rng, truth: np.ndarray, n: int) -> Samples:
    """Events that light 3 x 3 pixels at once."""
    hit = chosen(rng, 5e-4, truth, n) * np.float32(8)
    for axis in (1, 2):
        hit = convolve1d(hit, np.ones(3), axis=axis, mode="mirror")
    return gaussian(0.1)(rng, truth, n) + hit


def correlated_channels(rng: Rng, truth: np.ndarray, n: int) -> Samples:
    grey = rng.standard_gamma(0.3, (n, *truth.shape[:2], 1)).astype(np.float32) / 0.3
    return truth * (0.9 * grey) + 0.1 * exponential(rng, truth, n)


def clipped_cauchy(rng: Rng, size: tuple[int, ...]) -> np.ndarray:
    """|Cauchy| below 200, of mean ln(1 + 200²) / (2 arctan 200)."""
    return np.tan(rng.random(size) * math.atan(200.0)) * 2 * math.atan(200.0) / math.log1p(200.0**2)


def lognormal_mixture(rng: Rng, size: tuple[int, ...]) -> np.ndarray:
    sigma = np.where(rng.random(size) < 0.1, 2.0, 0.4)
    return np.exp(sigma * rng.standard_normal(size) - sigma**2 / 2)


def of_either_sign(rng: Rng, size: tuple[int, ...]) -> np.ndarray:
    return 1 + 0.1 * rng.standard_normal(size) + 10 * (rng.random(size) < 2e-3) * rng.choice([-1, 1], size)


HELD_OUT: dict[str, Kind] = {
    "Student's t of 3": factors(lambda rng, size: 1 + 0.3 * rng.standard_t(3, size)),
    "Pareto 2.5": factors(lambda rng, size: 0.6 * (1 - rng.random(size)) ** (-1 / 2.5)),
    "mixture of lognormals": factors(lognormal_mixture),
    "gamma .05": factors(lambda rng, size: rng.standard_gamma(0.05, size) / 0.05),
    "Cauchy, cut at 200": factors(clipped_cauchy),
    "events of either sign": factors(of_either_sign),
    "clusters of 3 x 3 pixels": Kind(clusters, lambda truth: truth + np.float32(0.036)),
    "dense beside sparse tiles": Kind(mixed_tiles),
    "steps of a quarter": factors(
        lambda rng, size: np.floor(4 * rng.standard_exponential(size) + rng.random(size)) / 4
    ),
    "beta, U-shaped": factors(lambda rng, size: 2 * rng.beta(0.2, 0.2, size)),
    "lognormal in one sample of 20": factors(
        lambda rng, size: 20 * (rng.random(size) < 0.05) * np.exp(rng.standard_normal(size) - 0.5)
    ),
    "channels alike": Kind(correlated_channels),
    "rare events in a stripe": events(0.005, 40.0, where=box(0, 24, 13, 18)),
    "rare events in a corner of 6 x 6": events(0.02, 20.0, where=box(0, 6, 0, 6)),
    ".001 x 60 of the light": events(1e-3, 60.0, of_light=True),
}


def roulette(rng: Rng, size: tuple[int, ...]) -> np.ndarray:
    """Paths that go on with the probability 0.6, and weigh 1.25 times as much for it: no third moment."""
    return 1.25 ** (rng.geometric(0.4, size) - 1.0) / 1.6


def coloured_lamps(rng: Rng, truth: np.ndarray, n: int) -> Samples:
    """Each sample goes to one of three lamps of other colours."""
    lamps = np.array([[2.4, 0.3, 0.3], [0.3, 2.4, 0.3], [0.3, 0.3, 2.4]], np.float32)
    return truth * lamps[rng.integers(0, 3, (n, *truth.shape[:2]))]


def uneven(rng: Rng, truth: np.ndarray, n: int) -> Samples:
    """Noise of 3 % in one pixel and of 300 % in the next, always the same ones."""
    sd = 0.3 * np.exp(np.random.default_rng(8).normal(0, 1, (*truth.shape[:2], 1))).astype(np.float32)
    return gaussian(1.0)(rng, truth, n) * sd + truth * (1 - sd)


RAMP = np.linspace(0, 0.02, WIDTH, dtype=np.float32)[None, :, None]

FRESH: dict[str, Kind] = {
    "inverse Gaussian, .2": factors(lambda rng, size: rng.wald(1.0, 0.2, size)),
    "roulette": factors(roulette),
    "noise of 3 to 300 % by pixel": Kind(uneven),
    "a caustic's edge, 0 to .02 x 10": events(RAMP, 10.0),
    "Poisson counts of 3": factors(lambda rng, size: rng.poisson(3.0, size) / 3, channels=3),
    "one lamp of three": Kind(coloured_lamps),
}

KINDS = SHAPING | HELD_OUT | FRESH
