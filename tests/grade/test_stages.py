"""The stages' tests: what is right passes, and each typical mistake is found and named."""

import pytest

from raytwin.grade.contract import CONTRACT
from raytwin.grade.judge import judge_function


@pytest.mark.parametrize("stage", CONTRACT.values(), ids=list(CONTRACT))
def test_the_reference_passes_its_own_test(stage):
    found = judge_function(stage, stage.reference, seed=1)
    assert found.passed, found.sentence
    assert found.stage == stage.name
