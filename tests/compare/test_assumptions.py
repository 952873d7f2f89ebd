"""What mean and variance per pixel cannot show, and where the user reads it."""

import numpy as np
import pytest
from measure.noise_models import KINDS, picture

from raytwin.compare import compare
from raytwin.compare.decision import Worst
from raytwin.compare.messages import shared_share
from raytwin.compare.significance import quantile


def test_rare_events_are_undecided_beside_the_truth_unless_hardly_one_was_met():
    """60 renders with 4.9 events each: one in 23 meets at most one. A failure must be of these."""
    make, truth, fails = KINDS["rare events against the exact image"], picture(48, 64), 0
    rng = np.random.default_rng(41)
    for _ in range(60):
        test, reference = make(rng, truth, 1.0)
        found = compare(test, reference)
        if found.verdict == "fail":
            fails += 1
            assert (test.mean > 10 * truth).any(axis=-1).sum() <= 1
        else:
            assert found.verdict == "undecided"
    assert fails <= 4  # 2 % of such renders fail; more than 4 of 60 would once in 100 times


@pytest.mark.parametrize("share", [0.001, 0.01])
def test_the_shared_variance_is_that_of_a_common_error(share):
    """An error of q standard deviations of what is shared, where n pixels without it know the mean to sd / sqrt(n)."""
    q, pixels = float(quantile(1e-4, np.inf)), 48 * 64
    z = q * np.sqrt(share) * np.sqrt(pixels)
    assert shared_share(Worst(z, 0.0, 0, 0, 64, 48), 1e-4) == pytest.approx(share)
