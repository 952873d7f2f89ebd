"""Adding up a pixel's samples: plainly, in pairs, with compensation, in wider floats."""

from math import sqrt

import numpy as np

from raytwin.study.atlas.experiment import U32, Error, Experiment, spaced

CHUNK = 1 << 20
"""Values drawn at a time: bounds the memory, not the sum."""


def added(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """x samples of radiance, uniform from 0 to 2, in float32: relative error of their sum. The truth is summed in
    integers: each sample is a multiple of 2^-23."""
    count, whole = round(x), 0
    plain, paired, wide = np.float32(0), [], 0.0
    kahan, lost = np.float32(0), np.float32(0)
    for start in range(0, count, CHUNK):
        steps = rng.integers(0, 1 << 24, min(CHUNK, count - start), dtype=np.int64)
        whole += int(steps.sum())
        values = steps.astype(np.float32) * np.float32(2**-23)
        plain = np.cumsum(np.concatenate([[plain], values]), dtype=np.float32)[-1]
        paired.append(part := np.add.reduce(values))  # NumPy adds in pairs, from blocks of 128 on
        wide += float(values.sum(dtype=np.float64))
        y = part - lost
        kahan, lost = kahan + y, ((kahan + y) - kahan) - y
    truth = whole * 2.0**-23
    found = {
        "plain, float32": plain, "in pairs, float32": np.add.reduce(np.array(paired, np.float32)),
        "compensated, float32": kahan, "float64: raytwin": wide,
    }  # fmt: skip
    return {name: abs(float(s) - truth) / truth for name, s in found.items()}


def stagnant(x: float) -> float:
    """Samples of mean 1 no longer move a float32 sum of 2^25, being less than half of its step; before, each addition
    rounds by up to u of the sum, at random: √n u / 3 in all."""
    return max(1 - 2.0**25 / x, U32 * sqrt(x) / 3)


EXPERIMENTS = (
    Experiment(
        "sum-samples", "Adding up a pixel's samples", "samples", "relative error of the sum", 1e-3, spaced(1e3, 1e8, 6),
        added,
        ("float64: raytwin",),
        "A float32 sum that has reached 2^25 no longer moves when a sample of 1 is added, because half of its step is "
        "more: the picture stops converging, and looks converged. Adding in pairs or with compensation keeps all "
        "digits, and so does float64, in which raytwin's batches are summed.",
        "Kahan, Further remarks on reducing truncation errors (1965); Higham, Accuracy and Stability (2002), ch. 4",
        {"plain, float32": stagnant}, slack=1.5, trials=1,
    ),
)  # fmt: skip
