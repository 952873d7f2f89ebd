"""A pixel's samples in batches, whose means' scatter gives the variance of the mean, whatever is sampled."""

from typing import NamedTuple

import numpy as np


class Batches(NamedTuple):
    """`samples` of a pixel in `number` batches; where they do not share evenly, the first `more` have one more.

    With batches of k samples (sizes), their means m and the mean of all samples M, the *spread* is Σ k (m - M)². Its
    expectation is (number - 1) times the variance of one sample, also where sizes differ.
    """

    number: int
    samples: int

    @property
    def each(self) -> int:
        """Samples of the larger batches."""
        return -(-self.samples // self.number)

    @property
    def more(self) -> int:
        """How many batches are of the larger kind."""
        return self.samples - self.number * (self.each - 1)

    @property
    def lanes(self) -> int:
        """Rays of a pixel in one launch, all batches as large as the largest."""
        return self.number * self.each

    def gathered(self, colour: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and spread (n, 3) of lanes (n · lanes, 3) that lie as pixels, batches, samples."""
        parts = colour.reshape(-1, self.number, self.each, 3)
        sizes = self.each - (np.arange(self.number) >= self.more)[:, None]
        sums = parts.sum(axis=2) - np.where(sizes < self.each, parts[:, :, -1], 0)
        mean = sums.sum(axis=1) / self.samples
        return mean, (sizes * np.square(sums / sizes - mean[:, None])).sum(axis=1)

    def variance(self, spread: np.ndarray) -> np.ndarray | None:
        """Return the variance of the mean of all samples; None for a single batch, which has none."""
        return spread / ((self.number - 1) * self.samples) if self.number > 1 else None
