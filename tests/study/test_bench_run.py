"""Methods, truths and a whole run: tiny pictures, small budgets, no word about how fast anything is."""

import functools
import itertools
import json
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from program import raytwin

from raytwin.compare import METRICS
from raytwin.errors import InputError, MachineError
from raytwin.progress import silent
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.renderer_table import RENDERERS, renderers_of
from raytwin.renderers.subject_renderers import Filled, Speculated
from raytwin.renderers.twin_renderers import Twin
from raytwin.scene.scene_files import read_scene
from raytwin.study import bench
from raytwin.study.bench import on_frontier, reference_of, sized, staircase
from raytwin.study.converged import converged
from raytwin.teach.contract.subject import method as as_method

nightly = pytest.mark.nightly

KEYS = [
    "method", "engine", "precision", "rung", "trim", "speculation", "samples", "width", "height", "seconds_median",
    "seconds_iqr", "compile_seconds", "truth", "rmse", "rmse_sigma", "relmse", "p999_abs", "truth_floor",
    "on_frontier", "verdict", "reason",
]  # fmt: skip


@pytest.fixture(scope="module")
def view(scenes):
    """A scene by name, at a small size."""

    def small(name: str, width: int = 48, height: int = 36):
        scene = read_scene(scenes / name)
        return scene.with_camera(scene.camera.resized(width, height))

    return small


# ------------------------------------------------------------------------------------------ methods


def test_every_method_is_found_by_the_name_that_its_fields_give():
    assert all(method.name == name for name, method in RENDERERS.items())
    varied = replace(RENDERERS["drjit32-shadow-conic"], rung="lambert", trim="none")
    assert RENDERERS[varied.name] == varied


def test_a_family_is_the_name_without_what_varies():
    families = {
        "fill": "fill", "drjit32-shadow-conic": "drjit32-shadow-conic", "drjit32-shadow-16spp": "drjit32-shadow-spp",
        "drjit32-path-16": "drjit32-path", "numpy32-shadow-paper4": "numpy32-shadow-paper",
        "twin-llvm-shadow": "twin-llvm-shadow", "twin-llvm-direct-4": "twin-llvm-direct",
    }  # fmt: skip
    assert {name: RENDERERS[name].family for name in families} == families


AMPLE = 3600
"""Seconds: no test's outcome hangs on how busy the machine is."""

GLOBS = "fill", "numpy64-lambert-conic", "numpy32-shadow-conic", "drjit32-shadow-conic", "twin-llvm-path-1", "*cuda*"

HERE = [m for m in RENDERERS.values() if "cuda" not in m.library and m.samples <= 16]
KINDS = sorted({type(m) for m in HERE}, key=lambda kind: kind.__name__)


@pytest.fixture(scope="module")
def truth(view):
    """The truth of its name, made once."""
    return functools.cache(lambda name: converged(view("overlap"), *name.split("-"), samples=64).image.mean)


@nightly
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_method_gives_an_image_near_its_truth(view, truth, kind):
    scene = view("overlap")
    for method in [m for m in HERE if type(m) is kind][-2:]:
        try:
            call = method.prepare(scene)
        except InputError as error:
            pytest.skip(f"{method.name}: {error}")
        image, other = call(1).mean.copy(), call(2).mean
        assert np.array_equal(image, other) != method.noisy, method.name
        assert image.shape == (36, 48, 3)
        assert image.dtype == np.float32
        bound = {Filled: 1.0, Speculated: 0.2, Twin: 0.1}
        assert METRICS["rmse"].function(image, truth(reference_of(method))) < bound.get(kind, 0.03), method.name


def test_patterns_choose_methods_in_the_tables_order():
    found = renderers_of(("numpy32-shadow-*c*", "fill"))
    assert [m.name for m in found[:3]] == ["fill", "numpy32-shadow-corners", "numpy32-shadow-conic"]
    with pytest.raises(InputError, match="nonsense"):
        renderers_of(("fill", "nonsense*"))
    with pytest.raises(InputError, match=r"--methods: .*, got none"):
        renderers_of(())


