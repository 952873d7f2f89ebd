"""How often sequences of looks fail correct renders, how soon they see a fault, and what a pass is worth.

`python -m measure.sequences [alarms] [speed] [misses] [rivals] [COUNT] [NOISE ...]`, in tests/, prints the tables of
docs/measured.md: alarms of COUNT (1000) sequences of each kind of noise and reference; samples to certainty for
each size of fault, beside the best fixed number in hindsight and the mixture martingale, which was the other way to
stop; and how often an image passes that is off by just what a pass excludes. OMP_NUM_THREADS=1 halves the time.

The pictures are small (24 x 32), so that thousands of sequences take minutes. No sequence passes while alarms are
counted: each is looked at until all its samples are there.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from measure import record
from measure.noise_models import FILTERS, lognormal, picture
from measure.other_tools import sees_by_sign_flips, sees_welch
from scipy.ndimage import convolve1d
from scipy.stats import binomtest

from raytwin.compare import SequentialComparison, compare
from raytwin.images.image import Image
from raytwin.images.image_pool import ImagePool

HEIGHT, WIDTH = 24, 32
MOST = 64
"""Samples of a sequence: five octaves of looks."""

Samples = np.ndarray
"""(n, H, W, 3): a render's samples, one after the other."""

Noise = Callable[[np.random.Generator, np.ndarray, int], Samples]


def gaussian(sd: float) -> Noise:
    return lambda rng, truth, n: truth + (sd * truth) * rng.standard_normal((n, *truth.shape), np.float32)


