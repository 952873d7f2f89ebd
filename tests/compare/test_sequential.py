"""Verdicts that stop when they are certain: the rate over all looks, what a pass excludes, and when more is wanted."""

import math

import numpy as np
import pytest
from measure.noise_models import render
from measure.sequences import NOISES, SMALL, faulty, pooled, sequence

import raytwin
from raytwin.compare import SequentialComparison, compare
from raytwin.compare.decision import Unseen, _excluded, _Tested
from raytwin.compare.sequential import PER_OCTAVE, first_samples, look_level, look_number
from raytwin.errors import InputError
from raytwin.images.image import Image

NOISE = NOISES["Gaussian"][0]


def test_the_levels_of_all_looks_sum_to_the_rate():
    assert sum(look_level(1e-3, number) for number in range(4000)) == pytest.approx(1e-3, rel=2e-3)
    assert sum(look_level(1e-3, number) for number in range(4000)) < 1e-3


def test_no_two_looks_share_a_level_and_they_are_a_fourth_of_an_octave_apart():
    n = 4
    while n < 1e7:
        later = first_samples(look_number(n) + 1)
        assert look_number(later) > look_number(n)
        assert look_number(later - 1) <= look_number(n)
        assert later <= max(n + 1, math.ceil(n * 2**0.5))
        n = later
    assert [look_number(n) for n in (1, 4, 8, 16, 1024)] == [0, 0, 4, 8, 32]