def test_sizes_keep_the_pictures_aspect(view):
    camera = view("single", 640, 480).camera
    for megapixels in (0.05, 0.2, 12, 48):
        w, h = sized(camera, megapixels).image_size
        assert w * 3 == h * 4
        assert w * h == pytest.approx(megapixels * 1e6, rel=0.02)


# ------------------------------------------------------------------------------------------ a whole run


FEW = {"sizes": (0.002,), "budget": AMPLE, "repeats": 3, "truth_samples": 64}


@pytest.fixture(scope="module")
def small_run(scenes):
    """GLOBS, and a renderer of one's own that draws the background alone."""

    def mine(scene):
        return np.broadcast_to(scene["sky"]["radiance"], (scene["height"], scene["width"], 3))

    return bench.bench(scenes / "overlap", methods=(*GLOBS, as_method(mine)), **FEW)


@nightly
def test_errors_are_against_the_own_rung_and_against_the_whole_light(small_run):
    own, whole = ({r.method: r.rmse for r in rows} for rows in (small_run.rows, small_run.errors))
    assert {e.truth for e in small_run.errors} == {"path-area"}
    assert set(own) == set(whole)
    assert own["numpy32-shadow-conic"] < 1e-5 < whole["numpy32-shadow-conic"]
    assert own["numpy64-lambert-conic"] <= 1e-7
    assert own[small_run.subjects[0]] > 1e-2
    assert all(r.truth_floor > 0 and r.seconds_median > 0 for r in small_run.rows)
    assert {r.method for r in small_run.rows if r.rmse_sigma} == {"twin-llvm-path-1"}  # where seeds differ
    asked = {m.name for m in renderers_of(GLOBS)} | set(small_run.subjects)
    assert set(own) | {name for name, why in small_run.left_out.items() if why} == asked


@nightly
def test_each_row_has_the_verdict_of_its_picture_beside_the_twin_at_its_own_light_level(small_run):
    (own,) = small_run.subjects
    found = {row.method: row.verdict for row in small_run.rows}
    assert found == {
        own: "fail", "fill": "fail", "numpy64-lambert-conic": "pass", "numpy32-shadow-conic": "pass",
        "drjit32-shadow-conic": "pass", "twin-llvm-path-1": "undecided",
    }  # fmt: skip
    assert small_run.exit_code == 1
    reasons = {row.method: row.reason for row in small_run.rows}
    assert "are off by more than the tolerance" in reasons[own]
    assert "too few random samples" in reasons["twin-llvm-path-1"]


MINE = """
import numpy as np
from raytwin.renderers.scene_exchange import as_scene
from raytwin.fast import walk
from raytwin.tracer import trace
def right(scene):
    if scene["name"] == "single":
        raise IndexError("seven")
    return trace(as_scene(scene), scene["rung"]).mean
def unlit(scene):
    return trace(as_scene(scene), "lambert").mean
def walked(scene, seed=0, samples=16):
    return walk(as_scene(scene), "path", "numpy32", sampling="center", samples=samples, seed=seed)
"""


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    return str(tmp_path / "mine.py")


@nightly
def test_several_scenes_have_a_result_each_and_a_crash_costs_its_own_row_alone(mine, scenes):
    methods = ["fill", *(as_method(f"{mine}:{name}", name) for name in ("right", "unlit"))]
    methods += [as_method("numpy32-shadow-none"), "numpy32-shadow-none"]
    overlap, single = bench.bench_scenes([scenes / "overlap", scenes / "single"], methods=methods, **FEW)
    rows = {(b.scene, r.method): r.verdict for b in (overlap, single) for r in b.rows}
    assert rows == {
        ("overlap", "right"): "pass", ("overlap", "unlit"): "fail", ("overlap", "numpy32-shadow-none"): "pass",
        ("overlap", "fill"): "fail", ("single", "unlit"): "pass", ("single", "numpy32-shadow-none"): "pass",
        ("single", "fill"): "fail",
    }  # fmt: skip
    assert single.left_out.keys() == {"right"}
    assert "IndexError: seven" in single.left_out["right"]
    assert overlap.subjects == single.subjects == ("right", "unlit", "numpy32-shadow-none")
    assert (overlap.exit_code, single.exit_code) == (1, 2)


