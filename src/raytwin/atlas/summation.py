"""Adding up a pixel's samples: plainly, in pairs, with compensation, in wider floats; and random numbers used twice."""

from math import sqrt

import numpy as np

from raytwin.atlas.experiment import U32, Error, Experiment, decades

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


PIXELS = 64
"""Pixels of the picture whose noise is averaged over frames."""


def seeds(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """By how much the mean of x frames of 64 pixels, a sample each, errs more than its pixels' scatter claims."""
    frames = round(x)

    def excess(drawn: tuple[int, int]) -> float:
        """Real over claimed standard deviation, less 1, where (frames, pixels) of the random numbers are fresh."""
        means = np.array([rng.standard_normal(drawn).mean() for _ in range(n)])
        return float(abs(np.sqrt(np.mean(means**2)) * sqrt(frames * PIXELS) - 1))

    return {
        "seeds of their own: raytwin": excess((frames, PIXELS)), "the same in every frame": excess((1, PIXELS)),
        "the same in every pixel": excess((frames, 1)),
    }  # fmt: skip


EXPERIMENTS = (
    Experiment(
        "sum-samples", "Adding up a pixel's samples", "samples", "relative error of the sum", 1e-3, decades(3, 8),
        added,
        ("float64: raytwin",),
        "A float32 sum that has reached 2^25 no longer moves when a sample of 1 is added, because half of its step is "
        "more: the picture stops converging, and looks converged. Adding in pairs or with compensation keeps all "
        "digits, and so does float64, in which raytwin's batches are summed.",
        "Kahan, Further remarks on reducing truncation errors (1965); Higham, Accuracy and Stability (2002), ch. 4",
        {"plain, float32": stagnant}, more=decades(3, 9), slack=1.5, trials=1, many=1,
    ),
    Experiment(
        "sum-seeds", "Random numbers used twice", "frames averaged", "real over claimed standard deviation, less 1",
        0.5,
        (1.0, 3.0, 10.0, 30.0, 100.0, 300.0), seeds, ("seeds of their own: raytwin",),
        "An average of n independent frames errs by 1/√n of one; with the same seed in every frame it errs as one "
        "frame, and with the same seed in every pixel all pixels err together. The pixels' scatter tells of neither, "
        "so raytwin's verdict takes images that err as a whole for undecided.",
        "Mitsuba 3, Sampler.seed: one number a render and a pixel",
        {"the same in every frame": lambda x: sqrt(x) - 1, "the same in every pixel": lambda x: sqrt(PIXELS) - 1},
        slack=1.3, trials=400, many=4000,
    ),
)  # fmt: skip
