"""The verdict on two noisy images: how often it fails correct ones, driven until it would, and what it still sees."""

import math
from collections.abc import Callable

import numpy as np
from measure.noise_models import picture, quantised, render, untold
from scipy.special import ndtr, ndtri, stdtr

from raytwin.atlas.experiment import Error, Experiment
from raytwin.compare import compare
from raytwin.files.rounding import half_code
from raytwin.image import Image

HEIGHT, WIDTH = 32, 48
VALUES = HEIGHT * WIDTH * 3
RATE = 1e-3
"""The false-alarm rate that the verdict states."""

BOUND = 0.1
"""Of a quick run's few pairs: one false alarm may be chance."""

OURS = "raytwin, or undecided"
Z_TEST = "z-test of each value, Sidak"
TRUTH = picture(HEIGHT, WIDTH)


def failing(make: Callable[[np.random.Generator], tuple[Image, Image]], weak: Callable[[Image, Image], bool], name: str,
            rng: np.random.Generator, n: int) -> dict[str, Error]:  # fmt: skip
    """The share of n correct pairs that fail: by a `weak` test called `name`, and by raytwin's verdict."""
    by_weak, verdicts = 0, []
    for _ in range(n):
        test, reference = make(rng)
        by_weak += weak(test, reference)
        verdicts.append(compare(test, reference, false_alarm_rate=RATE).verdict)
    decided = [v for v in verdicts if v != "undecided"]
    ours = sum(v == "fail" for v in decided) / n if 2 * len(decided) > n else None
    return {name: by_weak / n, OURS: ours}


def truth_image() -> Image:
    return Image(TRUTH.astype(np.float32))


def variance_of(image: Image) -> np.ndarray:
    return np.zeros(image.shape) if image.variance is None else image.variance.astype(float)


def sidak(test: Image, reference: Image) -> bool:
    """Whether any value lies beyond the normal's quantile at 1 - (1 - RATE)^(1/n), two-sided: Mitsuba's test, taking
    each variance for exact."""
    z = np.abs(test.mean - reference.mean.astype(float)) / np.sqrt(variance_of(test) + variance_of(reference) + 1e-300)
    return bool(z.max() > limit(VALUES))


def limit(values: int) -> float:
    return float(-ndtri(-np.expm1(np.log1p(-RATE) / values) / 2))