@nightly
def test_a_crash_in_a_later_render_leaves_it_out_and_light_through_centers_has_a_twin_of_its_own(mine, scenes):
    def moody(scene, seed):
        if seed > 1:
            raise IndexError("eight")
        return np.zeros((scene["height"], scene["width"], 3))

    walked = as_method(f"{mine}:walked", "walked", rung="path")
    found = bench.bench(scenes / "overlap", methods=[walked, as_method(moody)], **FEW)
    assert {row.method: row.verdict for row in found.rows} == {"walked": "pass"}
    assert [row.truth for row in (*found.rows, *found.errors)] == ["path-center", "path-area"]
    assert "IndexError: eight" in found.left_out["moody"]
    assert found.exit_code == 2


def test_the_budget_is_shared_by_all_scenes(scenes, monkeypatch):
    left = []

    def measured(scene, tolerance, methods, subjects, deadline, *rest):
        left.append(deadline - time.perf_counter())
        return ["a row"], [], {}

    monkeypatch.setattr(bench, "measure_size", measured)
    bench.bench_scenes([scenes / "overlap", scenes / "single"], methods=["fill"], sizes=(0.001, 0.002), budget=400)
    assert left == pytest.approx([100, 200, 100, 200], abs=20)


def test_what_cannot_be_is_refused_before_anything_is_measured(scenes, monkeypatch):
    monkeypatch.setattr(bench, "measure_size", None)
    for names, methods, said in (
        (("overlap", "nowhere"), ("fill",), "no such scene"),
        (("overlap", "overlap"), ("fill",), "SCENE: expected each once, under a name of its own, got overlap twice"),
        (("overlap",), (Filled(), Filled()), "--subject: expected each once, .*, got fill twice"),
    ):
        with pytest.raises(InputError, match=said):
            bench.bench_scenes([scenes / name for name in names], methods=methods)


def test_a_run_that_measured_nothing_says_why_and_what_to_give(scenes, monkeypatch):
    with pytest.raises(InputError, match=r"more seconds, or fewer --methods: none of 5 .* got 1e-09; prep") as error:
        bench.bench(scenes / "single", methods=("fill", "numpy*-lambert-*"), sizes=(0.001,), budget=1e-9)
    assert error.value.where == "--budget"

    def lacking(self, scene):
        raise MachineError("variant", "a machine with it", "none")

    monkeypatch.setattr(Filled, "prepare", lacking)
    with pytest.raises(InputError, match="fill: variant: expected a machine with it") as error:
        bench.bench(scenes / "single", methods=("fill",), sizes=(0.002,), truth_samples=4)
    assert error.value.where == "--methods"


