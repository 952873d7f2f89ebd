"""Measure whether an image full of wrong pixels can pass for noise where nobody says how noisy it is.

`python -m measure.untold_patterns` multiplies correct images by 42 kinds of pattern at 5 amplitudes and compares
them, without variance, samples or renders, with references of five kinds. No image may pass. (What passes of genuine
noise that has no variance either: measure.power.)
"""

from collections import Counter
from collections.abc import Callable

import numpy as np
from measure import record
from measure.noise_models import picture, render, untold

from raytwin.compare import compare
from raytwin.images.image import Image

Rng = np.random.Generator
Pattern = Callable[[Rng, int, int], np.ndarray]
"""(rng, height, width) to (height, width) or (height, width, 3): mean about 0, largest magnitude about 1."""

AMPLITUDES = (0.06, 0.12, 0.25, 0.5, 1.0)


def _signs(wave: np.ndarray) -> np.ndarray:
    return np.where(wave, 1.0, -1.0)


def _placed(value: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Pattern:
    """A function of the row y and the column x."""
    return lambda rng, h, w: value(*np.mgrid[:h, :w])


def _stripes(period: int, down: int, across: int) -> Pattern:
    return _placed(lambda y, x: _signs((down * y + across * x) % period < period / 2))


def _checkers(side: int) -> Pattern:
    return _placed(lambda y, x: _signs((y // side + x // side) % 2 == 0))


def _wave(period: float, down: float, across: float) -> Pattern:
    return _placed(lambda y, x: np.sin(2 * np.pi * (down * y + across * x) / period))


def _random(
    draw: Callable[[Rng, tuple[int, ...]], np.ndarray], channels: int = 1, high: int = 1, wide: int = 1
) -> Pattern:
    """Independent in every `high` x `wide` pixels, 0 for all of a column or row; of three channels or alike in all."""

    def pattern(rng: Rng, h: int, w: int) -> np.ndarray:
        values = draw(rng, (-(-h // high) if high else 1, -(-w // wide) if wide else 1, channels))
        return np.repeat(np.repeat(values, high or h, axis=0), wide or w, axis=1)[:h, :w]

    return pattern


def _dither(size: int) -> Pattern:
    """Bayer's matrix of ordered dithering."""
    m = np.zeros((1, 1))
    while len(m) < size:
        m = np.block([[4 * m, 4 * m + 2], [4 * m + 3, 4 * m + 1]])
    m = (m - m.mean()) / (m.max() / 2)
    return _placed(lambda y, x: m[y % size, x % size])


def _two(rng: Rng, shape: tuple[int, ...]) -> np.ndarray:
    return _signs(rng.random(shape) < 0.5)


DRAWS: dict[str, Callable[[Rng, tuple[int, ...]], np.ndarray]] = {
    "two values": _two,
    "three values": lambda rng, shape: rng.integers(-1, 2, shape).astype(float),
    "even": lambda rng, shape: rng.uniform(-1, 1, shape),
    "a third of the pixels": lambda rng, shape: np.where(rng.random(shape) < 1 / 3, rng.uniform(-1, 1, shape), 0.0),
    "Gaussian": lambda rng, shape: np.clip(rng.normal(size=shape), -1, 1),
}


def _part(place: Callable[[np.ndarray, np.ndarray, int, int], np.ndarray]) -> Pattern:
    """Two values at random, in a part of the picture."""
    return lambda rng, h, w: np.where(place(*np.mgrid[:h, :w], h, w), _two(rng, (h, w)), 0.0)


PATTERNS: dict[str, Pattern] = {
    **{f"columns, period {p}": _stripes(p, 0, 1) for p in (2, 3, 4, 8)},
    **{f"rows, period {p}": _stripes(p, 1, 0) for p in (2, 3, 4, 8)},
    **{f"diagonals, period {p}": _stripes(p, 1, 1) for p in (2, 3, 5)},
    "falling diagonals, period 3": _stripes(3, 1, -1),
    **{f"checkers of {s}": _checkers(s) for s in (1, 2, 3, 4)},
    **{f"dither of {s}": _dither(s) for s in (2, 4, 8)},
    **{f"wave, period {p}": _wave(p, 0, 1) for p in (2.7, 5.3)},
    "slanted wave": _wave(4.1, 0.6, 0.8),
    **{f"{name}, at random": _random(draw) for name, draw in DRAWS.items()},
    **{f"{name}, each channel": _random(draw, 3) for name, draw in DRAWS.items()},
    **{f"two values in {s} x {s}": _random(_two, 1, s, s) for s in (2, 3)},
    "one in five brighter": _random(lambda rng, shape: np.where(rng.random(shape) < 0.2, 1.0, -0.25)),
    "exponential": _random(lambda rng, shape: rng.exponential(1, shape) - 1),
    "columns at random": _random(DRAWS["even"], high=0),
    "rows at random": _random(_two, wide=0),
    "the left half": _part(lambda y, x, h, w: x < w / 2),
    "the lower quarter": _part(lambda y, x, h, w: y > 0.75 * h),
    "a disc": _part(lambda y, x, h, w: np.hypot(x - w / 2, y - h / 2) < h / 3),
    "every other block of 16": _part(lambda y, x, h, w: (y // 16 + x // 16) % 2 == 0),
}

TRUTH = picture(72, 96)


def bases(rng: Rng) -> dict[str, tuple[np.ndarray, Image]]:
    """Name to a correct mean (H, W, 3) and the reference it is compared with."""
    exact = Image(TRUTH.astype(np.float32))
    noisy = render(rng, TRUTH, samples=4096)
    return {
        "a noise-free reference": (TRUTH, exact),
        "a file without noise, variance or samples": (TRUTH, untold(exact)),
        "the reference's own pixels, 0.5 % noise": (noisy.mean, noisy),
        "a render of the same quality": (render(rng, TRUTH, samples=4096).mean, noisy),
        "two files without variance, 0.5 % noise": (render(rng, TRUTH, samples=4096).mean, untold(noisy)),
    }


def wrong(rng: Rng, mean: np.ndarray, pattern: Pattern, amplitude: float) -> Image:
    """An image with a pattern of wrong pixels, that says nothing of its noise."""
    h, w = mean.shape[:2]
    p = pattern(rng, h, w)
    factor = np.maximum(1 + amplitude * (p if p.ndim == 3 else p[..., None]), 0)
    return Image((mean * factor).astype(np.float32), samples=0)


def measure_patterns(amplitudes: tuple[float, ...] = AMPLITUDES) -> tuple[dict[str, Counter], list[str]]:
    """Verdicts by base, and what passed."""
    rng = np.random.default_rng(41)
    counts: dict[str, Counter] = {}
    passed = []
    for name, (mean, reference) in bases(rng).items():
        counts[name] = Counter()
        for kind, pattern in PATTERNS.items():
            for amplitude in amplitudes:
                verdict = compare(wrong(rng, mean, pattern, amplitude), reference).verdict
                counts[name][verdict] += 1
                if verdict == "pass":
                    passed.append(f"{kind} x {amplitude:g} beside {name}")
    return counts, passed


def main() -> None:
    counts, passed = measure_patterns()
    rows = [[name, *(c[v] for v in ("pass", "undecided", "fail"))] for name, c in counts.items()]
    columns = ["compared with", "pass", "undecided", "fail"]
    record.table("verdict", "patterns", columns, rows, "python -m measure.untold_patterns")
    print("".join(f"\npassed: {what}" for what in passed))


if __name__ == "__main__":
    main()
