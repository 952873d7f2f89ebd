"""Faults that are tried where a clue speaks for them."""

import numpy as np
import pytest

from raytwin.diagnose.conditional_faults import averaged
from raytwin.diagnose.predict import applied


def test_rays_that_are_spread_over_a_pixel_lie_evenly_about_its_centre_and_others_beyond_its_corner():
    over, corner = averaged()
    for way in over.ways:
        assert np.mean(applied(way, "spread", None), axis=0) == pytest.approx((0, 0), abs=1e-12)
    for way in corner.ways:
        assert min(np.mean(applied(way, "spread", None), axis=0)) > 0.2
