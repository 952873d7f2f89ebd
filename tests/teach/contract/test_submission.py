"""What students hand in: whatever it is, functions by the names of the contract; or a line that says what is wrong."""

import json
import sys

import numpy as np
import pytest

from raytwin.errors import InputError
from raytwin.explain.diagnosis import explain
from raytwin.fast import trace
from raytwin.images.image import Image
from raytwin.images.image_formats import write_image
from raytwin.photos.find_camera import find_camera
from raytwin.teach.contract.ipython_syntax import as_python
from raytwin.teach.contract.subject import find_subject
from raytwin.teach.contract.submission import load

SHADE = """
from dataclasses import dataclass
import numpy as np

@dataclass
class Light:
    to_light: np.ndarray
    irradiance: np.ndarray

def shade(points, normals, albedo, to_light, irradiance, sky):
    light = Light(to_light, irradiance)
    return albedo * (np.maximum(0, normals @ light.to_light)[:, None] * light.irradiance / np.pi + sky)
"""


def notebook(*cells: str) -> str:
    made = [{"cell_type": "code", "source": text.splitlines(keepends=True)} for text in cells]
    return json.dumps({"nbformat": 4, "cells": [{"cell_type": "markdown", "source": ["# Mine"]}, *made]})


def test_a_file_of_python_gives_the_stages_that_it_writes_in_the_contracts_order(tmp_path):
    unwritten = 'def hit_points(scene):\n    """The points."""\n    raise NotImplementedError\n'
    (tmp_path / "mine.py").write_text(f"{unwritten}def render(scene): return helper\n{SHADE}def helper(): pass\n")
    made = load(tmp_path / "mine.py")
    assert list(made.stages) == ["shade", "render"]
    assert made.stage("shade").__name__ == "shade"


def test_a_files_neighbours_can_be_imported_and_two_files_of_one_name_are_two_modules(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"beside_{name}.py").write_text(f"NAME = {name!r}\n")
        (tmp_path / name / "tracer.py").write_text(f"from beside_{name} import NAME\ndef render(scene): return NAME\n")
    a, b = load(tmp_path / "a" / "tracer.py"), load(tmp_path / "b" / "tracer.py")
    assert (a.stages["render"]({}), b.stages["render"]({})) == ("a", "b")


def test_a_notebook_is_run_cell_by_cell_without_its_magics_and_what_fails_costs_nothing_else(tmp_path):
    cells = (
        "%matplotlib inline\n!pip install numpy\nimport numpy as np\ndisplay(np.pi)",
        "%%bash\nrm -rf everything",
        "from __future__ import annotations\nimport no_such_plots\nimport math\ndef render(scene: Unknown):\n"
        "    return math.pi",
        "render(None) +",
    )
    (tmp_path / "mine.ipynb").write_text(notebook(*cells))
    made = load(tmp_path / "mine.ipynb")
    assert made.stages["render"](None) == np.pi
    assert len(made.notes) == 2
    assert made.notes[0] == "cell 4: ModuleNotFoundError: No module named 'no_such_plots' (line 2)"
    assert made.notes[1].startswith("cell 5: SyntaxError")


def test_what_only_ipython_understands_is_taken_out_of_a_cell_and_nothing_else():
    for cell, plain in (
        ("%%time\nx = 1", "pass\nx = 1"),
        ("\n%%capture out\nx = 1", "\npass\nx = 1"),
        ("np.cross?\nx = 2", "pass\nx = 2"),
        ("?np.cross", "pass"),
        ("if x:\n    !ls -l\ny = 3", "if x:\n    pass\ny = 3"),
        ("names = !ls\ny = 2", "names = None\ny = 2"),
        ("%time y = f(3)", "y = f(3)"),
        ("!pip install a \\\n  b\nx = 1", "pass\n\nx = 1"),
        ("%%bash\nls", ""),
        ("%%html\n<b>", ""),
        ("x = (7\n% 3)", "x = (7\n% 3)"),
        ("x = '''\n!no\n%no\nno?\n'''", "x = '''\n!no\n%no\nno?\n'''"),
        ("def f(:\n", "def f(:\n"),
    ):
        assert as_python(cell) == plain, cell


def test_what_cannot_be_run_is_told_in_one_line(tmp_path):
    for name, text, said in (
        ("a.py", "def render(scene)\n", r"a\.py: expected Python, got SyntaxError: expected ':' \(line 1: def render"),
        ("a.py", "x = 1\n", "expected a function of back_project, .*, render, got none"),
        ("a.py", "import numpy\n1 / 0\n", r"that can be imported, got ZeroDivisionError: division by zero \(line 2\)"),
        ("a.py", "exit(3)\n", r"that can be imported, got exit\(3\)"),
        ("a.py", b"\xff\xfe", "expected UTF-8 text, got byte 0xff at 0"),
        ("a.ipynb", "{}", r"expected a notebook \(JSON, version 4\)"),
        ("a.ipynb", notebook("import nothing_at_all"), "got none; cell 2: ModuleNotFoundError"),
        ("a.py", "def shade(points, normals): pass\n", r"called as shade\(points, .*, got shade\(points, normals\)"),
        ("a.py", "def hit_points(scene): pass\n", r"a\.py: render: expected a function, got nothing of that name"),
    ):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        with pytest.raises(InputError, match=said):
            load(path).picture()


def test_without_a_render_the_picture_is_our_tracers_with_the_students_stages_in_it(tmp_path, single):
    (tmp_path / "mine.py").write_text(SHADE.replace("/ np.pi", ""))
    small = single.with_camera(single.camera.resized(32, 24))
    subject = find_subject(str(tmp_path / "mine.py"), "lambert")
    assert subject.name == f"{tmp_path / 'mine.py'} (render is made of its shade, the rest is ours)"
    sky, E, albedo = small.sky.radiance[0], small.sun.irradiance[0], small.spheres[0].albedo[0]
    middle = subject(small).mean[11:13, 15:17, 0].mean()
    assert middle == pytest.approx(albedo * (E + sky), rel=0.02)  # head on, without pi: as it was handed in


def test_an_image_may_be_of_a_scene_that_no_function_is_told_of_and_what_is_wrong_with_it_is_said(tmp_path):
    scene = find_camera("scenes/gloss")[0]
    small = scene.with_camera(scene.camera.resized(32, 24))
    right = trace(small, "shadow", "numpy64")
    write_image(tmp_path / "mine.exr", Image(right.mean ** np.float32(1 / 2.2)))
    subject = find_subject(str(tmp_path / "mine.exr"), "shadow")
    assert "gamma" in " ".join(f.text for f in explain(subject(small), right, small))


def test_a_programs_words_may_be_quoted_and_it_is_told_where_to_look(tmp_path, single):
    (tmp_path / "my program.py").write_text(
        "import json, sys, struct\n"
        "scene = json.load(open(sys.argv[1]))\n"
        "w, h, eye = scene['width'], scene['height'], scene['camera']['eye']\n"
        "open(sys.argv[2], 'wb').write(b'PF\\n%d %d\\n-1\\n' % (w, h) + struct.pack('<3f', *eye) * (w * h))\n"
    )
    small = single.with_camera(single.camera.resized(8, 6))
    subject = find_subject(f"{sys.executable} '{tmp_path / 'my program.py'}' {{scene}} {{out}}.pfm", "lambert")
    np.testing.assert_allclose(subject(small).mean[0, 0], small.camera.eye, rtol=1e-6)
