"""Pixels that show the mean of several rays."""

import numpy as np
import pytest

from raytwin.explain.catalogue import AVERAGED


def test_rays_that_are_spread_over_a_pixel_lie_evenly_about_its_centre_and_others_beyond_its_corner():
    over, corner = AVERAGED
    for way in over.ways:
        places = np.array(way[0][1])
        assert places.mean(axis=0) == pytest.approx((0, 0), abs=1e-12)
        assert 0 < np.abs(places).max() <= 1
    for way in corner.ways:
        places = np.array(way[0][1])
        assert min(places.mean(axis=0)) > 0.2
        assert 0 <= places.min() < places.max() <= 1
