"""The walk as a learner takes it: a script with its functions filled in, or with mistakes in them, and a notebook."""

import json
import re
import runpy

import numpy as np
import pytest
from browser import barriers_of
from program import raytwin, refused

from raytwin.contract.check_function import judge_function
from raytwin.contract.stage_table import CONTRACT, LESSONS
from raytwin.tutorial import solutions, with_functions, write_walk
from raytwin.tutorial.show import mine, viewed
from raytwin.tutorial.written import solutions as solution_texts
from raytwin.tutorial.written import source

pytestmark = pytest.mark.slow

STAGES = (
    "tag_centers",
    "intrinsics",
    "back_project",
    "intersect_sphere",
    "shade",
    "sun_visible",
    "sky_visible",
    "hemisphere",
)

MISTAKES = {
    "tag_centers": ("- 0.5", "", "half a pixel is to be taken off"),
    "intrinsics": ("s = B33 + cx * B13 + cy * B23", "s = B33", "B is known up to a scale"),
    "back_project": (
        "np.arange(width), np.arange(height)",
        "np.arange(width) + 0.5, np.arange(height) + 0.5",
        "half a pixel beside the pixels' centres",
    ),
    "intersect_sphere": ("np.where(far > 0, far, np.inf)", "np.inf", "rays that start inside the sphere miss it"),
    "shade": ("albedo / np.pi", "albedo", "π times too bright"),
    "sun_visible": (" & (b < 0)", "", "only those with t > 0"),
    "sky_visible": ("(radius / d) ** 2", "(radius / d)", "r/d is not squared"),
    "hemisphere": ("np.sqrt(1 - a)", "1 - a", "the directions are not unit"),
}
"""Of each function: what is written, what stands there instead, and words that must come."""


def run(text, folder, monkeypatch, capsys) -> str:
    """What the script printed."""
    (folder / "walk.py").write_text(text, encoding="utf-8")
    monkeypatch.chdir(folder)
    runpy.run_path("walk.py")
    return capsys.readouterr().out


def errors(said: str) -> dict[str, float]:
    """picture -> RMSE beside the twin."""
    return {name: float(x) for name, x in re.findall(r"^\d (\w+): RMSE (\S+) beside the twin", said, re.MULTILINE)}


@pytest.mark.parametrize("name", STAGES)
def test_each_solution_passes_its_check(name):
    found = judge_function(LESSONS[name], getattr(solutions, name), seed=3)
    assert found.passed, found.sentence


@pytest.mark.parametrize("name", [name for name in STAGES if name not in CONTRACT])
def test_every_typical_mistake_of_a_lesson_is_found_and_named(name):
    stage = LESSONS[name]
    for variant in stage.variants:
        found = judge_function(stage, variant.change(stage.reference), seed=2)
        assert not found.passed, variant.name
        assert variant.name in found.causes, (variant.name, found.sentence)


def test_with_its_functions_filled_in_it_arrives_at_the_twin(tmp_path, monkeypatch, capsys):
    said = run(with_functions(source(), solution_texts()), tmp_path, monkeypatch, capsys)
    assert said.count("PASS") == len(STAGES)
    assert "FAIL" not in said
    found = errors(said)
    assert found["intersect"] < 1e-6
    assert found["shade"] < 1e-6
    # Beyond: the sheet's shadow on the table, the sky that is cut by a horizon, and noise.
    assert found["shadow"] < 0.01
    assert found["sky"] < 0.02
    assert found["path"] < 0.03
    assert len(list((tmp_path / "walk").glob("*.png"))) == 7


def test_each_planted_mistake_is_said_in_words_and_the_walk_goes_on(tmp_path, monkeypatch, capsys):
    planted = {}
    for name, text in solution_texts().items():
        right, wrong, _ = MISTAKES[name]
        assert text.count(right) == 1, name
        planted[name] = text.replace(right, wrong)
    monkeypatch.setattr("raytwin.contract.check.repair_function", lambda *_: None)  # takes seconds for each
    said = run(with_functions(source(), planted), tmp_path, monkeypatch, capsys)
    for name, (_, _, words) in MISTAKES.items():
        line = next(line for line in said.splitlines() if line.startswith(f"FAIL  {name}:"))
        assert "no single common mistake" not in line
        assert words in line
    assert errors(said)["shade"] < 1e-6  # raytwin's own took their places


def test_a_function_that_is_still_empty_is_to_do_and_no_mistake(capsys):
    def shade(points, normals, albedo, to_light, irradiance, sky):
        """(N, 3): the radiance that each point sends back."""
        ...  # yours

    assert mine("shade", shade) is LESSONS["shade"].reference
    assert capsys.readouterr().out.startswith("TODO  shade: yours to write")
    assert mine("shade", lambda *a: None) is LESSONS["shade"].reference
    assert capsys.readouterr().out.startswith("FAIL  shade: it returned None")


def test_a_function_that_is_not_there_is_named():
    with pytest.raises(Exception, match="one of tag_centers"):
        with_functions(source(), {"detect": "def detect(): ..."})


def test_the_notebook_runs_from_its_first_cell_to_its_last(tmp_path, monkeypatch):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    path = write_walk(tmp_path, notebook=True, solved=True)
    book = nbformat.read(path, as_version=4)
    assert [cell.cell_type for cell in book.cells][:2] == ["markdown", "code"]
    nbclient.NotebookClient(
        book, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    ).execute()
    outputs = [output for cell in book.cells for output in cell.get("outputs", [])]
    assert not [output for output in outputs if output.output_type == "error"]
    widgets = [o for o in outputs if "application/vnd.jupyter.widget-view+json" in o.get("data", {})]
    assert len(widgets) == 7  # each stage's picture but the second's, in the reports' own viewer


def test_axe_core_finds_nothing_serious_in_what_a_cell_shows(tmp_path, chromium):
    """A wrong function's check, and two pictures in the viewer as a notebook mounts it."""
    pytest.importorskip("anywidget")
    check = judge_function(LESSONS["shade"], lambda *a: np.pi * solutions.shade(*a), seed=3)
    made = viewed("5 shade", *np.random.default_rng(1).random((2, 6, 8, 3), np.float32))
    cell = f"""<!DOCTYPE html><html lang="en"><title>a notebook</title><style>{made._css}</style>
    <main><h1>5. Shade</h1>{check._repr_html_()}<div id="cell"></div></main><script type="module">
    const module = new Blob([{json.dumps(made._esm)}], {{ type: "text/javascript" }});
    const {{ default: {{ render }} }} = await import(URL.createObjectURL(module));
    render({{ model: new Map([["data", {json.dumps(made.data)}]]), el: document.getElementById("cell") }});
    </script></html>"""
    (tmp_path / "cell.html").write_text(cell, encoding="utf-8")
    assert barriers_of(chromium, tmp_path / "cell.html") == []


def test_what_is_half_walked_is_not_overwritten(tmp_path):
    assert raytwin("walk", "-o", tmp_path).stdout.startswith("wrote ")
    (tmp_path / "walk.py").write_text("mine")
    refused(raytwin("walk", "-o", tmp_path), "walk.py", "a new file")
    assert (tmp_path / "walk.py").read_text() == "mine"
