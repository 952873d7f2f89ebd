"""An image of two or three batches against a well-known reference: its variance is hardly known; that must count."""

import numpy as np
import pytest

from raytwin.compare import compare
from raytwin.image import Image


@pytest.mark.parametrize("batches", [2, 3])
def test_few_batches_raise_no_false_alarm(batches):
    """60 correct images at a stated 1e-3: more than one failure has a probability of 0.2 %. Adding ν gave 9 of 150."""
    rng = np.random.default_rng(batches)
    shape = (60, 80, 3)
    truth = rng.uniform(0.1, 1, shape)
    failures = 0
    for _ in range(60):
        runs = truth * rng.exponential(1, (batches, *shape))
        variance = runs.var(axis=0, ddof=1) / batches
        test = Image(runs.mean(axis=0).astype(np.float32), variance.astype(np.float32), batches, batches=batches)
        mean = truth * rng.gamma(4096, 1 / 4096, shape)
        spread = rng.chisquare(63, shape) / 63 * truth**2 / 4096
        reference = Image(mean.astype(np.float32), spread.astype(np.float32), 4096, batches=64)
        failures += compare(test, reference).verdict == "fail"
    assert failures <= 1
