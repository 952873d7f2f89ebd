"""Independent renders of one picture, pooled as they come: their mean, and that mean's variance and third moment."""

from dataclasses import dataclass, field, replace
from hashlib import blake2b

import numpy as np

from raytwin.images.image import Image

VALUES_BEYOND_CHANCE = 64
"""Renders that differ in so many values n are equal by chance with exp(-n / 2) at most."""


@dataclass(eq=False)
class ImagePool:
    """The mean of all images added, weighted by samples. An image of unknown samples counts as one.

    An image of `batches` brings its own scatter, any other counts as one batch. With n samples and mean m of each, its
    variance of the mean v from b batches, N = Σ n, M = Σ n m / N and S = Σ (b - 1) n v + Σ n (m - M)²

        variance of M = S / ((Σ b - 1) N)

    an unbiased estimate whatever the sizes (Chan, Golub and LeVeque 1983). Of b single batches with C = Σ n² (m - M)³

        third central moment of M = C b / ((b - 1) (b - 2) N²)

    unbiased where sizes are equal. Each sum is one array.

    A noisy render with the same pixels as an earlier one is a repeat, and left out: `repeats` holds pairs, earlier and
    later, counted from 0. Where renders differ in fewer than VALUES_BEYOND_CHANCE values, equal ones are expected and
    all count. While all renders are equal, neither is known: only the first counts, until one differs.
    """

    weight: int = 0
    batches: int = 0
    images: int = 0
    samples: int = 0
    first: Image | None = None
    repeats: list[tuple[int, int]] = field(default_factory=list)
    repeats_in_a_row: int = 0
    _given: dict[bytes, int] = field(default_factory=dict)
    _last: Image | None = None
    _differing: int = 0
    _mean: np.ndarray | None = None
    _scatter: np.ndarray | None = None
    _cubes: "Cubes" = field(default_factory=lambda: Cubes())
    _alpha: np.ndarray | None = None

    def add(self, image: Image) -> None:
        """Add a render, unless it repeats an earlier one."""
        if _has_noise(image):
            number = self.images + len(self.repeats)
            earlier = self._given.setdefault(_digest(image), number)
            if earlier < number:
                if self.images == 1 or self._differing >= VALUES_BEYOND_CHANCE * (self.images - 1):
                    self.repeats.append((earlier, number))
                    self.repeats_in_a_row += 1
                    return
            elif self._last is not None:
                differing = int(np.count_nonzero(np.asarray(image.mean) != self._last.mean))
                self._differing += differing
                if differing < VALUES_BEYOND_CHANCE:
                    for _ in self.repeats:
                        self._add(self._last)
                    self.repeats.clear()
            self._last = image
        self.repeats_in_a_row = 0
        self._add(image)

    def _add(self, image: Image) -> None:
        n, b = max(image.samples, 1), 1
        mean = np.asarray(image.mean, np.float64)
        if self._mean is None:
            self._mean, self._scatter, self.first = np.zeros(mean.shape), np.zeros(mean.shape), image
        assert self._scatter is not None
        self.weight += n
        if image.alpha is None or (self._alpha is None and self.images):
            self._alpha = None
        else:
            before = 0.0 if self._alpha is None else self._alpha
            self._alpha = before + (image.alpha - before) * (n / self.weight)
        with np.errstate(invalid="ignore", over="ignore"):  # NaN and infinity stay, and the comparison finds them
            step, lost = mean - self._mean, None
            if not np.isfinite(step.sum()):
                lost = ~np.isfinite(step)
                self._mean[lost] += mean[lost]  # infinity stays: inf - inf would be NaN
                step[lost] = 0
            self._mean += step * (n / self.weight)
            self._scatter += n * step * (mean - self._mean)
            if lost is not None:
                self._scatter[lost] = 0
            if image.variance is not None:
                b = image.batches or image.samples or 1
                self._scatter += (b - 1) * n * np.asarray(image.variance, np.float64)
            self._cubes.add(mean, n, b, image.third)
        known = self.samples > 0 or self.images == 0
        self.samples = self.samples + image.samples if image.samples and known else 0
        self.batches, self.images = self.batches + b, self.images + 1

    @property
    def shape(self) -> tuple[int, ...]:
        """The images' shape; () before the first one."""
        return () if self._mean is None else self._mean.shape

    @property
    def noise_free(self) -> bool:
        """All renders are equal and say that they have no noise, and there are two at least."""
        return self.images > 1 and self._scatter is not None and not self._scatter.any()

    @property
    def image(self) -> Image:
        """All of it as one image, with the first one's surface and format."""
        assert self._mean is not None
        assert self._scatter is not None
        assert self.first is not None
        variance, batches = None, 1
        if self.batches > 1:
            variance = (self._scatter / ((self.batches - 1) * self.weight)).astype(np.float32)
            batches = self.batches
        return replace(
            self.first, mean=self._mean.astype(np.float32), variance=variance, samples=self.samples, batches=batches,
            alpha=self._alpha, third=self._cubes.third(self.weight),
        )  # fmt: skip


@dataclass(eq=False)
class Cubes:
    """The third central moment of one sample: of images that bring theirs, and between those of one batch each.

    `own`: weighted by batches² / samples, the inverse of its variance. `powers`: Σ n² (m - first)^k, k = 1 to 3.
    """

    weight: float = 0.0
    own: np.ndarray | float = 0.0
    first: np.ndarray | None = None
    powers: list[np.ndarray] = field(default_factory=list)
    squares: int = 0
    samples: int = 0
    images: int = 0

    def add(self, mean: np.ndarray, samples: int, batches: int, third: np.ndarray | None) -> None:
        if third is not None:
            weight = batches * batches / samples
            self.own = self.own + weight * samples**2 * np.asarray(third, np.float64)
            self.weight += weight
            return
        if batches > 1:  # nothing is known of its batches
            return
        if self.first is None:
            self.first, self.powers = mean, [np.zeros(mean.shape) for _ in range(3)]
        step = mean - self.first
        term = samples**2 * step
        for power in self.powers:
            power += term
            term = term * step
        self.squares, self.samples, self.images = self.squares + samples**2, self.samples + samples, self.images + 1

    def third(self, samples: int) -> np.ndarray | None:
        """The third central moment of the mean of so many samples; None where too few batches tell it."""
        total, weight, b = self.own, self.weight, self.images
        if b >= 3:
            first, second, cubes = self.powers
            # About the mean of these images, which is n²-weighted only where sizes differ.
            d = first / self.squares
            between = cubes - 3 * d * second + 3 * d * d * first - d**3 * self.squares
            own = b * b / self.samples
            total, weight = total + own * between * b / ((b - 1) * (b - 2)), weight + own
        if not weight:
            return None
        return np.asarray(total / weight / samples**2).astype(np.float32)


def _has_noise(image: Image) -> bool:
    """Whether it may have noise: it states some, or does not state that one sample was enough."""
    if image.variance is not None:
        return bool(image.variance.any())
    return image.samples != 1 or image.batches == 1


def _digest(image: Image) -> bytes:
    return blake2b(np.ascontiguousarray(image.mean).data).digest()
