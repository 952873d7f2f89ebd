"""Nothing is blamed for the difference between a correct tracer and the twin, nor for a few odd values in it.

`python -m measure.right_tracers` explains some 800 pairs; here every scene has one.
"""

import pytest
from measure.correct_pairs import SHIPPED
from measure.right_tracers import SPOILT, named, one_each

from raytwin import twin

pytestmark = pytest.mark.nightly


@pytest.mark.parametrize("i", range(len(SHIPPED)), ids=SHIPPED)
def test_no_cause_is_named_of_a_right_tracer_however_many_values_are_odd(i):
    twin.activate()
    case = list(one_each(SHIPPED))[i]
    assert not list(named(case, SPOILT[i % 3 :][:1])), case
