"""How often sequences of looks fail correct renders of skewed, rare or clustered noise, and what they find.

`python -m measure.sequences [shaping] [held-out] [fresh] [power] [misses] [COUNT] [KIND ...]`, in tests/, prints tables
of docs/measured.md: of COUNT (400) sequences of up to 64 renders of 24 x 32 pixels, added one by one beside the exact
image and beside renders of the same kind (measure.kinds), how many fail, and how many are undecided in the end; in how
many per cent of COUNT / 20 pairs planted faults are found; and how often an image passes that is off by just what a
pass excludes. No sequence passes while alarms are counted: each is looked at until all its samples are there.
"""

import math
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np
from measure import record
from measure.kinds import FRESH, HELD_OUT, KINDS, SHAPING, SMALL, Kind, Rng, Samples
from measure.noise_models import picture, times
from scipy.stats import binomtest

from raytwin.compare import Comparison, SequentialComparison, compare
from raytwin.images.image import Image
from raytwin.images.image_pool import ImagePool

MOST = 64
"""Samples of a sequence: five octaves of looks."""


def sequence(test: Samples, reference: Samples | Image, **options: Any) -> SequentialComparison:
    """All looks at these renders of one sample, or until the verdict is certain; an Image stays as it is."""
    fixed = reference if isinstance(reference, Image) else None
    check = SequentialComparison(fixed, **options)
    for k, one in enumerate(test):
        other = None if fixed is not None else Image(np.asarray(reference[k], np.float32), samples=1, batches=1)
        if check.add(Image(np.asarray(one, np.float32), samples=1, batches=1), other) is not None:
            break
    return check


def last_verdict(check: SequentialComparison) -> tuple[str, str]:
    """The verdict of the last look, and at how many samples which tests failed."""
    made = check.comparison
    assert isinstance(made, Comparison)
    kinds = dict.fromkeys(f.kind for f in made.findings if f.kind != "note")
    return made.verdict, f"{check.samples} {' '.join(kinds)}"


def alarms(count: int, kinds: Iterable[str]) -> list[list[str]]:
    """Rows: kind, fails and undecided of `count` sequences beside the exact image, beside renders, at which looks."""
    rows = []
    for name in kinds:
        cells, failed, at = [name], 0, Counter[str]()
        for exact in (True, False):
            rng = np.random.default_rng([47_000, exact, *name.encode()])
            noise, verdicts = KINDS[name].noise, Counter[str]()
            for _ in range(count):
                test = noise(rng, SMALL, MOST)
                other = Image(KINDS[name].mean(SMALL)) if exact else noise(rng, SMALL, MOST)
                verdict, where = last_verdict(sequence(test, other, detectable_bias=1e-9))
                verdicts[verdict] += 1
                at[where] += verdict == "fail"
            cells += [f"{verdicts['fail']} of {count}", str(verdicts["undecided"])]
            failed += verdicts["fail"]
        looks = ", ".join(f"{what}: {n}" for what, n in sorted(at.items(), key=lambda x: int(x[0].split()[0])) if n)
        rows.append([*cells, interval(failed, 2 * count), looks])
        print(" | ".join(rows[-1]), flush=True)
    return rows


def with_all(rows: list[list[str]]) -> list[list[str]]:
    """The rows, and one that adds them up."""
    count = int(rows[0][1].split(" of ")[1]) * len(rows)
    fails = [sum(int(row[column].split()[0]) for row in rows) for column in (1, 3)]
    undecided = [str(sum(int(row[column]) for row in rows)) for column in (2, 4)]
    cells = [f"{fails[0]} of {count}", undecided[0], f"{fails[1]} of {count}", undecided[1]]
    return [*rows, ["all", *cells, interval(sum(fails), 2 * count), ""]]


def interval(failed: int, of: int) -> str:
    """The 95 % interval of a rate in words, Clopper and Pearson's."""
    found = binomtest(failed, of).proportion_ci()
    return f"{found.low:.1e} to {found.high:.1e}"


# ------------------------------------------------------------------------------------------ wrong renders

ALL, CORNER = (slice(None), slice(None)), (slice(12, 28), slice(20, 36))
FAULTS: dict[str, tuple[float, tuple[slice, slice]]] = {
    "nothing": (1.0, ALL),
    "1 % too bright": (1.01, ALL),
    "1 % too dark": (0.99, ALL),
    "5 % too bright": (1.05, ALL),
    "16 x 16 pixels 5 % too bright": (1.05, CORNER),
    "16 x 16 pixels 5 % too dark": (0.95, CORNER),
    "16 x 16 pixels 20 % too dark": (0.8, CORNER),
    "a pixel doubled": (2.0, (slice(17, 18), slice(30, 31))),
}
"""How many times too bright, and where."""

