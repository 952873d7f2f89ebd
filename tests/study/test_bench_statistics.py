"""The bench's statistics, on numbers whose answers are known."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from raytwin.study.bench import on_frontier, staircase

SECONDS = (1.0, 2.0, 4.0, 8.0, 8.2, 16.0)
ERRORS = (1e-1, 1e-2, 5e-2, 1e-3, 0.99e-3, 1e-2)


def test_the_frontier_of_known_points():
    """The third is slower and worse than the second, the last than the fourth; the fifth ties with the fourth."""
    assert on_frontier(SECONDS, ERRORS) == [True, True, False, True, True, False]
    assert staircase(SECONDS, ERRORS) == [0, 1, 3, 4]


def test_errors_below_the_floor_buy_no_place_on_the_frontier():
    assert on_frontier((1.0, 2.0), (1e-3, 1e-9)) == [True, True]
    assert on_frontier((1.0, 2.0), (1e-3, 1e-9), floor=1e-3) == [True, False]
    assert staircase((1.0, 2.0), (1e-3, 1e-9), floor=1e-3) == [0]
    assert on_frontier((1.0, 2.0), (float("nan"), 1.0)) == [False, True]


@given(st.lists(st.tuples(st.floats(1e-6, 1e3), st.floats(1e-9, 1e3)), min_size=1, max_size=12))
def test_the_staircase_falls_and_something_is_always_on_the_frontier(points):
    seconds, errors = zip(*points, strict=True)
    steps = staircase(seconds, errors)
    assert all(seconds[a] <= seconds[b] and errors[a] > errors[b] for a, b in itertools.pairwise(steps))
    assert seconds[steps[0]] == min(seconds)
    assert errors[steps[-1]] == min(errors)
    assert any(on_frontier(seconds, errors))
