"""Verdicts that stop when they are certain: the rate over all looks, what a pass excludes, and when more is wanted."""

import math

import numpy as np
import pytest
from measure.kinds import SMALL, gaussian
from measure.noise_models import render
from measure.sequences import sequence

import raytwin
from raytwin.compare import SequentialComparison, compare
from raytwin.compare.sequential import PER_OCTAVE, first_samples, look_level, look_number
from raytwin.errors import InputError
from raytwin.images.image import Image

NOISE = gaussian(0.3)
TRUTH = Image(SMALL)


def test_no_two_looks_share_a_level_and_all_levels_sum_to_the_rate():
    """Four looks an octave; those that a run uses sum to less, whatever its renders' samples."""
    total = sum(look_level(1e-3, number) for number in range(4000))
    assert 0.998e-3 < total < 1e-3
    n = 4
    while n < 1e7:
        later = first_samples(look_number(n) + 1)
        assert look_number(later - 1) <= look_number(n) < look_number(later)
        assert later <= max(n + 1, math.ceil(n * 2**0.5))
        n = later
    assert [look_number(n) for n in (1, 4, 8, 16, 1024)] == [0, 0, 4, 8, 32]
    rng, used = np.random.default_rng(6), []

    def judge(*images, judging, **options):
        used.append(judging.false_alarm_rate)
        return compare(*images, judging, **options)

    check = SequentialComparison(detectable_bias=1e-9, judge=judge)
    for _ in range(33):
        check.add(*(Image(NOISE(rng, SMALL, 3).mean(axis=0), samples=3, batches=1) for _ in range(2)))
    check.conclude()
    assert len(used) == check.looks > 3
    assert all(used.count(level) <= PER_OCTAVE for level in used)
    assert used == sorted(used, reverse=True)
    assert sum(used) < 1e-3


def test_a_gross_fault_fails_after_four_samples_and_a_smaller_one_later():
    rng, at = np.random.default_rng(8), []
    for size in (0.3, 0.02, 0.008):
        check = sequence(NOISE(rng, SMALL * (1 + size), 512), NOISE(rng, SMALL, 512))
        assert check.comparison.verdict == "fail"
        assert check.comparison.statistics.samples_to_certainty == check.samples
        assert check.comparison.statistics.looks == check.looks
        at.append(check.samples)
    assert at[0] == 4 < at[1] < at[2]
    assert "certain after" in check.comparison.reasons[-1]


def test_an_image_that_is_off_by_what_a_pass_excludes_passes_once_in_ten_at_most():
    """Of 30 such images 9 pass with a probability of 0.2 % if one in ten does; correct ones all pass, and sooner."""
    rng, bias, passed = np.random.default_rng(9), 0.05, 0
    asked = {"detectable_bias": bias, "detectable_tile_bias": 9.0}
    for _ in range(30):
        check = sequence(NOISE(rng, SMALL * (1 + bias), 128), NOISE(rng, SMALL, 128), **asked)
        passed += check.conclude().verdict == "pass"
    assert passed < 9
    check = sequence(NOISE(rng, SMALL, 128), NOISE(rng, SMALL, 128), **asked)
    assert check.comparison.verdict == "pass"
    assert check.samples < 64
    assert "would have caught" in check.comparison.reasons[0]
    assert "false-alarm rate 0.001" in check.comparison.reasons[0]


def test_a_budget_that_ends_early_is_undecided_and_says_what_it_takes_and_that_is_enough():
    """But without a wish it passes where a tenth would have shown."""
    rng, asked = np.random.default_rng(10), {"detectable_bias": 0.01, "detectable_tile_bias": 0.5}
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
    check = sequence(test[:8], reference[:8])
    assert not check.decided
    assert (check.conclude().verdict, check.conclude().reasons[-1]) == ("pass", "all 8 samples per pixel were taken")


def test_equal_renders_pass_where_they_agree_and_are_undecided_or_fail_else():
    """Arrays may have noise; an Image of one sample states that it has none."""
    check = SequentialComparison(TRUTH)
    assert check.add(SMALL) is None
    assert check.add(SMALL).verdict == "pass"
    check = SequentialComparison(TRUTH)
    assert [check.add(SMALL * np.float32(1.001)) for _ in range(7)] == [None] * 7
    assert check.add(SMALL * np.float32(1.001)).verdict == "undecided"
    assert "seeds 0, 1, 2, 3, 4, 5, 6 and 7 gave the same image" in check.comparison.reasons[0]
    for gain, verdict in ((1, "pass"), (1.001, "fail")):
        check = SequentialComparison(TRUTH)
        assert check.add(Image(SMALL * np.float32(gain))) is None
        assert check.add(Image(SMALL * np.float32(gain))).verdict == verdict
        assert "free of noise" in check.comparison.reasons[-1]
    broken, check = SMALL.copy(), SequentialComparison(TRUTH)
    broken[3, 4] = np.nan
    assert next(made for _ in range(100) if (made := check.add(broken))).verdict == "fail"


def test_what_is_no_render_fails_at_the_first_look_or_is_named():
    rng = np.random.default_rng(12)
    check = SequentialComparison(render(rng, SMALL, samples=64))
    broken = NOISE(rng, SMALL, 4).astype(np.float32)
    broken[2, 5, 6] = np.nan
    assert [check.add(one) for one in broken[:3]] == [None] * 3
    assert "3 NaN values in 1 pixel" in check.add(broken[3]).reasons[0]
    with pytest.raises(InputError, match=r"test render 5: expected the shape \(24, 32, 3\), got \(5, 6, 3\)"):
        check.add(np.zeros((5, 6, 3)))
    with pytest.raises(InputError, match=r"renders: expected at least one, got none"):
        SequentialComparison(check.image("reference")).conclude()
    for options in ({"false_alarm_rate": 0}, {"detectable_bias": 0.0}, {"detectable_tile_bias": -1}):
        with pytest.raises(InputError, match=next(iter(options))):
            SequentialComparison(check.image("reference"), **options)


@pytest.mark.parametrize(
    ("seed_of", "verdict"),
    [
        (lambda seed: max(seed, 1), "pass"),
        (lambda seed: seed // 2, "pass"),
        (lambda seed: 0, "undecided"),
        (lambda seed: seed % 3, "undecided"),
    ],
)
def test_a_renderer_whose_seeds_give_equal_images_is_judged_by_those_that_differ_and_told(seed_of, verdict):
    check = SequentialComparison(TRUTH)
    for seed in range(2000):
        one = SMALL * np.random.default_rng([17, seed_of(seed)]).exponential(1, SMALL.shape)
        if made := check.add(one):
            break
    assert made.verdict == verdict
    told = made.reasons[-1 if verdict == "pass" else 0]
    assert "seeds 0" in told
    assert "does your program use {seed}?" in told
    assert verdict == "undecided" or check.samples == len({seed_of(s) for s in range(seed + 1)})


def test_renders_that_are_equal_since_events_are_rare_all_count():
    """Half of the renders have no event: to leave them out would double the mean."""
    rng, check = np.random.default_rng(13), SequentialComparison(TRUTH)
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
    assert raytwin.compare(renders, SMALL).verdict != "fail"
    with pytest.raises(InputError, match="one growing render"):
        raytwin.compare(means, SMALL)
    with pytest.raises(InputError, match=r"renders 1 and 8 .* are equal"):
        raytwin.compare([*renders, renders[1]], SMALL)
