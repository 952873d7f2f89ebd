"""raytwin from Python: everything that can be an image, records that change, and what a notebook shows."""

import ast
import base64
import inspect
import io
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

import raytwin
from raytwin import twin
from raytwin.errors import InputError
from raytwin.scene.toml_json import json_text
from raytwin.show.viewer import widget

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "python.md"
VIEW = "application/vnd.jupyter.widget-view+json"
LESS = "repeats=3", "repeats=3, truth_samples=16"
"""What a test changes in the snippets: fewer samples of what errors are measured against."""
NOTEBOOK = PAGE.read_text("utf-8").partition("\n## Rays")[0].replace(*LESS)
CELLS = re.findall(r"^```python\n(.*?)^```$", NOTEBOOK, re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def known():
    return raytwin.reference("overlap", "shadow")


@pytest.fixture(scope="module")
def right(known):
    return raytwin.trace(known.scene).mean


def noisy(right: np.ndarray, seed: int) -> np.ndarray:
    return right + np.random.default_rng(seed).normal(0, 0.02, right.shape).astype(np.float32)


def test_mitsubas_images_are_compared_and_a_known_scene_names_the_cause(known, right):
    twin.activate()
    import mitsuba as mi

    for made in (mi.TensorXf, lambda x: mi.Bitmap(x).convert(srgb_gamma=True)):
        assert raytwin.compare(made(right), right).verdict == "pass"
        assert raytwin.compare(made(1.2 * right), right, tolerance=1e-4).verdict == "fail"
    wrong = raytwin.compare(1.2 * right, known)
    assert "1.2 times too bright" in wrong.cause
    assert wrong.cause in repr(wrong)
    assert raytwin.compare(1.2 * right, right, scene="overlap").cause == wrong.cause


def test_an_image_is_an_array_and_comes_from_one(right):
    image = raytwin.Image.from_array(right.tolist(), variance=right * 0 + 4e-4, samples=16)
    for made, expected in (
        (np.asarray(image), right),
        (np.asarray(image, np.float64), right.astype(np.float64)),
        (np.stack([image, right], axis=-1)[..., 0], right),
        (np.where(right > 0, image, 0), np.where(right > 0, right, 0)),
    ):
        assert made.dtype == expected.dtype
        assert np.array_equal(made, expected)
    assert repr(image) == f"<raytwin.Image 336 x 252, 16 samples, mean {right.mean():.4g}, noise 0.02>"


def opened_png(data: bytes):
    return Picture.open(io.BytesIO(data))


def test_a_notebook_keeps_pictures_and_shows_the_viewer_where_it_can(known, right, monkeypatch):
    image = raytwin.Image(right)
    assert opened_png(image._repr_mimebundle_()["image/png"]).size == (336, 252)
    found = raytwin.compare(right * np.float32(0.5), known)
    html = found._repr_html_()
    pictures = [opened_png(base64.b64decode(p)) for p in re.findall(r"base64,([^\"]+)", html)]
    assert [p.size for p in pictures] == [(336, 252)] * 3
    dark, reference = (np.asarray(p.convert("RGB"), float).mean() for p in pictures[:2])
    assert dark < 0.85 * reference  # one exposure for both
    assert "FAIL" in html
    assert found.cause in html
    wide = raytwin.Image(np.ones((30, 2000, 3), np.float32))
    assert opened_png(wide._repr_mimebundle_()["image/png"]).size == (400, 6)
    row = opened_png(found._repr_mimebundle_()["image/png"])
    assert row.size == (3 * 336 + 2 * 8, 252)
    assert np.array_equal(np.asarray(row)[:, 344:680], np.asarray(pictures[1]))
    monkeypatch.setattr(widget, "in_notebook", lambda: True)
    pytest.importorskip("anywidget")
    assert list(found._repr_mimebundle_()) == list(image._repr_mimebundle_()) == ["image/png", VIEW]


def test_a_scene_made_in_python_is_the_one_that_was_read():
    for name in ("distorted", "gloss", "studio"):
        read = raytwin.read_scene(name)
        made = raytwin.Scene(name, read.camera, read.spheres, read.planes, read.sun, read.sky, read.tolerance)
        assert raytwin.read_scene(made) == read


def test_a_scene_changes_by_with():
    scene = raytwin.read_scene("overlap")
    ball = scene.spheres[0]
    changed = scene.with_(spheres=[ball.with_(radius=np.float64(0.5), center=np.array([1, 2, 3]))], size=(40, 30))
    assert changed.spheres == (type(ball)((1, 2, 3), 0.5, ball.albedo),)
    assert raytwin.trace(changed, "shadow").shape == (30, 40, 3)
    for record, wrong, said in (
        (ball, {"radius": -1}, "Sphere.radius: expected metres > 0, got -1"),
        (ball, {"radus": 1}, "did you mean radius"),
        (scene, {"sun": 3}, "Scene.sun"),
        (scene, {"size": (0, 4)}, "K: expected focal lengths > 0 px, got 0"),
    ):
        with pytest.raises(InputError, match=said):
            record.with_(**wrong)


def test_records_are_plain_data_and_tables_lists_of_dicts(known, right):
    found = raytwin.compare(right, known)
    for record in (known.scene, known.scene.camera, found.comparison):
        assert json.loads(json.dumps(record.to_dict())) == json.loads(json_text(record))
    rows = raytwin.scenes()
    assert {"name", "shows", "folder"} == rows[0].keys()
    assert all("\n" not in row["shows"] and row["shows"][-1] not in ". " for row in rows)
    assert {"single", "overlap"} <= {row["name"] for row in rows}


def test_a_function_of_a_seed_is_a_subject_with_noise(right):
    def render(scene, seed):
        assert scene.name == "overlap"
        exact = raytwin.trace(scene, "shadow").mean
        return noisy(exact, 5 + seed)

    own = raytwin.method(render, records=True, renders=8)
    small = raytwin.read_scene("overlap").with_(size=(80, 60))
    assert own(small).variance is not None
    assert raytwin.compare_scene(small, subject=own).verdict == "pass"
    with pytest.raises(InputError, match="a function"):
        raytwin.method(3)


def test_every_exported_function_documents_each_parameter_and_its_errors():
    for name in raytwin.__all__:
        thing = raytwin._found(name)
        text = inspect.getdoc(thing) or ""
        assert len(text) > 25, name
        if inspect.isfunction(thing):
            missing = [p for p in inspect.signature(thing).parameters if not re.search(rf"\b{p}\b", text)]
            assert set(missing) <= {"progress"}, name
            assert re.search("InputError|StageFailed", text) or name == "scenes", name
    for package in ("compare", "bench"):
        assert callable(getattr(raytwin, package))
        assert inspect.signature(getattr(raytwin, package)) == inspect.signature(raytwin._found(package))


@pytest.fixture
def shell(tmp_path, monkeypatch):
    """IPython as a notebook's kernel has it, in this process."""
    interactiveshell = pytest.importorskip("IPython.core.interactiveshell")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for prompt in ("ps1", "ps2", "ps3"):  # IPython leaves them set
        monkeypatch.setattr(sys, prompt, "", raising=False)
    shell = interactiveshell.InteractiveShell.instance()
    shell.kernel = object()
    yield shell
    shell.history_manager.end_session()
    interactiveshell.InteractiveShell.clear_instance()


def test_the_snippets_of_the_tutorial_run_as_a_notebook(shell):
    pytest.importorskip("anywidget")
    from IPython.utils.capture import capture_output

    shown = []
    for code in CELLS:
        with capture_output() as captured:
            done = shell.run_cell(code)
        done.raise_error()
        assert (done.result is not None) == isinstance(ast.parse(code).body[-1], ast.Expr), code
        shown.append([one.data for one in captured.outputs])
        if done.result is not None and not captured.outputs:
            shown[-1].append(shell.display_formatter.format(done.result)[0])
    kinds = [[set(data) - {"text/plain"} for data in one] for one in shown]
    html, png = "text/html", "image/png"
    # compare, an image, a subject, Bitmap, eight renders: pictures that stay, then the viewer
    assert all(kinds[k] == [{html, png}, {VIEW}] for k in (1, 2, 5, 9, 10))
    assert kinds[6] == kinds[7] == kinds[8] == [{html}]  # two benches and light levels: a table
    said = [one[0]["text/plain"] for one in shown if one]
    assert "too dark by a factor of 1.111" in said[0]
    assert "PASS" in said[-1]
    assert "PASS" in said[-2]
