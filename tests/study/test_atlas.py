"""Both sides of each edge: ours holds where others fail, and they fail where theory says, by as much as it says."""

import json
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

from raytwin.cli import app
from raytwin.errors import InputError
from raytwin.show import atlas_page
from raytwin.show.atlas_page import colours
from raytwin.study import atlas as stability
from raytwin.study.atlas import EXPERIMENTS, Curve, Experiment, poses
from raytwin.study.atlas.experiment import breaks_at, predicted, run

KEYS = ["name", "parameter", "values", "bound", "methods", "why", "source"]


@cache
def measured(name: str, x: float) -> dict[str, float | None]:
    e = EXPERIMENTS[name]
    with np.errstate(all="ignore"):
        return dict(e.measure(x, np.random.default_rng(7), e.trials))


def hard_end(e: Experiment) -> float:
    """The hardest of the values at which raytwin's own must hold."""
    if e.limit is None:
        return e.values[-1]
    down = e.values[0] > e.values[-1]
    return (min if down else max)(v for v in e.values if (v >= e.limit if down else v <= e.limit))


PREDICTED = [(e.name, m, edge) for e in EXPERIMENTS.values() for m in e.laws if (edge := predicted(e, m, e.values))]
"""(experiment, method, predicted edge) of each that lies within the experiment's values."""


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_raytwins_own_method_holds_the_bound_to_the_hard_end_or_refuses(name):
    e = EXPERIMENTS[name]
    found = measured(name, hard_end(e))
    for method in e.ours:
        assert found[method] is None or found[method] <= e.bound
    assert (e.name, set(e.laws) - found.keys()) == (name, set())
    assert list(e.values) in (sorted(set(e.values)), sorted(set(e.values), reverse=True))


@pytest.mark.parametrize(("name", "method", "edge"), PREDICTED)
def test_a_method_holds_before_its_predicted_edge_and_fails_behind_it_as_theory_says(name, method, edge):
    e = EXPERIMENTS[name]
    harder = np.sign(e.values[-1] - e.values[0])
    before = [v for v in e.values if (v / edge) ** harder <= 1 / e.slack]
    behind = [v for v in e.values if (v / edge) ** harder >= e.slack]
    assert before or behind, "no value lies clear of the edge"
    if before:
        error = measured(name, before[-1])[method]
        assert error is not None
        assert error <= e.bound
    if behind:
        error = measured(name, behind[0])[method]
        if error is None and method in e.ours:
            return
        assert error is not None
        assert error > e.bound
        # The digits lost are those that theory says: an error of at least an eighth of the law's, or everything.
        assert error >= min(e.laws[method](behind[0]), 1.0) / 8


def test_an_edge_lies_between_the_last_value_that_holds_and_the_first_that_does_not():
    for values, errors, edge in (
        ([1, 10, 100], [1e-6, 1e-4, 1e-2], 10 * 10**0.5),
        ([100, 10, 1], [1e-6, 1e-4, 1e-2], 10**0.5),
        ([1, 10], [1e-6, 1e-4], None),
        ([1, 10], [0.5, 0.6], 1),
        ([1, 10, 100], [None, 0.0, 0.5], 100),
    ):
        assert breaks_at(values, errors, 1e-3) == (edge and pytest.approx(edge))
    e = EXPERIMENTS["sphere-far"]
    assert predicted(e, "textbook, float32", e.values) == pytest.approx((e.bound * 2**23) ** 0.5, rel=1e-3)
    assert predicted(e, "robust, float64", e.values) is None


def test_the_json_has_the_keys_that_it_is_known_by(tmp_path):
    two = stability.atlas(("sphere-far", "sphere-ground"))
    atlas_page.write_atlas(two, tmp_path)
    data = json.loads((tmp_path / "atlas.json").read_text())
    assert run(EXPERIMENTS["sphere-far"]) == two.experiments[0]  # the same numbers each time
    for experiment, found in zip(data["experiments"], two.experiments, strict=True):
        assert (tmp_path / f"{found.name}.svg").exists()
        assert list(experiment) == KEYS
        for name, curve in experiment["methods"].items():
            assert list(curve) == ["errors", "breaks_at", "predicted"]
            assert len(curve["errors"]) == len(experiment["values"])
            assert curve["breaks_at"] == found.methods[name].breaks_at


def test_numbers_are_legible_on_their_colour():
    """WCAG's contrast (l + 0.05) / (d + 0.05) of luminances is at least 4.5."""
    for left in np.arange(0, 16.1, 0.1):
        pair = [[int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)] for colour in colours(left)]
        linear = [[c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb] for rgb in pair]
        dark, light = sorted(float(np.dot(rgb, (0.2126, 0.7152, 0.0722))) for rgb in linear)
        assert (light + 0.05) / (dark + 0.05) >= 4.5, left


def test_a_refusal_is_shown_as_one_and_breaks_no_bound():
    measure = lambda x, rng, trials: {"sure": None if x > 10 else 1e-6}  # noqa: E731
    found = run(Experiment("r", "t", "x", "y", 1e-3, (1.0, 10.0, 100.0), measure, ("sure",), "why", "source"))
    assert found.methods["sure"] == Curve((1e-6, 1e-6, None), None, None)


def test_a_pose_is_refused_where_most_photos_are_ambiguous(monkeypatch):
    answers: list[bool] = []
    monkeypatch.setattr(poses, "ambiguous", lambda *_: answers.pop())
    for doubted, refused in ((2, False), (3, True)):
        answers[:] = [k < doubted for k in range(5)]
        error = poses.errors(poses.BoardPhoto(), np.random.default_rng(0), 5)[poses.OURS]
        assert (error is None) == refused


def test_the_command_lists_runs_and_writes(tmp_path):
    listed = CliRunner().invoke(app, ["stability", "--list"])
    assert [line.split()[0] for line in listed.output.splitlines()] == list(EXPERIMENTS)
    ran = CliRunner().invoke(app, ["stability", "sphere-far", "--json", f"{tmp_path}/a.json", "-o", f"{tmp_path}/out"])
    assert ran.exit_code == 0, ran.output
    assert "textbook, float32" in ran.output
    assert "predicted 92" in ran.output
    assert (tmp_path / "out/atlas.html").exists()
    with pytest.raises(InputError, match="did you mean sphere-far"):
        stability.atlas(("sphere-fat",))
    assert json.loads((tmp_path / "a.json").read_text())["experiments"][0]["name"] == "sphere-far"


def test_the_homographys_turn_of_exact_pixels_is_the_cameras_and_noise_hurts_it_more_than_least_squares():
    exact, noisy = (poses.errors(poses.BoardPhoto(noise=noise), np.random.default_rng(3), 12) for noise in (1e-6, 1.0))
    assert exact[poses.HOMOGRAPHY] < 1e-6
    assert noisy[poses.HOMOGRAPHY] > 1.5 * noisy[poses.OURS]