def few(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Renders of x batches against the truth."""
    batches = round(x)
    return failing(lambda r: (render(r, TRUTH, batches, batches), truth_image()), sidak, Z_TEST, rng, n)


def heavy_tails(x: float) -> float:
    """1 - (1 - 2 T(-z))^n, T Student's distribution with x - 1 degrees of freedom."""
    return float(-np.expm1(VALUES * np.log1p(-2 * stdtr(round(x) - 1, -limit(VALUES)))))


def filtered(width: float, rng: np.random.Generator, samples: int = 16) -> Image:
    """Independent noise, then a Gaussian filter `width` pixels wide (sd), as a film with such a filter has it."""
    reach = max(1, math.ceil(4 * width))
    w = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    w /= w.sum()
    batches = []
    for _ in range(samples):
        noise = rng.normal(size=(HEIGHT + 2 * reach, WIDTH + 2 * reach, 3))
        for axis in (0, 1):
            noise = np.apply_along_axis(np.convolve, axis, noise, w, "valid")
        batches.append(TRUTH + 0.3 * TRUTH * noise)
    stack = np.array(batches)
    mean, variance = stack.mean(axis=0), stack.var(axis=0, ddof=1) / samples
    return Image(mean.astype(np.float32), variance.astype(np.float32), samples, None, samples)


def of_mean(test: Image, reference: Image) -> bool:
    """Whether the mean of a channel differs by more than independent pixels' noise explains."""
    off = (test.mean.astype(float) - reference.mean).mean(axis=(0, 1))
    sd = np.sqrt((variance_of(test) + variance_of(reference)).sum(axis=(0, 1))) / (HEIGHT * WIDTH)
    return bool((np.abs(off) / sd).max() > limit(3))


def wide(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    return failing(lambda r: (filtered(x, r), truth_image()), of_mean, "z-test of the mean", rng, n)


def inflated(x: float) -> float:
    """A filter with Σ w² = 1 / (2 √π x) along an axis, at most 1, leaves as many independent pixels."""
    spread = max(1.0, 2 * math.sqrt(math.pi) * x)
    return float(-np.expm1(3 * np.log(1 - 2 * ndtr(-limit(3) / spread))))


def coarse(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Renders of 64 samples with the relative noise x, kept in 8 bits of sRGB; raytwin's verdict is told so."""
    by_weak, failed = 0, 0
    for _ in range(n):
        test, reference = (render(rng, 0.9 * TRUTH, count, 64, sd=x) for count in (64, 4096))
        test = quantised(test)
        by_weak += sidak(test, reference)
        failed += compare(test, reference, half_steps=(half_code(test.mean, 255), None)).verdict == "fail"
    return {Z_TEST: by_weak / n, OURS: failed / n}


def rounded(x: float) -> float:
    """Rounding is spread evenly over a step, 2.2 / 255 near 0.5 of radiance, and its variance is the noise's besides:
    1 - (1 - 2 Φ(-z / √(1 + ρ²)))^n."""
    noise, rounding = 0.5 * x / 8, 2.2 / 255 * 0.55 / math.sqrt(12)
    return float(-np.expm1(VALUES * np.log1p(-2 * ndtr(-limit(VALUES) / math.hypot(1, rounding / noise)))))


def silent(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Renders with the relative noise x that tell no variance, against a reference that tells its own."""
    pairs = lambda r: (untold(render(r, TRUTH, sd=x)), render(r, TRUTH, samples=4096, sd=x))  # noqa: E731
    return failing(pairs, noise_free, "taken for free of noise", rng, n)


def noise_free(test: Image, reference: Image) -> bool:
    """Whether one value in a thousand is off by more than 1e-5."""
    return bool(np.quantile(np.abs(test.mean - reference.mean), 0.999) > 1e-5)


def noisy_enough(x: float) -> float:
    """Sixteen samples leave x / 4 of noise: beyond 1e-5 / 3.3 the thousandth value is off by more."""
    return float(3.3 * 0.6 * x / 4 > 1e-5)


def spiked(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Renders of 16 samples with an event of 100 in a share x of them, against the reference of 4096."""

    def make(r: np.random.Generator) -> tuple[Image, Image]:
        return render(r, TRUTH, p=x, size=100.0), render(r, TRUTH, samples=4096, p=x, size=100.0)

    return failing(make, sidak, Z_TEST, rng, n)


MEAN_ERROR = 0.3 / 16 / math.sqrt(HEIGHT * WIDTH)
"""Relative standard error of a channel's mean at 256 samples, the picture being of about one brightness."""


def missed(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """The share of renders x too bright that pass: 256 samples against 4096."""
    found = dict.fromkeys((OURS, Z_TEST, "no value off by 10 % (idiff's kind)"), 0.0)
    for _ in range(n):
        test, reference = render(rng, TRUTH * (1 + x), samples=256), render(rng, TRUTH, samples=4096)
        found[OURS] += (compare(test, reference).verdict == "pass") / n
        found[Z_TEST] += (not sidak(test, reference)) / n
        found["no value off by 10 % (idiff's kind)"] += bool((np.abs(test.mean / reference.mean - 1) <= 0.1).all()) / n
    return {**found}


FALSE = "share of correct pairs that fail"

EXPERIMENTS = (
    Experiment(
        "verdict-batches", "A verdict from few batches", "batches", FALSE, BOUND,
        (256.0, 128.0, 64.0, 32.0, 16.0, 8.0, 4.0, 2.0), few,
        (OURS,),
        "A variance from few batches is itself uncertain, and now and then far too small, so that z has Student's "
        "heavy tails: among thousands of values some lie far out. The verdict uses Student's distribution, and means "
        "of many pixels.",
        "Student, The probable error of a mean (1908); Mitsuba 3's own rendering tests", {Z_TEST: heavy_tails},
        slack=2, trials=20, many=500,
    ),
    Experiment(
        "verdict-filter", "A film's filter wider than the pixel", "standard deviation of the filter, pixels", FALSE,
        BOUND,
        (0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 3.0), wide, (OURS,),
        "A filter makes neighbours alike, and the mean of a picture then has fewer independent pixels than it shows: "
        "12 times fewer at 1 pixel. The verdict measures how alike neighbours are, and widens what noise may explain.",
        "Cressie, Statistics for Spatial Data (1993), section 2.4", {"z-test of the mean": inflated}, slack=2,
        trials=20, many=300,
    ),
    Experiment(
        "verdict-silent", "A render that tells no variance", "relative noise of a sample", FALSE, BOUND,
        (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0), silent, (OURS,),
        "An image without a variance looks like one without noise, and noise beyond the tolerance then looks like a "
        "fault. The verdict takes the noise from the other side's, by the samples' ratio, or from the difference "
        "itself.",
        "docs/explanation/verdict.md", {"taken for free of noise": noisy_enough}, slack=2, trials=20, many=500,
    ),
    Experiment(
        "verdict-spikes", "Rare bright events", "share of samples with an event of 100", FALSE, BOUND,
        (1e-6, 1e-5, 1e-4, 1e-3, 1e-2), spiked, (OURS,),
        "A firefly that few batches see makes mean and variance jump together, and one that the test has not seen at "
        "all is missing from both. The verdict grants what the reference has seen, and says undecided where that is "
        "more than it could tell.",
        "Zirr, Hanika and Dachsbacher, Re-weighting firefly samples (2018)", trials=20, many=500,
    ),
    Experiment(
        "verdict-bits", "A render kept in 8 bits", "relative noise of a sample", FALSE, BOUND,
        (3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.001), coarse, (OURS,),
        "Eight bits round each value by up to a 510th of the scale, and once the noise is smaller than that, rounding "
        "looks like a fault. The verdict grants half a step, value by value, and in a mean only what rounding leaves "
        "of one.",
        "Widrow and Kollár, Quantization Noise (2008)", {Z_TEST: rounded}, slack=3, trials=20, many=500,
    ),
    Experiment(
        "verdict-power", "Faults that are hard to see", "how much too bright", "share of faulty renders that pass",
        BOUND,
        (0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 0.0003), missed, (OURS,),
        "What no false alarm costs: a fault is seen while it moves the whole image's mean by some four standard "
        "errors, which here is 0.2 %. Tests of single values need fifty times as much, because each has all the noise "
        "of its pixel.",
        "docs/measured/verdict.md",
        {OURS: lambda x: float(ndtr(limit(15) - x / MEAN_ERROR)),
         Z_TEST: lambda x: float(ndtr(limit(VALUES) - 16 * x / 0.3) ** VALUES)},
        limit=0.003, slack=2.5, trials=20, many=300,
    ),
)  # fmt: skip
