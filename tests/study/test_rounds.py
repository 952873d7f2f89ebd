"""Rounds of samples until the verdict is certain: what is rendered, what ends them, and who may take part."""

import math

import numpy as np
import pytest

from raytwin import twin
from raytwin.compare import SequentialComparison
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.progress import Stages
from raytwin.study.compare_scene import compare_scene
from raytwin.study.rounds import Budget, Rounds, parse_budget, round_seed

SMALL = {"rung": "path", "tracer_rung": "path", "engine": "numpy32", "size": (48, 36), "cache": False}

MINE = """
from raytwin.renderers.scene_exchange import as_scene
from raytwin.fast import walk


def render(scene, samples=16, seed=0):
    image = walk(as_scene(scene), "path", "numpy32", sampling="center", samples=samples, seed=seed, surface=False)
    return image.mean * {gain}
"""


def test_a_budget_is_samples_or_a_time():
    for text in ("", "0", "-3", "1.5", "ten", "30 parsecs", "0s", "nan", "1e3"):
        with pytest.raises(InputError, match="--budget: expected samples per pixel, as 256, or a time, as 30s"):
            parse_budget(text)
    assert parse_budget(" 2min ").seconds == 120
    assert parse_budget("256") == Budget(samples=256)


def noisy(samples, seed):
    batches = np.random.default_rng(seed).normal(0.5, 0.1, (samples, 16, 16, 3))
    variance = batches.var(axis=0, ddof=1) / samples if samples > 1 else None
    return Image(batches.mean(0), variance, samples, None, samples)


@pytest.mark.parametrize("calls", [1, 4, math.inf])
def test_every_sample_is_rendered_once_with_a_seed_of_its_own(calls):
    asked = {"test": [], "reference": []}

    def side(name):
        return lambda samples, seed: asked[name].append((samples, seed)) or noisy(samples, [seed, name == "test"])

    check = SequentialComparison(detectable_bias=1e-9)
    made = Rounds(check, side("test"), side("reference"), 7, Stages(), calls).decide(Budget(samples=24))
    assert made.verdict == "undecided"
    for found in asked.values():
        assert sum(samples for samples, _ in found) == check.samples == 24
        assert len({seed for _, seed in found}) == len(found)
    assert [seed for _, seed in asked["reference"]] == [round_seed(7, k) for k in range(len(asked["reference"]))]
    assert len({round_seed(seed, number) for seed in range(4) for number in range(4)}) == 16
    assert len(asked["test"]) == {1: len(asked["reference"]), math.inf: 24}.get(calls, len(asked["test"]))
    assert "24 samples" in made.reasons[0]


def test_a_budget_of_seconds_ends_the_rounds_and_is_named():
    check = SequentialComparison(detectable_bias=1e-9)
    made = Rounds(check, noisy, noisy, 0, Stages()).decide(Budget(math.inf, 1e-9, "1ns of the budget"))
    assert made.verdict == "undecided"
    assert check.samples == 4
    assert "after 1ns of the budget" in made.reasons[0]


def test_both_sides_stop_when_they_agree_and_again_cost_the_same(scenes, monkeypatch):
    seeds, rendered = [], twin.render
    monkeypatch.setattr(twin, "render", lambda *a, **o: (seeds.append((o["samples"], o["seed"])), rendered(*a, **o))[1])
    first = compare_scene(scenes / "overlap", **SMALL)
    assert first.comparison.verdict == "pass"
    assert 8 <= first.comparison.statistics.samples_to_certainty == first.twin.samples == first.subject.samples <= 64
    assert len(set(seeds)) == len(seeds)
    before = list(seeds)
    again = compare_scene(scenes / "overlap", **SMALL)
    assert seeds == [*before, *before]  # the cache would have had them all
    np.testing.assert_array_equal(again.subject.mean, first.subject.mean)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("gain", "its_seed", "verdict"),
    [(1.0, "seed", "pass"), (1.1, "seed", "fail"), (1.0, "max(seed, 1)", "pass"), (1.0, "0", "undecided")],
)
def test_a_users_function_is_asked_for_no_more_than_it_needs_and_may_repeat_itself(
    scenes, tmp_path, gain, its_seed, verdict
):
    (tmp_path / "mine.py").write_text(MINE.format(gain=gain).replace("seed=seed", f"seed={its_seed}"))
    options = {"rung": "path", "size": (32, 24), "cache": False}
    result = compare_scene(scenes / "overlap", subject=str(tmp_path / "mine.py"), **options)
    assert result.verdict == verdict
    certain = result.comparison.statistics.samples_to_certainty
    if its_seed != "seed":
        assert any("does your program use {seed}?" in reason for reason in result.reasons)
    elif verdict == "pass":
        assert result.subject.samples == certain <= 64
    else:
        assert result.subject.samples == 64  # a cause is hard to find in noise
        assert certain <= 8