SOUGHT = ("Gaussian", "exponential", "one sample in eight", "lognormal 1.5", "many fireflies")


def faulty(image: Image, fault: str) -> Image:
    """The render with its light, and so its noise, multiplied."""
    factor, place = FAULTS[fault]
    gain = np.ones(image.shape, np.float32)
    gain[place] = factor
    return times(image, gain)


def rendered(kind: Kind, rng: Rng, truth: np.ndarray, samples: int, batches: int = 16) -> Image:
    """`samples` in batches, without holding many samples at once."""
    pool, each = ImagePool(), samples // batches
    for _ in range(batches):
        parts = [kind.noise(rng, truth, min(16, each - k)) for k in range(0, each, 16)]
        batch = sum(part.sum(axis=0, dtype=np.float64) for part in parts) / each
        pool.add(Image(batch.astype(np.float32), samples=each, batches=1))
    return pool.image


def power(count: int, samples: tuple[int, ...] = (16, 64, 256)) -> list[list[str]]:
    """Rows: kind, fault, share of the pairs that fail at each number of samples beside the exact image, and a pair."""
    truth = picture(40, 56).astype(np.float32)
    rows = []
    for name in SOUGHT:
        kind, exact = KINDS[name], Image(KINDS[name].mean(truth))
        found: dict[str, tuple[list[str], list[str]]] = {fault: ([], []) for fault in FAULTS}
        for n in samples:
            rng = np.random.default_rng([47_100, n, *name.encode()])
            pairs = [[rendered(kind, rng, truth, n) for _ in range(2)] for _ in range(count)]
            for fault, shares in found.items():
                for share, others in zip(shares, ([exact] * count, [b for _, b in pairs]), strict=True):
                    seen = [compare(faulty(a, fault), b).verdict for (a, _), b in zip(pairs, others, strict=True)]
                    share.append(f"{100 * seen.count('fail') / count:.0f}")
        for fault, shares in found.items():
            rows.append([name, fault, *(" / ".join(s) for s in shares)])
            print(" | ".join(rows[-1]), flush=True)
    return rows


def misses(count: int) -> list[list[str]]:
    """Rows: noise, how often an image passes that is off by just what a pass excludes, and the median samples."""
    rows = []
    for name in ("Gaussian", "exponential"):
        noise = KINDS[name].noise
        for bias in (0.05, 0.02):
            rng = np.random.default_rng([43_000, int(1e4 * bias), *name.encode()])
            asked = {"detectable_bias": bias, "detectable_tile_bias": 9.0}
            passed, at = 0, [list[int](), list[int]()]
            for _ in range(count):
                for wrong, truth in enumerate((SMALL, SMALL * (1 + bias))):
                    check = sequence(noise(rng, truth, 512), noise(rng, SMALL, 512), **asked)
                    passed += bool(wrong) and check.decided and last_verdict(check)[0] == "pass"
                    at[wrong].append(check.samples)
            high = binomtest(passed, count).proportion_ci().high
            medians = [f"{np.median(samples):g}" for samples in at]
            rows.append([name, f"{100 * bias:g} %", f"{passed} of {count}", f"{high:.2g}", *medians])
            print(rows[-1], flush=True)
    return rows


COLUMNS = {
    "power": ["noise", "fault", "beside the exact image, %", "beside renders, %"],
    "misses": ["noise", "bias", "passed", "95 %, at most", "samples, correct", "samples, biased"],
}
BESIDE = ["fails beside the exact image", "undecided", "fails beside renders", "undecided"]


def main(*words: str) -> None:
    count = next((int(w) for w in words if w.isdigit()), 400)
    named = [w for w in words if w in KINDS]
    parts = [w for w in words if not w.isdigit() and w not in KINDS]
    for part in parts or ["shaping", "held-out", "fresh", "power", "misses"]:
        command, name = f"python -m measure.sequences {part} {count}", f"sequences-{part}"
        if part in COLUMNS:
            rows = power(max(count // 20, 1)) if part == "power" else misses(math.ceil(count / 10))
            record.table("verdict", name, COLUMNS[part], rows, command)
            continue
        kinds = named or {"shaping": SHAPING, "held-out": HELD_OUT, "fresh": FRESH}[part]
        columns = ["noise", *BESIDE, "95 % interval", "at samples: fails"]
        record.table("verdict", name, columns, with_all(alarms(count, kinds)), command)


if __name__ == "__main__":
    main(*record.arguments())
