"""Several renderers on several scenes: cells, resuming, references, history, and the page."""

import csv
import itertools
import json
import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from raytwin import references
from raytwin.cli import app
from raytwin.errors import InputError
from raytwin.parallel import Stored, Workers
from raytwin.report import matrix_page
from raytwin.report.matrix_page import badness, make_cell, write_matrix
from raytwin.workflows import make_reference, matrix
from raytwin.workflows.matrix import Cell
from raytwin.workflows.matrix_history import Line, add_to_history, pasts, read_history
from raytwin.workflows.settings import CompareSettings
from raytwin.workflows.shrink import shrink

MINE = """
import numpy as np
from raytwin.renderers.scene_exchange import as_scene
from raytwin.tracer import trace
def right(scene):
    return trace(as_scene(scene), scene["rung"]).mean
def unlit(scene):
    return trace(as_scene(scene), "lambert").mean
def crash(scene):
    raise IndexError("seven")
"""
SMALL = CompareSettings(size=(48, 36))
SUBJECTS = ("mine=mine.py:right", "flat=mine.py:unlit", "mine.py:crash", "numpy64-shadow-conic")


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(MINE)
    return tmp_path


LIGHT = """
[sun]
to_light = [0.0, 0.6, 0.8]
irradiance = [2.0, 1.0, 0.5]
[sky]
radiance = [0.1, 0.2, 0.3]
[paper]
albedo = 0.85
color = [1.0, 1.0, 1.0]
"""


def test_every_cell_is_under_the_light_that_is_asked_for(here):
    Path("light.toml").write_text(LIGHT)
    Path("list.toml").write_text('light = "light.toml"\n')
    lit = matrix.with_settings(SMALL, matrix.read_list("list.toml")[2], "list.toml")
    (job,), (plain,) = (matrix.jobs_of(["overlap"], ["mine.py:right"], chosen) for chosen in (lit, SMALL))
    cell, result = matrix.judge(job)
    assert (cell.verdict, result.scene.sun.irradiance) == ("pass", (2.0, 1.0, 0.5))
    Path("light.toml").write_text(LIGHT.replace("2.0", "3.0"))
    changed = matrix.jobs_of(["overlap"], ["mine.py:right"], lit)[0]
    assert len({job.key, plain.key, changed.key}) == 3
    with pytest.raises(InputError, match="--light: expected no --references beside it"):
        matrix.jobs_of(["overlap"], ["mine.py:right"], lit, Path("reference"))
    small = shrink("overlap", lit, subject=matrix.find_subject("mine.py:unlit", "shadow"), size=(48, 36)).after
    assert small.written.sun.irradiance == (3.0, 1.0, 0.5)


def test_each_cell_is_what_compare_says_and_a_crash_costs_its_own_alone(here):
    jobs = matrix.jobs_of(["overlap", "single"], SUBJECTS, SMALL)
    assert len({job.key for job in jobs}) == len(jobs) == 8
    cells = {(c.scene, c.subject): c for c in (make_cell(job, "out") for job in jobs)}
    assert {key: cell.verdict for key, cell in cells.items()} == {
        ("overlap", "mine"): "pass", ("overlap", "flat"): "fail", ("overlap", "mine.py:crash"): "error",
        ("overlap", "numpy64-shadow-conic"): "pass", ("single", "mine"): "pass", ("single", "flat"): "pass",
        ("single", "mine.py:crash"): "error", ("single", "numpy64-shadow-conic"): "pass",
    }  # fmt: skip
    assert "no cast shadows" in cells["overlap", "flat"].cause
    assert "IndexError: seven" in cells["single", "mine.py:crash"].reason
    assert cells["overlap", "mine"].margin < 1 < cells["overlap", "flat"].margin
    assert Path("out", cells["overlap", "flat"].report).exists()


def test_references_stand_in_for_the_twin(here, scenes):
    folder = here / "reference"
    for name, rung in (("overlap", "shadow"), ("glass", "path")):
        saved = make_reference.make(scenes / name, rung, folder, size=(80, 60), samples=128)
        references.save(saved.new)
    jobs = matrix.jobs_of(["overlap", scenes / "glass"], ["numpy64-lambert-conic"], SMALL, folder)
    jobs += matrix.jobs_of([scenes / "glass"], ["twin-llvm-path-16"], SMALL, folder)
    cells = [make_cell(job, "out") for job in jobs]
    assert [c.verdict for c in cells] == ["fail", "error", "pass"]
    assert "no cast shadows" in cells[0].cause
    assert cells[0].twin_seconds == 0


def test_a_second_run_makes_nothing_again_and_another_file_is_another_job(here):
    jobs = matrix.jobs_of(["single"], SUBJECTS[:2], SMALL)
    store, made = Stored(here / "results", Cell), []

    def make(job):
        made.append(job.name)
        if job.name == "mine" and made.count("mine") > 2:
            raise ZeroDivisionError("ours")
        return Cell(job.key, job.scene_name, job.name, "shadow", "pass")

    run = partial(store.run, make, failed=matrix.failed)
    assert [c.subject for c in run(jobs[:1], Workers())] == ["mine"]
    assert [c.subject for c in run(jobs, Workers())] == ["mine", "flat"]
    assert made == ["mine", "flat"]
    run(jobs, Workers())
    (here / "results" / f"{jobs[0].key}.json").write_text("{")
    run(jobs, Workers())
    assert made == ["mine", "flat", "mine"]
    (here / "results" / f"{jobs[0].key}.json").unlink()
    cell = run(jobs, Workers())[0]
    assert (cell.verdict, cell.reason) == ("error", "ZeroDivisionError: ours")
    Path("mine.py").write_text(MINE + "\n# changed\n")
    assert not {j.key for j in matrix.jobs_of(["single"], SUBJECTS[:2], SMALL)} & {j.key for j in jobs}


