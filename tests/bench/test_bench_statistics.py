"""The bench's statistics, on numbers whose answers are known."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytwin.bench import RENDERERS, fit_power, on_frontier, staircase
from raytwin.bench.frontier import median_iqr
from raytwin.bench.timing import Measured, guess, repeat

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


def test_a_power_law_is_fitted_exactly_where_its_fixed_cost_has_died_out():
    x = np.array([1.0, 2, 4, 8, 16, 32])
    fit = fit_power(x, 3e-3 * x**1.25)
    assert fit.exponent == pytest.approx(1.25)
    assert fit.factor == pytest.approx(3e-3)
    assert fit.sigma == pytest.approx(0, abs=1e-9)
    assert fit.used == pytest.approx((8, 16, 32))
    with_fixed_cost = fit_power(np.array([1, 10, 100, 1e3, 1e4, 1e5]), 1 + np.array([1, 10, 100, 1e3, 1e4, 1e5]))
    assert with_fixed_cost.exponent == pytest.approx(1, abs=0.01)


def test_the_error_of_an_exponent_covers_the_truth():
    rng, x = np.random.default_rng(3), np.logspace(0, 4, 12)
    z = [
        (fit.exponent - 0.8) / fit.sigma
        for fit in (fit_power(x, x**0.8 * np.exp(rng.normal(0, 0.1, len(x)))) for _ in range(200))
    ]
    assert 0.8 < np.median(np.abs(z)) / 0.718 < 1.25  # Student's t with 4 degrees: half lie within 0.741


def test_the_median_and_the_distance_of_the_quartiles():
    assert median_iqr([5, 1, 3, 2, 4]) == (3, 2)


# ------------------------------------------------------------------------------------------ interleaving


class Clock:
    """Seconds that pass only when a call takes them."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def fakes(clock: Clock, costs: dict[str, float]) -> tuple[list[Measured], list[str]]:
    ran: list[str] = []

    def make(name: str, cost: float) -> Measured:
        def call(seed: int) -> np.ndarray:
            ran.append(name)
            clock.now += cost
            return np.zeros((1, 1, 3), np.float32)

        return Measured(RENDERERS["fill"], call, cost, errors=[{}])

    return [make(name, cost) for name, cost in costs.items()], ran


def test_every_round_runs_each_method_once_in_an_order_of_its_own():
    clock = Clock()
    measured, ran = fakes(clock, dict.fromkeys("abcdef", 0.1))
    repeat(measured, lambda m, i: {}, 1000.0, 9, clock)
    rounds = ["".join(ran[i : i + 6]) for i in range(0, len(ran), 6)]
    assert len(rounds) == 9
    assert all(sorted(r) == list("abcdef") for r in rounds)
    assert len(set(rounds)) > 5


def test_no_call_begins_that_would_end_past_the_deadline():
    clock = Clock()
    measured, _ = fakes(clock, {"quick": 0.01, "slow": 30.0})
    repeat(measured, lambda m, i: {}, 100.0, 50, clock)
    assert clock.now <= 100
    quick, slow = measured
    assert len(quick.seconds) == 50
    assert len(slow.seconds) == 3


def test_what_only_the_first_call_cost_is_kept_apart():
    clock = Clock()
    measured, _ = fakes(clock, {"compiled": 0.5})
    measured[0].compile_seconds = 4.5  # what the first call took
    repeat(measured, lambda m, i: {}, 100.0, 5, clock)
    assert measured[0].compile_seconds == pytest.approx(4.0)


def test_a_guess_lies_on_the_line_through_two_sizes():
    assert guess((100, 1.0), (200, 1.5), 1000) == pytest.approx(5.5)
    assert guess((100, 1.0), (200, 0.9), 1000) == pytest.approx(0.9)  # noise makes no speed
