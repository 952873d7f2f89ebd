"""Light levels: the recommendation holds for another seed, costs are counted, and parts are their closed forms."""

from math import inf

import msgspec
import numpy as np
import pytest
import truths
from program import raytwin, refused
from scene_of import scene_of

from raytwin import twin
from raytwin.errors import InputError
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.subject_renderers import Filled, Traced, fast_engine
from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene
from raytwin.study import levels as room
from raytwin.study.converged import converged
from raytwin.study.levels import Row, Table, levels, surfaces_met, walks

SIZE = 80, 60


@pytest.fixture(scope="module")
def corner() -> Scene:
    return truths.corner(24)


@pytest.fixture(scope="module")
def table(scenes) -> Table:
    return levels(scenes / "overlap", size=SIZE).found


def method_of(row: Row) -> Renderer:
    """The renderer of a row of the tracer."""
    engine = row.method.partition("-")[0]
    plain = Filled() if row.rung == "none" else Traced(row.rung, engine)
    return plain if row.depth is None else walks(engine, row.depth, row.samples)


@pytest.mark.nightly
def test_errors_fall_with_light_and_samples_and_both_sides_agree(table):
    errors = {row.method.partition("-")[2] if row.side == "tracer" else row.method: row.error for row in table.rows}
    assert errors["lambert-conic"] > 2 * errors["shadow-conic"] > 2 * errors["path-depth8-64"]
    assert errors["path-depth8-1"] > errors["path-depth8-4"] > errors["path-depth8-16"] > errors["path-depth8-64"]
    twins = {row.rung: row for row in table.rows if row.side == "twin"}
    assert twins["lambert"].error == pytest.approx(errors["lambert-conic"], rel=1e-3)
    assert twins["shadow"].error == pytest.approx(errors["shadow-conic"], rel=1e-3)
    assert [row.rays for row in table.rows] == sorted(row.rays for row in table.rows)
    assert (table.choice, {part.can_be_dropped for part in table.parts}) == (None, {None})


@pytest.mark.parametrize(
    ("tolerance", "rungs"),
    [
        pytest.param(0.1, {"lambert"}, marks=pytest.mark.nightly),
        (0.03, {"shadow"}),
        pytest.param(0.012, {"path", "sky", "shadow"}, marks=pytest.mark.nightly),
    ],
)
def test_the_choice_meets_the_tolerance_with_another_seed_and_the_next_cheaper_fails(scenes, tolerance, rungs):
    """Against another reference; a twentieth is granted to another seed's noise, in so small a picture."""
    scene = read_scene(scenes / "overlap")
    scene = scene.with_camera(scene.camera.resized(*SIZE))
    found = levels(scene, tolerance).found
    assert found.choice.rung in rungs
    assert found.choice.error_most <= tolerance
    assert found.floor <= tolerance / 10
    whole = converged(scene, samples=1024, depth=16)
    rows = [row for row in found.rows if row.side == "tracer"]
    place = rows.index(found.choice)
    right, wrong = (whole.error(method_of(row)(scene, 5).mean).value for row in (rows[place], rows[place - 1]))
    assert right <= 1.05 * tolerance
    assert wrong > 0.95 * tolerance
    assert all(row.error_most > tolerance for row in rows[:place])


@pytest.mark.nightly
def test_rays_are_counted_from_the_share_of_paths_that_meet_a_surface(corner):
    """1/2 of the hemisphere over each plane is the other: 1, 1/2, 1/4, ... of the paths go on."""
    engine = fast_engine(twin.activate().variant)
    met = surfaces_met(corner, engine)
    assert met == pytest.approx([0.5**k for k in range(len(met))], abs=0.02)
    rays = {(row.rung, row.depth, row.samples): row.rays for row in levels(corner).found.rows if row.side == "tracer"}
    assert rays["lambert", None, 1] == 1
    assert rays["shadow", None, 1] == 2
    assert rays["path", 3, 16] == pytest.approx(16 * (1 + 2 * 1.5), rel=0.02)
    assert rays["path", 4, 1] == pytest.approx(1 + 2 * 1.75, rel=0.02)