def exponential(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
    return truth * rng.standard_exponential((n, *truth.shape), np.float32)


def chosen(rng: np.random.Generator, p: float, truth: np.ndarray, n: int) -> np.ndarray:
    """(n, H, W, 1) of 0 and 1: a share p of the samples, alike in all channels."""
    return (rng.random((n, *truth.shape[:2], 1), np.float32) < p).astype(np.float32)


def fireflies(p: float, size: float, proportional: bool = False) -> Noise:
    """Gaussian noise, and an event of that size in a share p of the samples, in all channels at once."""

    def noise(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
        events = chosen(rng, p, truth, n) * size
        return gaussian(0.3)(rng, truth, n) + events * (truth if proportional else 1.0)

    return noise


def filtered(name: str) -> Noise:
    """Exponential noise under a reconstruction filter: neighbours share their samples."""
    radius, weight = FILTERS[name]
    reach = math.ceil(radius)
    kernel = weight(np.arange(-reach, reach + 1) * 1.0)
    kernel = kernel / kernel.sum()

    def noise(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
        out = exponential(rng, truth, n)
        for axis in (1, 2):
            out = convolve1d(out, kernel, axis=axis, mode="mirror")
        return out

    return noise


def sparse(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
    """Light that one sample in eight meets, as a small lamp's."""
    return truth * 8 * chosen(rng, 1 / 8, truth, n)


def shaded(p: float) -> Noise:
    """Light that a share p of the samples finds hidden: most pixels' samples agree, and no variance tells of the rest.

    A quarter of the picture has exponential noise.
    """

    def noise(rng: np.random.Generator, truth: np.ndarray, n: int) -> Samples:
        out = truth / (1 - p) * chosen(rng, 1 - p, truth, n)
        rows = truth.shape[0] // 4
        out[:, :rows] = exponential(rng, truth[:rows], n)
        return out

    return noise


SMALL = picture(HEIGHT, WIDTH).astype(np.float32)
NOISES: dict[str, tuple[Noise, np.ndarray]] = {
    "Gaussian": (gaussian(0.3), SMALL),
    "exponential": (exponential, SMALL),
    "exponential, in a log-normal picture": (exponential, lognormal(HEIGHT, WIDTH).astype(np.float32)),
    "one sample in eight": (sparse, SMALL),
    "one sample in 200 shaded": (shaded(0.005), SMALL),
    "many fireflies": (fireflies(1e-3, 30.0), SMALL),
    "few fireflies": (fireflies(1e-4, 100.0), SMALL),
    "rare events": (fireflies(1e-3, 100.0, proportional=True), SMALL),
    "tent filter": (filtered("tent"), SMALL),
    "Mitsuba's default film": (filtered("Mitsuba's Gaussian"), SMALL),
    "Gaussian filter, 1 pixel": (filtered("Gaussian, 1 pixel"), SMALL),
}


def pooled(samples: Samples) -> Image:
    """Samples as a renderer's image of them: up to 16 batches."""
    n = len(samples)
    batches = next(b for b in range(min(16, n), 0, -1) if n % b == 0)
    means = samples.reshape(batches, n // batches, *samples.shape[1:]).mean(axis=1)
    variance = means.var(axis=0, ddof=1) / batches if batches > 1 else None
    mean = means.mean(axis=0).astype(np.float32)
    return Image(mean, None if variance is None else variance.astype(np.float32), n, None, batches)


def sequence(test: Samples, reference: Samples | Image, **options: Any) -> SequentialComparison:
    """All looks at these samples, or until the verdict is certain; a reference that is an Image stays as it is."""
    fixed = reference if isinstance(reference, Image) else None
    check = SequentialComparison(fixed, **options)
    while not check.decided and check.samples < len(test):
        have = check.samples
        until = min(check.next_look, len(test))
        for chunk in _chunks(have, until):
            check.add(pooled(test[chunk]), None if fixed is not None else pooled(reference[chunk]))  # type: ignore[index]
    return check


def _chunks(have: int, until: int) -> Iterator[slice]:
    """Fours, so that every render has a variance, and single samples for the rest."""
    whole = have + (until - have) // 4 * 4
    if whole > have:
        yield slice(have, whole)
    yield from (slice(i, i + 1) for i in range(whole, until))


def reference_of(noise: Noise, truth: np.ndarray, rng: np.random.Generator) -> Image:
    """A stored reference of 1024 samples."""
    pool = ImagePool()
    for _ in range(16):
        pool.add(pooled(noise(rng, truth, 64)))
    return pool.image


def alarms(count: int, names: Sequence[str] = tuple(NOISES)) -> list[list[str]]:
    """Rows: noise, alarms of `count` sequences with both sides in rounds and with a stored reference, of all, looks."""
    rows = []
    for name in names:
        noise, truth = NOISES[name]
        cells, total, looks = [name], 0, 0
        for stored in (False, True):
            rng = np.random.default_rng([41_000, stored, *name.encode()])
            failed, reference = 0, None
            for k in range(count):
                if stored and k % 20 == 0:
                    reference = reference_of(noise, truth, rng)
                other = reference if reference is not None else noise(rng, truth, MOST)
                check = sequence(noise(rng, truth, MOST), other, detectable_bias=1e-9)
                failed += check.comparison is not None and check.comparison.verdict == "fail"
                looks += check.looks
            cells.append(f"{failed} of {count}")
            total += failed
        rows.append([*cells, interval(total, 2 * count), f"{looks / 2 / count:.1f}"])
        print(rows[-1], flush=True)
    return rows


def interval(alarms: int, of: int) -> str:
    """The 95 % interval of a rate in words, Clopper and Pearson's."""
    found = binomtest(alarms, of).proportion_ci()
    return f"{found.low:.1e} to {found.high:.1e}"


def with_all(rows: list[list[str]]) -> list[list[str]]:
    """The rows, and one that adds them up."""
    counts = np.array([[[int(n) for n in cell.split(" of ")] for cell in row[1:3]] for row in rows]).sum(axis=0)
    total = counts.sum(axis=0)
    return [*rows, ["all", *(f"{k} of {n}" for k, n in counts.tolist()), interval(int(total[0]), int(total[1])), ""]]


# ------------------------------------------------------------------------------------------ samples to certainty


def mixture(test: Samples, reference: Samples, rate: float, g: float = 0.02) -> int | None:
    """Samples until the mixture martingale rejects: the whole image and every tile of 8 x 8, in each channel.

    E_n = (1 + n g)^(-1/2) exp(g S² / (2 (1 + n g))) with S the sum of the batches' differences in standard deviations,
    against K / rate for K sums (Robbins 1970; Waudby-Smith et al., arXiv 2103.06476; Vovk and Wang 2021). The standard
    deviations are pooled over each sum's pixels, which are taken for independent.
    """
    d = test - reference
    n = np.arange(1, len(d) + 1)[:, None, None]
    total = np.cumsum(d, axis=0)
    spread = np.cumsum(np.square(d), axis=0) - np.square(total) / n[..., None]
    sums, variances = (_tiles(x) for x in (total, spread / np.maximum(n[..., None] - 1, 1)))
    z2 = np.divide(np.square(sums), variances, out=np.zeros_like(sums), where=variances > 0)
    log_e = -0.5 * np.log1p(n * g) + g * z2 / (2 * (1 + n * g))
    crossed = (log_e > math.log(sums[0].size / rate)).any(axis=(1, 2))
    crossed[:3] = False  # of fewer no variance is known
    return int(np.argmax(crossed)) + 1 if crossed.any() else None


def _tiles(x: np.ndarray) -> np.ndarray:
    """(n, H, W, 3) to sums (n, tiles + 1, 3): the last is the whole image's."""
    n, h, w, c = x.shape
    tiles = x[:, : h // 8 * 8, : w // 8 * 8].reshape(n, h // 8, 8, w // 8, 8, c).sum(axis=(2, 4))
    return np.concatenate([tiles.reshape(n, -1, c), x.sum(axis=(1, 2))[:, None]], axis=1)


def faulty(truth: np.ndarray, size: float, local: bool) -> np.ndarray:
    """`truth` too bright by the factor 1 + size, in 16 x 16 pixels or everywhere."""
    out = truth.copy()
    out[(slice(4, 20), slice(8, 24)) if local else slice(None)] *= 1 + size
    return out


def best_fixed(pairs: list[tuple[Samples, Samples]]) -> float:
    """The fewest samples, on the looks' own grid, at which one comparison fails nine pairs of ten."""
    most, n, last = len(pairs[0][0]), 4, math.nan
    while n <= most:
        seen = sum(compare(pooled(a[:n]), pooled(b[:n])).verdict == "fail" for a, b in pairs)
        if seen >= 0.9 * len(pairs):
            return n
        n = max(n + 4, round(n * 2**0.25 / 4) * 4)
    return last


def speed(count: int) -> list[list[str]]:
    """Rows: noise, fault, best fixed number, and for the looks and the mixture the median and its ratio to that."""
    rows = []
    for name in ("Gaussian", "exponential"):
        noise, truth = NOISES[name]
        for local in (False, True):
            for size in (0.3, 0.1, 0.03):
                rng = np.random.default_rng([42_000, local, int(1e4 * size), *name.encode()])
                most, wrong = 256, faulty(truth, size, local)
                pairs = [(noise(rng, wrong, most), noise(rng, truth, most)) for _ in range(count)]
                best = best_fixed(pairs[:10])
                if math.isnan(best):
                    continue
                found = [sequence(a, b, detectable_bias=1e-9) for a, b in pairs]
                ours = np.median([s.samples if s.decided else math.inf for s in found])
                theirs = np.median([mixture(a, b, 1e-3) or math.inf for a, b in pairs])
                fault = f"{100 * size:g} % in {'16 x 16 pixels' if local else 'the whole image'}"
                ratios = [f"{m:g} ({m / best:.2f})" for m in (ours, theirs)]
                rows.append([name, fault, f"{best:g}", *ratios])
                print(rows[-1], flush=True)
    return rows


def misses(count: int) -> list[list[str]]:
    """Rows: noise, how often an image passes that is off by just what a pass excludes, and the median samples."""
    rows = []
    for name in ("Gaussian", "exponential"):
        noise, truth = NOISES[name]
        for bias in (0.05, 0.02):
            rng = np.random.default_rng([43_000, int(1e4 * bias), *name.encode()])
            passed, at = 0, {1.0: [], 1 + bias: []}
            for k in range(2 * count):
                off = (1.0, 1 + bias)[k % 2]
                check = sequence(noise(rng, truth * off, 512), noise(rng, truth, 512), detectable_bias=bias,
                                 detectable_tile_bias=9.0)  # fmt: skip
                comparison = check.comparison
                passed += off > 1 and check.decided and comparison is not None and comparison.verdict == "pass"
                at[off].append(check.samples)
            high = binomtest(passed, count).proportion_ci().high
            row = [name, f"{100 * bias:g} %", f"{passed} of {count}", f"{high:.2g}"]
            rows.append([*row, *(f"{np.median(samples):g}" for samples in at.values())])
            print(rows[-1], flush=True)
    return rows


def rivals(count: int) -> list[list[str]]:
    """Rows: noise, and for each test of 16 renders a side its alarms, its share of 5 % caught, its milliseconds."""
    tests: dict[str, Callable[[Samples, Samples], bool]] = {
        "raytwin": lambda a, b: compare(pooled(a), pooled(b)).verdict == "fail",
        "Welch": lambda a, b: sees_welch(_singles(a), _singles(b)),
        "sign flips": lambda a, b: sees_by_sign_flips(_singles(a), _singles(b)),
    }
    rows = []
    for name, (noise, truth) in NOISES.items():
        rng, cells = np.random.default_rng([44_000, *name.encode()]), [name]
        right = [(noise(rng, truth, 16), noise(rng, truth, 16)) for _ in range(count)]
        wrong = [(noise(rng, truth * 1.05, 16), noise(rng, truth, 16)) for _ in range(count // 4)]
        for sees in tests.values():
            began = time.process_time()
            alarms = sum(sees(a, b) for a, b in right)
            spent = (time.process_time() - began) / count
            caught = sum(sees(a, b) for a, b in wrong) / len(wrong)
            cells.append(f"{alarms} of {count}, {100 * caught:.0f} %, {1e3 * spent:.1f} ms")
        rows.append(cells)
        print(rows[-1], flush=True)
    return rows


def _singles(samples: Samples) -> list[Image]:
    return [Image(x, samples=1) for x in samples]


def main(*words: str) -> None:
    count = next((int(w) for w in words if w.isdigit()), 1000)
    parts = [w for w in words if not w.isdigit() and w not in NOISES] or ["alarms", "speed", "misses"]
    names = [w for w in words if w in NOISES] or list(NOISES)
    command = "python -m measure.sequences {} {}"
    if "alarms" in parts:
        columns = ["noise", "alarms, both sides in rounds", "alarms, stored reference", "95 % interval", "looks"]
        record.table(
            "verdict", "sequence-alarms", columns, with_all(alarms(count, names)), command.format("alarms", count)
        )
    if "speed" in parts:
        columns = ["noise", "too bright by", "best fixed number", "looks (ratio)", "mixture martingale (ratio)"]
        record.table("verdict", "sequence-speed", columns, speed(min(count, 40)), command.format("speed", count))
    if "rivals" in parts:
        columns = ["noise", *(f"{tool}: alarms, 5 % caught, time" for tool in ("raytwin", "Welch", "sign flips"))]
        record.table("verdict", "rivals", columns, rivals(min(count, 100)), command.format("rivals", count))
    if "misses" in parts:
        columns = ["noise", "bias", "passed", "95 %, at most", "samples, correct", "samples, biased"]
        record.table("verdict", "sequence-misses", columns, misses(min(count, 200)), command.format("misses", count))


if __name__ == "__main__":
    main(*record.arguments())
