"""The ladder as a job: every rung on both sides, smaller errors further up, the parts of the light beside them."""

import numpy as np
import pytest

from raytwin import speed
from raytwin.analysis.ladder import ladder
from raytwin.analysis.own_error import OWN
from raytwin.renderers.subject_renderers import Traced
from raytwin.rungs import RUNGS


@pytest.fixture(scope="module")
def found(scenes):
    return ladder(scenes / "overlap", size=(80, 60), samples=16)


def test_every_rung_stands_on_both_sides_and_both_are_equally_far_from_the_whole_light(found):
    steps = {(step.rung, step.side): step for step in found.rungs.steps}
    assert set(steps) == {(rung, side) for rung in RUNGS for side in ("tracer", "twin")}
    for rung in ("lambert", "shadow"):
        assert steps[rung, "tracer"].rmse == pytest.approx(steps[rung, "twin"].rmse, rel=1e-3)
        np.testing.assert_allclose(found.images[f"tracer: {rung}"], found.images[f"twin: {rung}"], atol=2e-5)
    # The highest rung is as far from the whole light as its own noise has it, to a fifth; the others are farther.
    for side in ("tracer", "twin"):
        top = steps["path", side]
        assert top.rmse == pytest.approx(np.hypot(top.noise, found.rungs.floor), rel=0.2)
        assert top.rmse < min(steps[rung, side].rmse for rung in ("lambert", "shadow", "sky"))
        assert steps["lambert", side].rmse > 2 * steps["shadow", side].rmse
        assert steps["surface", side].rmse is None


def test_a_rung_that_fails_beside_the_twin_has_an_error_of_its_own(found, scenes, monkeypatch):
    def own(ladder):
        return {rung for rung, parts in ladder.rungs.ledgers.items() if any(OWN in part.part for part in parts)}

    class Shadowless(Traced):
        def prepare(self, scene):
            return Traced("lambert", self.engine).prepare(scene)

    monkeypatch.setattr("raytwin.analysis.ladder.Traced", Shadowless)
    assert own(found) == set()
    assert own(ladder(scenes / "overlap", size=(80, 60), samples=4)) == {"shadow"}


def test_parts_alone_add_up_to_all_light_up_to_each(found):
    alone = [image for title, image in found.images.items() if title.endswith(" alone")]
    up_to = [image for title, image in found.images.items() if title.startswith("all light up to ")]
    assert (len(alone), len(up_to)) == (len(speed.PARTS), len(speed.PARTS) - 1)
    for k, image in enumerate(up_to):
        np.testing.assert_allclose(sum(alone[: k + 2]), image, atol=1e-5)