@pytest.mark.parametrize(
    ("scenes_", "subjects", "said"),
    [
        ([], ["fill"], "SCENE: expected at least one"),
        (["single"], [], "--subject: expected at least one"),
        (["nowhere"], ["fill"], "no such scene"),
        (["single"], ["nothing.py:render"], "--subject"),
        (["single"], ["a=fill", "a=fill"], "names that differ"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_rendered(here, scenes_, subjects, said):
    with pytest.raises(InputError, match=said):
        matrix.jobs_of(scenes_, subjects, SMALL)


def test_the_page_and_every_table_have_each_cell_and_the_worst_scene_comes_first(here):
    cells = [
        Cell("a", "calm", "one", "shadow", "pass", "fine", "", 0.01, 0.1, 0.02, 0.4, 0.02),
        Cell("b", "calm", "=two", "shadow", "undecided", "noisy", "", 0.1, 0.1, 0.2, 0.4, 0.01),
        Cell("c", "wild", "one", "shadow", "pass", "fine", "", 0.02, 0.1, 0.02, 0.4, 0.03),
        Cell("d", "wild", "=two", "shadow", "fail", "<b>dark</b>", "no & light", 0.5, 0.1, 0.7, 40.0, 0.001),
    ]
    assert sorted(cells, key=badness)[0].key == "d"
    lines = [
        Line(f"2026-01-{day:02}", c.scene, c.subject, "shadow", c.verdict, rmse=c.rmse) for c in cells for day in (1, 2)
    ]
    write_matrix(cells, here / "out", pasts(lines))
    text = (here / "out" / "index.html").read_text()
    assert text.index(">wild</th>") < text.index(">calm</th>")
    assert "<b>dark</b>" not in text
    assert text.count("<svg") == 2
    told = json.loads((here / "out" / "matrix.json").read_text())["cells"]
    assert [c["key"] for c in told] == ["a", "b", "c", "d"]
    rows = list(csv.DictReader((here / "out" / "matrix.csv").read_text().splitlines()))
    assert [r["subject"] for r in rows] == ["one", "'=two", "one", "'=two"]
    suite = ET.parse(here / "out" / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("4", "1", "1")


def test_history_keeps_a_line_per_cell_and_run_and_names_what_hovers_or_drifts(tmp_path):
    file = tmp_path / "h.jsonl"

    def run(day: int, **errors: float) -> list[Cell]:
        made = f"2026-01-{day:02}T00:00:00+00:00"
        return [
            Cell(name, "s", name, "path", "fail" if name == "flips" and day == 9 else "pass", rmse=error,
                 margin=0.8 if name == "near" else 0.1, made=made) for name, error in errors.items()
        ]  # fmt: skip

    rng = np.random.default_rng(5)
    for day in range(1, 11):
        noise = rng.normal(1, 0.05, 4)
        cells = run(day, grows=float(noise[0]) + 0.1 * day, still=float(noise[1]), near=1.0, flips=float(noise[3]))
        add_to_history(file, cells)
    assert len(add_to_history(file, cells)) == 40  # nothing twice
    found = {subject: past for (_, subject, _), past in pasts(read_history(file)).items()}
    assert found["grows"].trend > 0.5
    assert (found["still"].trend, found["still"].hovers) == (None, "")
    assert "80 % of what is allowed" in found["near"].hovers
    assert "changed within 10 runs" in found["flips"].hovers
    file.write_text('{"made": 1}\n')
    with pytest.raises(InputError, match="line 1"):
        read_history(file)


def test_errors_that_only_scatter_drift_in_one_page_of_a_hundred_at_most():
    """200 pages of 12 cells and 8 runs: at a rate of 1 % two in the mean, more than 9 with probability 5e-5."""
    rng = np.random.default_rng(11)
    drifting = 0
    for _ in range(200):
        lines = [
            Line(f"{run:02}", "s", str(cell), "path", "pass", rmse=float(rng.normal(1, 0.1)))
            for cell, run in itertools.product(range(12), range(8))
        ]
        drifting += any(past.trend is not None for past in pasts(lines).values())
    assert drifting <= 9


def test_the_command_takes_a_list_from_a_file_and_tells_the_worst(here):
    Path("m.toml").write_text('scenes = ["single"]\nsize = "48x36"\n[subjects]\nmine = "mine.py:right"\n')
    asked = "matrix overlap --from m.toml --subject flat=mine.py:unlit --history h.jsonl -j 1"
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 1, done.output
    assert "FAIL       overlap: flat: there are no cast shadows" in done.output
    assert len(Path("h.jsonl").read_text().splitlines()) == 4
    told = json.loads(Path("out/matrix/matrix.json").read_text())["cells"]
    assert {(c["scene"], c["subject"]) for c in told} == set(itertools.product(("overlap", "single"), ("flat", "mine")))
    again = CliRunner().invoke(app, asked)
    assert again.exit_code == 1
    assert len(Path("h.jsonl").read_text().splitlines()) == 4  # nothing was compared again
    Path("m.toml").write_text('scenes = "single"\n')
    wrong = CliRunner().invoke(app, ["matrix", "--from", "m.toml"])
    assert "m.toml: scenes" in str(wrong.exception)


def test_a_small_error_within_the_tolerance_stays_pale(here):
    """The picture of a cell that passes is not that of its rounding."""
    job = matrix.jobs_of(["overlap"], ["drjit32-shadow-none"], SMALL)[0]
    _, result = matrix.judge(job)
    colours = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("raytwin.report.data_urls.png_url", lambda pixels: colours.append(pixels) or "")
        matrix_page.thumbnail(result)
    assert colours[0].min() > 200
