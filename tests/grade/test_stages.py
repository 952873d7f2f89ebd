"""The stages' tests: what is right passes, and each typical mistake is found and named."""

import pytest

from raytwin.grade.contract import LESSONS
from raytwin.grade.judge import judge_function


@pytest.mark.parametrize("stage", LESSONS.values(), ids=list(LESSONS))
def test_the_reference_passes_its_own_test(stage):
    found = judge_function(stage, stage.reference, seed=1)
    assert found.passed, found.sentence
    assert found.stage == stage.name
