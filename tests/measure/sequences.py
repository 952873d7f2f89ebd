"""How often sequences of looks fail correct renders of skewed, rare or clustered noise.

`python -m measure.sequences [shaping] [held-out] [fresh] [COUNT] [KIND ...]`, in tests/, prints tables of
docs/measured.md: of COUNT (400) sequences of up to 64 renders of 24 x 32 pixels, added one by one beside the exact
image and beside renders of the same kind (measure.kinds), how many fail, and how many are undecided in the end. No
sequence passes: each is looked at until all its samples are there. (What is found of faults: measure.power.)
"""

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np
from measure import record
from measure.kinds import FRESH, HELD_OUT, KINDS, SHAPING, SMALL, Samples
from scipy.stats import binomtest

from raytwin.compare import Comparison, SequentialComparison
from raytwin.images.image import Image

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


BESIDE = ["fails beside the exact image", "undecided", "fails beside renders", "undecided"]


def main(*words: str) -> None:
    count = next((int(w) for w in words if w.isdigit()), 400)
    named = [w for w in words if w in KINDS]
    sets = {"shaping": SHAPING, "held-out": HELD_OUT, "fresh": FRESH}
    for part in [w for w in words if w in sets] or sets:
        columns = ["noise", *BESIDE, "95 % interval", "at samples: fails"]
        command = f"python -m measure.sequences {part} {count}"
        record.table("verdict", f"sequences-{part}", columns, with_all(alarms(count, named or sets[part])), command)


if __name__ == "__main__":
    main(*record.arguments())
