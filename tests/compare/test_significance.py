"""Levels, tails and degrees of freedom, against 50 digits and closed forms."""

import math

import mpmath
import numpy as np
import pytest
from scipy.special import ndtri, pdtr

from raytwin.compare.significance import as_skewed, less_skewed, quantile, sidak, two_sided, welch


@pytest.mark.parametrize("dof", [1, 3, 30.5, math.inf])
def test_student_s_tail_agrees_with_50_digits_where_it_matters(dof):
    for p in (0.5, 1e-3, 1e-6, 1e-10):
        z = float(quantile(p, dof))
        with mpmath.workdps(50):
            if math.isinf(dof):
                tail = mpmath.erfc(mpmath.mpf(z) / mpmath.sqrt(2))
            else:
                n, t = mpmath.mpf(dof), mpmath.mpf(z)
                tail = mpmath.betainc(n / 2, mpmath.mpf(1) / 2, 0, n / (n + t * t), regularized=True)
            assert float(tail) == pytest.approx(p, rel=1e-6)
        assert float(two_sided(z, dof)) == pytest.approx(p, rel=1e-6)


def test_sidak_s_levels_multiply_back_to_the_rate_and_welch_weighs_degrees_of_freedom():
    for rate, tests in ((1e-6, 1), (1e-3, 10**8), (0.5, 7)):
        assert -math.expm1(tests * math.log1p(-sidak(rate, tests))) == pytest.approx(rate, rel=1e-9)
    for parts, expected in (
        ([(1.0, 1.0), (0.0, 63.0)], 1.0),
        ([(1.0, 5.0), (1.0, 5.0)], 10.0),
        ([(2.0, math.inf), (1.0, 4.0)], 36.0),
        ([(1.0, math.inf)], math.inf),
    ):
        assert welch(parts) == pytest.approx(expected)


def test_a_skewed_deviation_is_that_of_a_poisson_number_and_begins_as_johnson_s():
    """`events` seen where `expected` are usual: z of the normal deviation whose tail is P(N <= events), within 0.35."""
    for events, expected in ((1, 16), (4, 25), (30, 62), (100, 150)):
        z, g = (expected - events) / np.sqrt(events), 1 / np.sqrt(events)
        assert abs(float(less_skewed(np.array([z]), g)[0]) + ndtri(pdtr(events, expected))) < 0.35
    z = np.array([0.0, 0.5, 3.0, 30.0])
    assert list(less_skewed(z, 0.0)) == list(z)
    assert less_skewed(np.array([0.5]), 0.1)[0] == pytest.approx(0.5 - 0.1 * 0.25 / 3, rel=1e-3)
    assert (np.diff(less_skewed(np.linspace(0, 50, 100), 0.7)) > 0).all()
    assert as_skewed(less_skewed(z, 0.1), np.full(4, 0.1)) == pytest.approx(z, rel=0.02)