class Clock:
    """Seconds that pass only when a method takes them."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch):
    monkeypatch.setattr(bench, "clock", made := Clock())
    return made


@dataclass(frozen=True)
class Slow(Renderer):
    """A method that takes `preparing` seconds, `calling` per sample for a call, and once `compiling` in the first."""

    clock: Clock | None = None
    kind: str = "a"
    samples: int = 1
    preparing: float = 0.0
    calling: float = 0.0
    compiling: float = 0.0
    noisy: bool = False

    @property
    def name(self):
        return f"{self.kind}-{self.samples}"

    def prepare(self, scene):
        self.clock.now += self.preparing

        def call(seed):
            self.clock.now += self.calling * self.samples + self.compiling * (seed == 0)

        return call


def silent_look(run, image):
    pass


@pytest.mark.parametrize(
    ("preparing", "calling", "budget", "begun", "why"),
    [
        (1.0, 0.0, 2, ["a-1", "b-1"], "no time: a call would take about 2 s"),
        (1.0, 0.0, 0.5, ["a-1"], "no time to prepare it"),
        (0.0, 1.0, 4, ["a-1", "b-1", "a-2"], "no time: a call would take about 2 s"),
    ],
)
def test_too_little_time_leaves_the_cheapest_of_every_family(clock, preparing, calling, budget, begun, why):
    methods = [Slow("shadow", clock, kind, n, preparing, calling) for kind in "ab" for n in (1, 2, 4, 8)]
    runs, left = bench.first_calls(None, methods, (), silent_look, clock.now + budget, silent)
    assert [r.method.name for r in runs] == begun
    assert left.keys() == {m.name for m in methods} - set(begun)
    assert left.get("b-2", left.get("b-1")) == why


def test_every_round_runs_each_method_once_in_an_order_of_its_own_with_another_seed(clock):
    ran = []
    runs = [bench._Run(Slow("shadow", clock), lambda seed, name=name: ran.append((name, seed))) for name in "abcdef"]
    bench.rounds(runs, silent_look, clock.now + 1, 9)
    rounds = ["".join(name for name, seed in ran if seed == number) for number in range(1, 10)]
    assert len(ran) == 54
    assert all(sorted(names) == list("abcdef") for names in rounds)
    assert len(set(rounds)) > 5


def test_no_call_begins_that_would_end_past_the_deadline_and_what_the_first_cost_is_kept_apart(clock):
    methods = [Slow("shadow", clock, "quick", 1, 0.0, 0.125), Slow("shadow", clock, "slow", 1, 0.0, 30.0, 4.0)]
    runs, _ = bench.first_calls(None, methods, (), silent_look, clock.now + 100, silent)
    deadline = clock.now + 100
    bench.rounds(runs, silent_look, deadline, 50)
    assert clock.now <= deadline
    assert {r.method.kind: len(r.seconds) for r in runs} == {"quick": 50, "slow": 3}
    for one in runs:
        one.judged, one.errors = Judged(), {"path-area": [[1.0, 2.0, 3.0]]}
    _, row = bench.measurements(runs, "path-area", 0.0, (4, 3))
    assert (row.seconds_median, row.seconds_iqr, row.compile_seconds) == (30, 0, 4)


@dataclass
class Judged:
    verdict: str = "pass"
    reasons: tuple[str, ...] = ("they agree",)


def test_an_error_bar_covers_the_mean_of_many_images(clock):
    """The mean of 16 errors lies within its bar (one standard error) two times of three (Student's t: 0.667)."""
    rng, covered = np.random.default_rng(5), 0
    for _ in range(300):
        errors = rng.normal(2.0, 0.3, (16, 1)) * np.ones(3)
        one = bench._Run(Slow("shadow", clock), lambda seed: None, seconds=[1.0], errors={"x": errors.tolist()})
        one.judged = Judged()
        (row,) = bench.measurements([one], "x", 0.0, (4, 3))
        covered += abs(row.rmse - 2.0) < row.rmse_sigma
    assert 0.59 < covered / 300 < 0.75


def test_the_exit_code_is_that_of_the_subjects_and_the_folder_has_json_page_and_charts(
    mine, scenes, tmp_path, monkeypatch
):
    monkeypatch.setitem(bench.bench.__kwdefaults__, "truth_samples", 64)  # or the references take seconds
    done = raytwin(
        "bench", "overlap", scenes / "single", "--methods", "fill", "--subject", f"{mine}:unlit", "--sizes", "0.002",
        "--budget", AMPLE, "-o", tmp_path / "out", "--json", tmp_path / "a.json",
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "FAIL  overlap" in done.stdout
    overlap, single = json.loads((tmp_path / "a.json").read_text())
    assert (overlap["scene"], single["scene"]) == ("overlap", "single")
    own = f"{mine}:unlit"
    verdicts = [{row["method"]: row["verdict"] for row in found["rows"]} for found in (overlap, single)]
    assert verdicts == [{"fill": "fail", own: "fail"}, {"fill": "fail", own: "pass"}]
    assert all(list(row) == KEYS for found in (overlap, single) for row in (*found["rows"], *found["errors"]))
    errors = [{row["method"]: row["rmse"] for row in single[rows]}[own] for rows in ("rows", "errors")]
    assert errors[0] < 1e-5 < errors[1]  # against its own light level, against the whole light
    assert {"bench.html", "bench.json"} <= {p.name for p in (tmp_path / "out").iterdir()}


def test_methods_can_be_listed_without_a_scene():
    run = raytwin("bench", "list")
    assert run.returncode == 0
    assert run.stdout.count("\n") == len(RENDERERS)


# ------------------------------------------------------------------------------------------ the frontier

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
