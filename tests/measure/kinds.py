"""Whether correct renders fail, for kinds of noise that renderers have: skewed, rare, in places, negative, clustered.

`python -m measure.kinds [alarms] [power] [held-out] [COUNT] [KIND ...]`, in tests/, prints the tables of
docs/measured/verdict.md: of COUNT (2000) sequences of up to 64 renders of 24 x 32 pixels, added one by one beside the
exact image and beside renders of the same kind, how many fail and how many are undecided in the end; and in how many
per cent of COUNT / 20 pairs planted faults are found. The rules of the verdict were shaped by SHAPING. HELD_OUT were
drawn up beside them, and first looked at when the rules were finished.
"""

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import numpy as np
from measure import record
from measure.noise_models import FILTERS, picture, times
from measure.sequences import HEIGHT, MOST, NOISES, WIDTH, Noise, Samples, chosen, gaussian, interval
from scipy.ndimage import convolve1d

from raytwin.compare import SequentialComparison, compare
from raytwin.images.image import Image
from raytwin.images.image_pool import ImagePool

SMALL = picture(HEIGHT, WIDTH).astype(np.float32)
CONTRAST = SMALL**4 + np.float32(0.002)


class Kind(NamedTuple):
    """Samples of a truth, and their mean."""

    noise: Noise
    mean: Callable[[np.ndarray], np.ndarray] = lambda truth: truth


def factors(draw: Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]) -> Kind:
    """The light times random numbers of mean 1, alike in all channels."""
    return Kind(lambda rng, truth, n: truth * draw(rng, (n, *truth.shape[:2], 1)).astype(np.float32))


