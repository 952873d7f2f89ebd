"""The paper's figures again at toy size: what is reported, never how fast; and the trim boxes beside each other."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from raytwin import twin
from raytwin.cli import app
from raytwin.errors import InputError
from raytwin.paper.paper_runs import SMALL, SPECULATION, boxed, errors, hard_cases, lambert, two_spheres
from raytwin.speed import trace
from raytwin.speed.boxes import TRIMS, trim_boxes

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """The folder of one small run of the command."""
    folder = tmp_path_factory.mktemp("out")
    size = "--photo-size", "400x300", "--photo-count", "5"
    run = CliRunner().invoke(app, ["bench", "paper", *size, "--budget", "3600", "--repeats", "1", "-o", str(folder)])
    assert run.exit_code == 0, run.output
    assert "calibration at full size in one thread / raytwin's" in run.output
    return folder


@pytest.fixture(scope="module")
def found(out) -> dict:
    return json.loads((out / "paper.json").read_text(encoding="utf-8"))


def test_one_command_writes_page_numbers_table_and_charts_and_every_figure_has_its_rows(out, found):
    charts = {f"{k}.svg" for k in ("calibration", "intersection", "speculation")}
    assert {p.name for p in out.iterdir()} == {"paper.html", "paper.json", "paper.md"} | charts
    if twin.activate().variant == "scalar_rgb":
        pytest.skip("no LLVM on this machine: Dr.Jit's engines have nothing to run on")
    small = {f["method"] for f in found["intersection"] if f["width"] == 100}
    assert small == {m.name for m in lambert(SMALL)}
    assert {f["method"] for f in found["speculation"]} == {m.name for m in lambert(SPECULATION)}
    assert {"full size, one thread", "raytwin's own", "photos shrunk"} <= {c["setting"] for c in found["calibration"]}
    assert found["covered"] == pytest.approx(0.05, abs=0.004)


def test_every_ratio_comes_from_the_rows(found):
    seconds = {f["method"]: f["seconds_median"] for f in found["intersection"] if f["width"] == 400}
    ratio = {r["what"]: r["measured"] for r in found["ratios"]}
    if "drjit32-lambert-conic" in seconds:
        want = seconds["drjit32-lambert-conic"] / seconds["fill"]
        assert ratio["Dr.Jit trimmed frame / one fill"] == pytest.approx(want)
    rows = {(c["setting"], c["scale"]): c for c in found["calibration"]}
    whole, ours = rows["full size, one thread", 1.0], rows["raytwin's own", 1.0]
    want = whole["seconds_median"] / ours["seconds_median"]
    assert ratio["calibration at full size in one thread / raytwin's"] == pytest.approx(want)
    assert ratio["careful speculation's p99.9 error, n = 8 / peak"] < 1e-3


def test_errors_are_held_against_float64_untrimmed(found):
    frames = {(f["method"], f["width"]): f for f in (*found["intersection"], *found["speculation"])}
    loops = [f for (name, _), f in frames.items() if name.startswith("loop")]
    assert all(f["max_abs"] < 2e-7 and f["cut"] == 0 for f in loops)
    scene = two_spheres(400, 300)
    own = errors(trace(scene, "lambert", "numpy32").mean, trace(scene, "lambert", "numpy64", trim="none").mean)
    assert frames["numpy32-lambert-conic", 400]["rmse"] == pytest.approx(own["rmse"])
    assert frames["numpy32-lambert-paper8", 400]["rmse"] > 1e3 * frames["numpy32-lambert-careful8", 400]["rmse"]
    assert frames["fill", 400]["rmse"] is None


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["paper", "--photo-count", "2"], "--photo-count"),
        (["paper", "--budget", "0"], "--budget"),
    ],
)
def test_what_was_asked_wrongly_is_named(options, named):
    run = CliRunner().invoke(app, ["bench", *options])
    assert isinstance(run.exception, InputError)
    assert named in run.exception.where


# ------------------------------------------------------------------------------------------ boxes


def test_the_eight_corner_box_cuts_what_is_made_to_be_hard():
    for scene in hard_cases():
        rows = {b.trim: b for b in boxed(scene)}
        assert rows["corners"].cut > 1000
        assert rows["conic"].cut == 0


def test_a_wrong_box_is_seen_to_cut():
    """Each box a pixel too small on the left: its leftmost column of visible pixels is lost, and nothing else."""
    scene = two_spheres(403, 302)
    right = trim_boxes(scene.objects, scene.camera)
    seen = trace(scene, "surface").surface
    first = [int(np.flatnonzero((seen.ids == i).any(axis=0))[0]) for i in (0, 1)]
    lost = sum(int((seen.ids[:, x] == i).sum()) for i, x in enumerate(first))

    def narrow(things, camera):
        boxes = right.copy()
        boxes[:, 0] = np.array(first) + 1
        return boxes

    (row,) = boxed(scene, {"narrow": narrow})
    assert row.cut == lost > 0
    assert {b.trim for b in boxed(scene)} == set(TRIMS)
