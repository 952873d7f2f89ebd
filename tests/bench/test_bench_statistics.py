"""The bench's statistics, on numbers whose answers are known."""

import itertools

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytwin.bench import (
    RENDERERS,
    Bench,
    Converged,
    Measurement,
    Repeats,
    against,
    fit_power,
    on_frontier,
    ratio_interval,
    staircase,
)
from raytwin.bench.equal_error import equal_error, passed
from raytwin.bench.frontier import median_iqr
from raytwin.bench.timing import Measured, guess, repeat
from raytwin.errors import InputError

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


def test_the_interval_of_a_ratio_covers_the_true_ratio():
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(100):
        new, old = 1.3 * rng.lognormal(0, 0.1, 15), rng.lognormal(0, 0.1, 15)
        _, low, high = ratio_interval(new, old, confidence=0.95, draws=800)
        inside += low <= 1.3 <= high
        assert high - low < 1
    assert inside >= 88
    assert ratio_interval([1, 2], [1, 2]) == (1.0, 0.0, float("inf"))  # two repeats tell none
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


# ------------------------------------------------------------------------------------------ two runs


def run(seconds: dict[str, tuple], rmse: dict[str, tuple], machine: str = "m") -> Bench:
    rows = tuple(
        Measurement(name, "numpy", "float32", "shadow", None, 1, 1, 4, 3, float(np.median(s)), 0.0, 0.0, None,
            rmse[name][0], 0.0, 0.0, None, 1e-3, True)
        for name, s in seconds.items()
    )  # fmt: skip
    repeats = tuple(Repeats(name, 4, 3, tuple(s), tuple(rmse[name])) for name, s in seconds.items())
    return Bench("scene", {"processor": machine}, {"numpy": "2"}, 10.0, 5.0, rows, repeats=repeats)


def draws(middle: float, seed: int) -> tuple:
    return tuple(middle * np.random.default_rng(seed).lognormal(0, 0.02, 15))


STEADY = {name: draws(1.0, i) for i, name in enumerate("abcde")}
EXACT = dict.fromkeys("abcde", (0.1,))


def test_the_slower_the_faster_and_the_less_accurate_are_named():
    changed = STEADY | {"b": draws(1.3, 11), "c": draws(0.7, 12)}
    errors = EXACT | {"d": (0.11,), "e": (0.05,)}
    found = {c.method: c for c in against(run(changed, errors), run(STEADY, EXACT)).changes}
    assert {m: c.verdict for m, c in found.items()} == {
        "a": "", "b": "slower", "c": "faster", "d": "less accurate", "e": "more accurate",
    }  # fmt: skip
    assert found["b"].seconds[1] < 1.3 < found["b"].seconds[2]


def test_a_machine_that_is_slower_as_a_whole_is_told_from_a_method():
    slow = {name: draws(1.5, 20 + i) for i, name in enumerate("abcde")}
    found = against(run(slow, EXACT), run(STEADY, EXACT))
    assert found.drift == pytest.approx(1.5, abs=0.05)
    assert {c.verdict for c in found.changes} == {"slower, as all are"}


def test_errors_under_the_truths_floor_are_the_same_and_another_machine_is_a_doubt():
    low, high = (run(STEADY, dict.fromkeys("abcde", (rmse,)), name) for rmse, name in ((1e-7, "m"), (9e-4, "m2")))
    found = against(high, low)
    assert {c.verdict for c in found.changes} == {""}
    assert found.drift == 1
    assert "processor" in found.doubts[0]
    with pytest.raises(InputError, match="none in common"):
        against(run({"a": (1.0,)}, EXACT), run({"b": (1.0,)}, EXACT))


def test_references_of_other_sample_counts_are_a_doubt():
    def beside(*truths: Converged) -> Bench:
        return msgspec.structs.replace(run(STEADY, EXACT), truths=truths)

    before = Converged("shadow-area", 4, 3, 4096, 1.0, {}), Converged("path-area", 4, 3, 64, 1.0, {})
    now = msgspec.structs.replace(before[0], samples=1024), before[1], Converged("sky-area", 4, 3, 16, 1.0, {})
    (doubt,) = against(beside(*now), beside(*before)).doubts
    assert "shadow-area, 4 x 3: 1024 samples per pixel, before 4096" in doubt
    assert not against(beside(*before), beside(*before)).doubts


def test_seconds_to_an_error_lie_on_monte_carlos_line_between_two_counts():
    """Error 1/n, 10 ms and n ms: 1e-3 is passed at n = 1000, which 256 and 1024 tell on a line in logarithms."""
    points = [(0.001 * n, 1 / n, n) for n in (1024, 64, 256)]
    assert passed(points) == pytest.approx((1.0, 1000.0, True))
    assert passed(points, 0.1) == (0.064, 64.0, True)  # fewer were not tried
    assert passed(points, 2e-4) == pytest.approx((5.0, 5000.0, False))
    assert passed(points, 1e-4) is None  # too far
    plateau = [(0.001 * n, 1 / n + 0.01, n) for n in (64, 256, 1024)]
    assert passed(plateau) is None


def test_each_family_is_held_against_the_truth_of_its_own_rung_whose_noise_is_not_its_own():
    def row(name: str, seconds: float, relmse: float) -> Measurement:
        m = RENDERERS[name]
        about = name, m.library, "float32", m.rung, m.trim, 1, m.samples, 8, 6
        return Measurement(*about, seconds, 0, 0, None, 0, relmse, 0, None, 0, False)

    rows = [
        row(f"{start}{n}", n * cost, 0.1 / n + 1e-4)
        for start, cost in (("drjit32-path-", 1e-3), ("mitsuba-llvm-path-", 2e-3), ("drjit32-sky-", 5e-4))
        for n in (16, 64, 256)
    ]
    truths = [Converged(name, 8, 6, 64, 1.0, {"relmse": 1e-4}) for name in ("path-area", "sky-area")]
    found = equal_error(rows, truths)
    assert [(e.family, e.truth) for e in found] == [
        ("drjit32 path", "path-area"), ("Mitsuba llvm path", "path-area"), ("drjit32 sky", "sky-area"),
    ]  # fmt: skip
    assert [e.seconds for e in found] == pytest.approx([0.1, 0.2, 0.05])
    assert [e.samples for e in found] == pytest.approx([100] * 3)