def events(p: float, size: float, where: np.ndarray | float = 1.0, proportional: bool = False) -> Kind:
    """Noise of 3 %, and events of `size` in a share p of the samples, at the pixels `where`."""

    def added(truth: np.ndarray) -> np.ndarray:
        lit = np.broadcast_to(np.float32(size) * np.asarray(where, np.float32), (*truth.shape[:2], 1))
        return lit * truth if proportional else lit

    def noise(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
        return gaussian(0.03)(rng, truth, n) + chosen(rng, p, truth, n) * added(truth)

    return Kind(noise, lambda truth: truth + np.float32(p) * added(truth))


def box(y0: int, y1: int, x0: int, x1: int) -> np.ndarray:
    there = np.zeros((HEIGHT, WIDTH, 1), np.float32)
    there[y0:y1, x0:x1] = 1
    return there


def lanczos(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
    """Exponential noise of a bright disc under a filter with negative lobes. Its mean is `ringing()`, not `truth`.

    Each sample lies anywhere in its pixel, and is splatted with the kernel's weights over 7 x 7 pixels.
    """
    x = CONTRAST * rng.standard_exponential((n, *truth.shape), np.float32)
    for axis, at in ((1, rng.random((n, *truth.shape[:2], 1))), (2, rng.random((n, *truth.shape[:2], 1)))):
        x = sum(np.roll(x * lobes(step + 0.5 - at).astype(np.float32), step, axis) for step in range(-3, 4))
    return x


def lobes(x: np.ndarray) -> np.ndarray:
    return np.sinc(x) * np.sinc(x / 3) * (np.abs(x) < 3)


def ringing() -> np.ndarray:
    """The mean of `lanczos`: the kernel's integral over each pixel."""
    x, at = CONTRAST.astype(np.float64), (np.arange(200) + 0.5) / 200
    for axis in (0, 1):
        x = sum(np.roll(x * lobes(step + 0.5 - at).mean(), step, axis) for step in range(-3, 4))
    return x.astype(np.float32)


def control_variates(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
    """An estimate less another of the same light, whose mean is added: often negative, with either tail."""
    first, second = (rng.standard_exponential((n, *truth.shape), np.float32) for _ in range(2))
    return truth * (1.5 * first - 0.8 * second + 0.3)


def lognormal(sigma: float) -> Kind:
    return factors(lambda rng, size: np.exp(sigma * rng.standard_normal(size, np.float32) - sigma**2 / 2))


def two_points(p: float) -> Kind:
    return factors(lambda rng, size: (rng.random(size, np.float32) < p) / p)


FILTERED = {
    "tent filter": "tent",
    "Mitsuba's default film": "Mitsuba's Gaussian",
    "Gaussian filter, 1 pixel": "Gaussian, 1 pixel",
}


def blurred(name: str, truth: np.ndarray) -> np.ndarray:
    """The mean of `measure.sequences.filtered`."""
    radius, weight = FILTERS[FILTERED[name]]
    kernel = weight(np.arange(-math.ceil(radius), math.ceil(radius) + 1) * 1.0)
    for axis in (0, 1):
        truth = convolve1d(truth, kernel / kernel.sum(), axis=axis, mode="mirror")
    return truth


SHAPING: dict[str, Kind] = {
    **{
        name: Kind(noise)
        for name, (noise, truth) in NOISES.items()
        if truth.shape == SMALL.shape and "log-normal" not in name
    },
    **{name: Kind(NOISES[name][0], partial(blurred, name)) for name in FILTERED},
    "many fireflies": Kind(NOISES["many fireflies"][0], lambda truth: truth + np.float32(0.03)),
    "few fireflies": Kind(NOISES["few fireflies"][0], lambda truth: truth + np.float32(0.01)),
    "rare events": Kind(NOISES["rare events"][0], lambda truth: truth * np.float32(1.1)),
    "rare events in 10 x 14 pixels": events(0.01, 30.0, box(6, 16, 9, 23)),
    ".0003 x 300 everywhere": events(3e-4, 300.0),
    "two points, .02": two_points(0.02),
    "dark spikes": factors(lambda rng, size: (rng.random(size, np.float32) >= 0.02) / 0.98),
    "Weibull .5": factors(lambda rng, size: 0.5 * rng.standard_exponential(size, np.float32) ** 2),
    "lognormal 1": lognormal(1.0),
    "lognormal 1.5": lognormal(1.5),
    "control variates": Kind(control_variates),
    "events of the light, .001 x 5": events(1e-3, 5.0, proportional=True),
    "events of the light, .003 x 2": events(3e-3, 2.0, proportional=True),
    "events of the light, .01 x 1": events(1e-2, 1.0, proportional=True),
    "events of the light, .003 x 20": events(3e-3, 20.0, proportional=True),
    "events of the light, .0015 x 6": events(1.5e-3, 6.0, proportional=True),
    "Lanczos": Kind(lanczos, lambda truth: ringing()),
}


# ------------------------------------------------------------------------------------------ kinds that shaped no rule


def mixed_tiles(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
    """Exponential noise in one tile, light of one sample in thirty in the next."""
    y, x = np.mgrid[: truth.shape[0], : truth.shape[1]] // 8
    dense = ((x + y) % 2 == 0)[..., None]
    thin = 30 * chosen(rng, 1 / 30, truth, n)
    return truth * np.where(dense, rng.standard_exponential((n, *truth.shape), np.float32), thin)


def clusters(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
    """Events that light 3 x 3 pixels at once."""
    hit = chosen(rng, 5e-4, truth, n) * np.float32(8)
    for axis in (1, 2):
        hit = convolve1d(hit, np.ones(3), axis=axis, mode="mirror")
    return gaussian(0.1)(rng, truth, n) + hit


def correlated_channels(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
    grey = rng.standard_gamma(0.3, (n, *truth.shape[:2], 1)).astype(np.float32) / 0.3
    return truth * (0.9 * grey + 0.1 * rng.standard_exponential((n, *truth.shape), np.float32))


def clipped_cauchy(rng: np.random.Generator, size: tuple[int, ...]) -> np.ndarray:
    """|Cauchy| below 200, of mean ln(1 + 200²) / (2 arctan 200)."""
    u = rng.random(size) * math.atan(200.0) * 2 / math.pi
    return np.tan(math.pi / 2 * u) * 2 * math.atan(200.0) / math.log1p(200.0**2)


def lognormal_mixture(rng: np.random.Generator, size: tuple[int, ...]) -> np.ndarray:
    sigma = np.where(rng.random(size) < 0.1, 2.0, 0.4)
    return np.exp(sigma * rng.standard_normal(size) - sigma**2 / 2)


HELD_OUT: dict[str, Kind] = {
    "Student's t of 3": factors(lambda rng, size: 1 + 0.3 * rng.standard_t(3, size)),
    "Pareto 2.5": factors(lambda rng, size: 0.6 * (1 - rng.random(size)) ** (-1 / 2.5)),
    "mixture of lognormals": factors(lognormal_mixture),
    "gamma .05": factors(lambda rng, size: rng.standard_gamma(0.05, size) / 0.05),
    "Cauchy, cut at 200": factors(clipped_cauchy),
    "events of either sign": factors(
        lambda rng, size: (
            1 + 0.1 * rng.standard_normal(size) + 10 * (rng.random(size) < 2e-3) * rng.choice([-1, 1], size)
        )
    ),
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
    "rare events in a stripe": events(0.005, 40.0, box(0, 24, 13, 18)),
    "rare events in a corner of 6 x 6": events(0.02, 20.0, box(0, 6, 0, 6)),
    ".001 x 60 of the light": events(1e-3, 60.0, proportional=True),
}

KINDS = SHAPING | HELD_OUT


# ------------------------------------------------------------------------------------------ correct renders


def sequence(test: Samples, reference: Samples | Image) -> SequentialComparison:
    """All looks at these renders of one sample, added one by one; a reference that is an Image stays as it is."""
    fixed = reference if isinstance(reference, Image) else None
    check = SequentialComparison(fixed, detectable_bias=1e-9)
    for k in range(len(test)):
        other = None if fixed is not None else Image(reference[k], samples=1, batches=1)  # type: ignore[index]
        if check.add(Image(test[k], samples=1, batches=1), other) is not None:
            break
    return check


def reason_kinds(check: SequentialComparison) -> str:
    """Which tests failed."""
    assert check.comparison is not None
    return " ".join(dict.fromkeys(f.kind for f in check.comparison.findings if f.kind != "note"))


def alarms(count: int, kinds: Iterable[str]) -> list[list[str]]:
    """Rows: kind, fails of `count` sequences beside the exact image, beside renders of its kind, at which looks."""
    rows = []
    for name in kinds:
        cells, total, at = [name], 0, list[str]()
        for exact in (True, False):
            rng = np.random.default_rng([47_000, exact, *name.encode()])
            failed = 0
            for _ in range(count):
                test = KINDS[name].noise(rng, SMALL, MOST)
                other = Image(KINDS[name].mean(SMALL)) if exact else KINDS[name].noise(rng, SMALL, MOST)
                check = sequence(test.astype(np.float32), other if exact else other.astype(np.float32))
                if check.comparison is not None and check.comparison.verdict == "fail":
                    failed += 1
                    at.append(f"{check.samples} {reason_kinds(check)}")
            cells.append(f"{failed} of {count}")
            total += failed
        first = ", ".join(f"{what}: {at.count(what)}" for what in sorted(set(at), key=lambda w: int(w.split()[0]))[:6])
        rows.append([*cells, interval(total, 2 * count), first])
        print(" | ".join(rows[-1]), flush=True)
    return rows


# ------------------------------------------------------------------------------------------ wrong renders

FAULTS: dict[str, tuple[float, tuple[slice, slice]]] = {
    "nothing": (1.0, (slice(None), slice(None))),
    "1 % too bright": (1.01, (slice(None), slice(None))),
    "1 % too dark": (0.99, (slice(None), slice(None))),
    "5 % too bright": (1.05, (slice(None), slice(None))),
    "16 x 16 pixels 5 % too bright": (1.05, (slice(12, 28), slice(20, 36))),
    "16 x 16 pixels 5 % too dark": (0.95, (slice(12, 28), slice(20, 36))),
    "16 x 16 pixels 20 % too dark": (0.8, (slice(12, 28), slice(20, 36))),
    "a pixel doubled": (2.0, (slice(17, 18), slice(30, 31))),
}
"""How many times too bright, and where."""


def faulty(image: Image, fault: str) -> Image:
    """The render with its light, and so its noise, multiplied."""
    factor, place = FAULTS[fault]
    gain = np.ones(image.shape, np.float32)
    gain[place] = factor
    return times(image, gain)


SOUGHT = ("Gaussian", "exponential", "one sample in eight", "lognormal 1.5", "many fireflies")


def rendered(noise: Noise, rng: np.random.Generator, truth: np.ndarray, samples: int) -> Image:
    """`samples` in 16 batches, without holding many samples at once."""
    pool = ImagePool()
    for _ in range(16):
        parts = [noise(rng, truth, min(16, samples // 16 - k)) for k in range(0, samples // 16, 16)]
        batch = sum(part.sum(axis=0, dtype=np.float64) for part in parts) / (samples // 16)
        pool.add(Image(batch.astype(np.float32), samples=samples // 16, batches=1))
    return pool.image


def power(count: int, samples: tuple[int, ...] = (16, 64, 256)) -> list[list[str]]:
    """Rows: kind, fault, share of the pairs that fail at each number of samples beside the exact image, and a pair."""
    truth = picture(40, 56).astype(np.float32)
    rows = []
    for name in SOUGHT:
        found: dict[str, list[list[str]]] = {fault: [[], []] for fault in FAULTS}
        for n in samples:
            rng = np.random.default_rng([47_100, n, *name.encode()])
            pairs = [[rendered(KINDS[name].noise, rng, truth, n) for _ in range(2)] for _ in range(count)]
            for fault, shares in found.items():
                for share, beside_exact in zip(shares, (True, False), strict=True):
                    seen = [
                        compare(faulty(a, fault), Image(KINDS[name].mean(truth)) if beside_exact else b).verdict
                        for a, b in pairs
                    ]
                    share.append(f"{100 * seen.count('fail') / count:.0f}")
        for fault, shares in found.items():
            rows.append([name, fault, *(" / ".join(s) for s in shares)])
            print(" | ".join(rows[-1]), flush=True)
    return rows


def main(*words: str) -> None:
    count = next((int(w) for w in words if w.isdigit()), 2000)
    named = [w for w in words if w in KINDS]
    parts = [w for w in words if not w.isdigit() and w not in KINDS] or ["alarms", "held-out", "power"]
    columns = ["noise", "fails beside the exact image", "fails beside renders", "95 % interval", "at samples: fails"]
    command = "python -m measure.kinds {} {}"
    for part, kinds in (("alarms", SHAPING), ("held-out", HELD_OUT)):
        if part in parts:
            made = alarms(count, named or kinds)
            record.table("verdict", f"kinds-{part}", columns, made, command.format(part, count))
    if "power" in parts:
        columns = ["noise", "fault", "beside the exact image, %", "beside renders, %"]
        record.table("verdict", "kinds-power", columns, power(max(count // 20, 1)), command.format("power", count))


if __name__ == "__main__":
    main(*record.arguments())