@pytest.mark.parametrize("size", [1, 3, 7])
def test_the_levels_that_a_run_uses_are_four_in_an_octave_at_most_and_sum_to_less_than_the_rate(size):
    rng, used = np.random.default_rng(6), []

    def judge(*images, judging, **options):
        used.append(judging.false_alarm_rate)
        return compare(*images, judging, **options)

    check = SequentialComparison(detectable_bias=1e-9, judge=judge)
    for _ in range(100 // size):
        check.add(pooled(NOISE(rng, SMALL, size)), pooled(NOISE(rng, SMALL, size)))
    check.conclude()
    assert len(used) == check.looks > 3
    assert all(used.count(level) <= PER_OCTAVE for level in used)
    assert used == sorted(used, reverse=True)
    assert sum(used) < 1e-3


@pytest.mark.nightly
@pytest.mark.parametrize("stored", [True, False], ids=["stored reference", "both in rounds"])
def test_all_looks_together_fail_no_more_correct_pairs_than_stated(stored):
    """At a rate of 5 %, 8 or more of 40 fail with a probability of 0.07 %. Measured: see measure.sequences."""
    rng = np.random.default_rng([7, stored])
    reference = render(rng, SMALL, samples=1024, kind="exp", sd=1.0)
    noise, failed = NOISES["exponential"][0], 0
    for _ in range(40):
        other = reference if stored else noise(rng, SMALL, 32)
        check = sequence(noise(rng, SMALL, 32), other, false_alarm_rate=0.05, detectable_bias=1e-9)
        assert check.looks >= 4
        failed += check.conclude().verdict == "fail"
    assert failed < 8


def test_samples_that_agree_because_they_missed_rare_shade_fail_no_correct_pair():
    """Two of 30 sequences fail once in 2000 runs at 1e-3. If nothing is granted for what was missed, 27 do."""
    rng, failed = np.random.default_rng(14), 0
    noise, truth = NOISES["one sample in 200 shaded"]
    for _ in range(30):
        check = sequence(noise(rng, truth, 32), Image(truth), detectable_bias=1e-9)
        failed += check.conclude().verdict == "fail"
    assert failed < 2


def test_what_agreeing_samples_missed_is_granted_once_for_all_looks():
    """A look's own level asks for more standard deviations of noise, and for no more missed events."""
    looks = [Unseen(0.25, level / 1e-3).events(level) for level in (1e-3, 1e-4, 1e-6)]
    assert looks == pytest.approx([-math.log(1e-3)] * 3)


def test_the_excluded_bias_is_the_largest_that_any_number_of_missed_events_hides():
    rng = np.random.default_rng(15)
    e, sd, event, always = rng.uniform(0, 2, (4, 50, 3))
    event[:5], sd[5:10] = 0, 0
    tested = _Tested(e, sd, np.full(e.shape, np.inf), always, e, e, always, event, 0 * e)
    events = np.linspace(0, math.log(10), 4001)[:, None, None]
    biases = always + event * events + e + np.sqrt(np.square(e) + 2 * np.square(sd) * (math.log(10) - events))
    np.testing.assert_allclose(_excluded(tested), biases.max(axis=0), rtol=1e-5)


def test_a_gross_fault_fails_after_four_samples_and_a_smaller_one_later():
    rng = np.random.default_rng(8)
    at = []
    for size in (0.3, 0.02, 0.008):
        check = sequence(NOISE(rng, faulty(SMALL, size, local=False), 512), NOISE(rng, SMALL, 512))
        assert check.comparison.verdict == "fail"
        assert check.comparison.statistics.samples_to_certainty == check.samples
        assert check.comparison.statistics.looks == check.looks
        at.append(check.samples)
    assert at[0] == 4 < at[1] < at[2]
    assert "certain after" in check.comparison.reasons[-1]


def test_an_image_that_is_off_by_what_a_pass_excludes_passes_once_in_ten_at_most():
    """Of 40 such images 10 pass with a probability of 0.5 % if one in ten does; correct ones all pass, and sooner."""
    rng, bias, passed = np.random.default_rng(9), 0.05, 0
    asked = {"detectable_bias": bias, "detectable_tile_bias": 9.0}
    for _ in range(40):
        check = sequence(NOISE(rng, SMALL * (1 + bias), 128), NOISE(rng, SMALL, 128), **asked)
        passed += check.conclude().verdict == "pass"
    assert passed < 10
    check = sequence(NOISE(rng, SMALL, 128), NOISE(rng, SMALL, 128), **asked)
    assert check.comparison.verdict == "pass"
    assert check.samples < 64
    assert "would have caught" in check.comparison.reasons[0]
    assert "false-alarm rate 0.001" in check.comparison.reasons[0]


def test_a_budget_that_ends_early_is_undecided_and_says_what_it_takes_and_that_is_enough():
    rng = np.random.default_rng(10)
    asked = {"detectable_bias": 0.01, "detectable_tile_bias": 0.5}
    test, reference = NOISE(rng, SMALL, 512), NOISE(rng, SMALL, 512)
    check = sequence(test[:8], reference[:8], **asked)
    assert check.add() is None
    made = check.conclude("8 samples")
    assert made.verdict == "undecided"
    assert made.statistics.samples_to_certainty is None
    assert "asked 1 %" in made.reasons[0]
    wanted = int(made.reasons[0].split("about ")[1].split()[0])
    few = sequence(test[:6], reference[:6]).conclude()
    assert few.reasons == ("undecided: 6 samples per pixel can fail, but a pass takes at least 8",)
    done = sequence(test[:wanted], reference[:wanted], **asked).conclude()
    assert done.verdict == "pass"
    assert "undecided" not in done.reasons[0]


def test_without_a_wish_a_budget_that_ends_early_passes_where_a_tenth_would_have_shown():
    rng = np.random.default_rng(11)
    check = sequence(NOISE(rng, SMALL, 8), NOISE(rng, SMALL, 8))
    assert not check.decided
    made = check.conclude()
    assert made.verdict == "pass"
    assert made.reasons[-1] == "all 8 samples per pixel were taken"


def test_renders_are_arrays_too_and_equal_ones_pass_where_they_agree_and_are_undecided_else():
    truth = SMALL.astype(np.float32)
    check = SequentialComparison(Image(truth))
    assert check.add(truth) is None
    assert check.add(truth).verdict == "pass"
    check = SequentialComparison(Image(truth))
    assert [check.add(truth * np.float32(1.001)) for _ in range(7)] == [None] * 7
    assert check.add(truth * np.float32(1.001)).verdict == "undecided"
    assert "seeds 0, 1, 2, 3, 4, 5, 6 and 7 gave the same image" in check.comparison.reasons[0]


def test_equal_renders_that_state_no_noise_are_decided_at_once():
    truth = SMALL.astype(np.float32)
    for gain, verdict in ((1, "pass"), (1.001, "fail")):
        check = SequentialComparison(Image(truth))
        assert check.add(Image(truth * np.float32(gain))) is None
        assert check.add(Image(truth * np.float32(gain))).verdict == verdict
        assert "free of noise" in check.comparison.reasons[-1]


def test_what_is_no_render_fails_at_the_first_look_or_is_named():
    rng = np.random.default_rng(12)
    check = SequentialComparison(render(rng, SMALL, samples=64))
    broken = NOISE(rng, SMALL, 4).astype(np.float32)
    broken[2, 5, 6] = np.nan
    for one in broken[:3]:
        assert check.add(one) is None
    assert "3 NaN values in 1 pixel" in check.add(broken[3]).reasons[0]
    with pytest.raises(InputError, match=r"test render 5: expected the shape \(24, 32, 3\), got \(5, 6, 3\)"):
        check.add(np.zeros((5, 6, 3)))
    with pytest.raises(InputError, match=r"renders: expected at least one, got none"):
        SequentialComparison(check.image("reference")).conclude()
    for options in ({"false_alarm_rate": 0}, {"detectable_bias": 0.0}, {"detectable_tile_bias": -1}):
        with pytest.raises(InputError, match=next(iter(options))):
            SequentialComparison(check.image("reference"), **options)


def seeded(truth, seed_of):
    """A correct renderer of 1 sample per pixel, whose random numbers are those of `seed_of(seed)`."""

    def one(seed):
        return truth * np.random.default_rng([17, seed_of(seed)]).exponential(1, truth.shape)

    return one


@pytest.mark.parametrize("seed_of", [lambda seed: max(seed, 1), lambda seed: seed // 2], ids=["0 and 1", "each twice"])
def test_a_renderer_whose_first_seeds_give_the_same_image_is_judged_by_the_others(seed_of):
    one, check = seeded(SMALL, seed_of), SequentialComparison(Image(SMALL.astype(np.float32)))
    for seed in range(2000):
        if check.add(one(seed)):
            break
    made = check.conclude()
    assert made.verdict == "pass"
    assert "seeds 0" in made.reasons[-1]
    assert check.samples == len({seed_of(s) for s in range(seed + 1)})


@pytest.mark.parametrize("seeds", [1, 2, 3])
def test_a_renderer_that_ignores_its_seed_is_undecided_and_told(seeds):
    one, check = seeded(SMALL, lambda seed: seed % seeds), SequentialComparison(Image(SMALL.astype(np.float32)))
    made = next(made for seed in range(100) if (made := check.add(one(seed))))
    assert (made.verdict, made.exit_code) == ("undecided", 2)
    assert made.reasons[0].startswith("undecided: seeds 0, ")
    assert "does your program use {seed}?" in made.reasons[0]


def test_equal_renders_with_invalid_values_fail():
    broken, check = SMALL.astype(np.float32), SequentialComparison(Image(SMALL.astype(np.float32)))
    broken[3, 4] = np.nan
    made = next(made for _ in range(100) if (made := check.add(broken)))
    assert made.verdict == "fail"


def test_renders_that_are_equal_since_events_are_rare_all_count():
    """Half of the renders have no event: to leave them out would double the mean."""
    rng, check = np.random.default_rng(13), SequentialComparison(Image(SMALL.astype(np.float32)))
    renders = [SMALL + np.where(rng.random(SMALL.shape) < 1 / SMALL.size, 3.0, 0.0) for _ in range(40)]
    for one in renders:
        check.add(one)
    assert len({one.tobytes() for one in renders}) < 40
    assert check.samples == 40
    np.testing.assert_allclose(check.image("test").mean, np.mean(renders, axis=0), rtol=1e-6)


def test_renders_that_repeat_or_are_means_of_one_that_grows_are_named_before_any_verdict():
    rng = np.random.default_rng(14)
    renders = [rng.exponential(SMALL).astype(np.float32) for _ in range(8)]
    means = [np.mean(renders[: k + 1], axis=0, dtype=np.float32) for k in range(8)]
    assert raytwin.compare(renders, SMALL.astype(np.float32)).verdict != "fail"
    with pytest.raises(InputError, match="one growing render"):
        raytwin.compare(means, SMALL.astype(np.float32))
    with pytest.raises(InputError, match=r"renders 1 and 8 .* are equal"):
        raytwin.compare([*renders, renders[1]], SMALL.astype(np.float32))