@pytest.mark.nightly
def test_each_part_is_its_term_of_the_series_and_can_be_dropped_below_the_tolerance(corner):
    """1/2 open, 1/4 occluded, bounces of 1/16, 1/64, ..., 1/3 in all."""
    parts = {part.part: part for part in levels(corner, 0.03).found.parts}
    whole = truths.in_wedge(90, 0.5, 0.5, inf)
    for name, n in {"all bounces": 0, "bounces beyond 1": 1, "bounces beyond 2": 2}.items():
        left_out = whole - truths.in_wedge(90, 0.5, 0.5, n)
        assert parts[name].error == pytest.approx(left_out, rel=0.02)
        assert parts[name].share_of_light == pytest.approx(left_out / whole, rel=0.02)
        assert parts[name].can_be_dropped == (left_out < 0.03)
    assert parts["occlusion of the sky"].error == pytest.approx(0.25, rel=0.01)
    assert parts["shadows of the sun"].can_be_dropped


@pytest.mark.nightly
def test_the_answer_does_not_depend_on_how_long_anything_takes(scenes, monkeypatch):
    """A clock that runs by leaps, as on a machine with other things to do."""
    answers = []
    for seed in (0, 1):
        rng = np.random.default_rng(seed)
        monkeypatch.setattr(
            "time.perf_counter", lambda rng=rng, now=[0.0]: now.append(now[-1] + rng.exponential()) or now[-1]
        )
        found = levels(scenes / "overlap", 0.02, size=SIZE).found
        rows = tuple(msgspec.structs.replace(row, seconds=0.0) for row in found.rows)
        answers.append(msgspec.structs.replace(found, seconds=0.0, rows=rows, choice=None))
    assert answers[0] == answers[1]


def test_an_empty_scene_needs_no_tracer():
    found = levels(scene_of("empty", truths.view_of((0, 0, 0), (0, 0, 3), 3), (), truths.WHITE), 1e-6).found
    assert (found.choice.method, found.choice.rays, found.choice.error) == ("fill", 0.0, 0.0)
    assert {part.can_be_dropped for part in found.parts} == {True}


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("limit", "samples", "tolerance", "reason"),
    [
        ("MAX_REFERENCE_SAMPLES", 2, 1e-3, "cannot tell"),
        ("MAX_SAMPLES", 4, 2e-3, "no method meets it; the nearest is"),
    ],
)
def test_where_no_method_can_be_recommended_the_reason_is_told(scenes, monkeypatch, limit, samples, tolerance, reason):
    monkeypatch.setattr(room, limit, samples)
    found = levels(scenes / "overlap", tolerance, size=SIZE).found
    assert found.choice is None
    assert found.reason.startswith(reason)


def test_a_tolerance_or_metric_that_is_none_is_refused(scenes):
    for tolerance in (0.0, -1.0, float("nan"), inf):
        with pytest.raises(InputError, match="--tolerance: expected a finite number > 0"):
            levels(scenes / "single", tolerance)
    with pytest.raises(InputError, match="--metric: expected one of rmse"):
        levels(scenes / "single", 0.1, "psnr")


@pytest.mark.nightly
def test_the_command_writes_what_it_says(tmp_path):
    run = raytwin("levels", "single", "--tolerance", "0.1", "--size", "80x60", "--json", tmp_path / "a.json",
                  "-o", tmp_path / "page")  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert "Cheapest with rmse <= 0.1: sun and sky without shadows" in run.stdout
    found = msgspec.json.decode((tmp_path / "a.json").read_bytes(), type=Table)
    assert (found.tolerance, found.rows[0].method) == (0.1, "fill")
    assert {p.name for p in (tmp_path / "page").iterdir()} == {"levels.html", "levels.json", "levels.svg"}
    refused(raytwin("levels", "single", "--tolerance", "0"), "--tolerance")
