"""The walk as a learner takes it: a script with its functions filled in, or with mistakes in them, and a notebook."""

import re
import sys

import numpy as np
import pytest
from PIL import Image
from program import raytwin, refused

from raytwin.photos.camera import detect_photos
from raytwin.show.notebook_page import Pictures
from raytwin.show.walk_cell import mine, show
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.walk import write_walk
from raytwin.teach.walk.desk import Desk

pytestmark = pytest.mark.nightly


def test_with_raytwins_own_functions_it_arrives_at_the_twin(tmp_path, monkeypatch, capsys):
    """As a notebook, cell by cell, in this process; its empty functions are lent, but for one that is written."""
    shells = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell
    nbformat = pytest.importorskip("nbformat")
    book = nbformat.read(write_walk(tmp_path, notebook=True), as_version=4)
    assert [cell.cell_type for cell in book.cells][:2] == ["markdown", "code"]
    written = "return albedo / np.pi * irradiance * np.maximum(0, normals @ to_light)[:, None] + albedo * sky"
    shade = next(cell for cell in book.cells if "def shade(" in cell.source)
    shade.source = shade.source.replace("...  # yours", written)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    monkeypatch.setitem(mine.__globals__, "in_notebook", lambda: True)
    for prompt in ("ps1", "ps2", "ps3"):
        monkeypatch.setattr(sys, prompt, "", raising=False)
    shell = shells.instance()
    try:
        done = [shell.run_cell(cell.source) for cell in book.cells if cell.cell_type == "code"]
    finally:
        shells.clear_instance()
    assert all(one.success for one in done), [one.error_before_exec or one.error_in_exec for one in done]
    shown = [one.result for one in done if isinstance(one.result, Pictures)]
    assert len(shown) == 7  # each stage's picture but the second's
    assert all(one._repr_mimebundle_()["image/png"].startswith(b"\x89PNG") for one in shown)
    said = capsys.readouterr().out
    assert (said.count("PASS"), said.count("TODO"), said.count("FAIL")) == (1, 7, 0)
    found = {name: float(x) for name, x in re.findall(r"^\d (\w+): RMSE (\S+) beside the twin", said, re.MULTILINE)}
    # In the last: the sheet's shadow on the table, the sky that is cut by a horizon, and noise.
    limits = {"intersect": 1e-6, "shade": 1e-6, "shadow": 0.01, "sky": 0.02, "path": 0.03}
    assert all(found[name] < limit for name, limit in limits.items()), found


def test_a_script_puts_two_pictures_beside_each_other_in_a_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    show("5 shade", np.zeros((6, 8, 3)), np.full((6, 8, 3), 0.5))
    assert capsys.readouterr().out == "5 shade: RMSE 0.5 beside the twin, walk/5-shade.png\n"
    written = np.asarray(Image.open(tmp_path / "walk" / "5-shade.png"))
    assert written.shape == (6, 24, 3)
    assert written[0, [0, 12, 20]].tolist() == [[0, 0, 0], [255, 255, 255], [188, 188, 188]]


def test_a_function_that_is_still_empty_is_to_do_and_no_mistake(capsys, monkeypatch):
    monkeypatch.delattr(sys, "ps1", raising=False)  # as a script, which prints what it found

    def shade(points, normals, albedo, to_light, irradiance, sky):
        """(N, 3): the radiance that each point sends back."""
        ...  # yours

    assert mine("shade", shade) is LESSONS["shade"].reference
    assert capsys.readouterr().out.startswith("TODO  shade: yours to write")
    assert mine("shade", lambda *a: None) is LESSONS["shade"].reference
    assert capsys.readouterr().out.startswith("FAIL  shade: it returned None")


def test_what_is_half_walked_is_not_overwritten(tmp_path):
    assert raytwin("walk", "-o", tmp_path).stdout.startswith("wrote ")
    (tmp_path / "walk.py").write_text("mine")
    refused(raytwin("walk", "-o", tmp_path), "walk.py", "a new file")
    assert (tmp_path / "walk.py").read_text() == "mine"


def test_the_lessons_corners_are_half_a_pixel_off_opencvs(scenes):
    desk = Desk(scenes / "desk")
    found, _ = detect_photos([scenes / "desk" / "photos" / desk.photo_name], desk.board.family)
    tags = next(iter(found.values()))
    assert desk.corners == pytest.approx(np.array([tag.corners for tag in tags]) + 0.5)
    given = []
    desk.homographies(lambda corners: given.append(corners) or corners.mean(axis=1))
    expected = np.array([tag.corners for tag in tags if tag.id in desk.board.centers()]) + 0.5
    assert any(corners.shape == expected.shape and np.allclose(corners, expected, atol=1e-6) for corners in given)
