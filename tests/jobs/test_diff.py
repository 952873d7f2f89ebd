"""`raytwin diff` as CI and a shell meet it."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from program import raytwin

from raytwin import files
from raytwin.compare import METRICS
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.jobs.diff import diff

ROOT = Path(__file__).resolve().parent.parent.parent
RNG = np.random.default_rng(21)
A = RNG.random((30, 40, 3)).astype(np.float32)


@pytest.fixture
def folder(tmp_path):
    """a; b, one pixel brighter; c, of another size; text, no image."""
    b = A.copy()
    b[3, 5, 1] += 0.5
    for name, pixels in (("a", A), ("b", b), ("c", A[:-1])):
        files.write_exr(tmp_path / f"{name}.exr", Image(pixels))
    (tmp_path / "text.exr").write_text("text")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("a.exr", "a.exr"), 0),
        (("a.exr", "b.exr"), 1),
        (("a.exr", "b.exr", "--tolerance", "1"), 0),
        (("a.exr", "b.exr", "--fail", "0.6"), 0),
        (("a.exr", "b.exr", "--fail", "0.1", "--fail-percent", "0.1"), 0),
        (("a.exr", "b.exr", "--fail", "0.1", "--failpercent", "0.05"), 1),
        (("a.exr", "b.exr", "--failpercent", "1", "--hardfail", "0.4"), 1),
        (("a.exr", "b.exr", "--warn", "0.1", "--fail", "0.6"), 0),
        (("a.exr", "c.exr", "--fail", "9"), 1),
        (("a.exr", "text.exr"), 2),
        (("a.exr", "none.exr"), 2),
        (("a.exr", "b.exr", "--fail", "-1"), 2),
        (("a.exr", "b.exr", "--layer", "diffuse"), 2),
    ],
)
def test_the_exit_code_is_the_verdict(folder, arguments, code):
    run = raytwin("diff", *arguments, cwd=folder)
    assert run.returncode == code, run.stdout + run.stderr
    if code == 2:
        assert run.stderr.startswith("raytwin: ")
        assert run.stderr.count("\n") == 1
        assert not run.stdout
    else:
        assert not run.stderr
        assert run.stdout.startswith(("FAIL" if code else "PASS") + f"  {arguments[0]} against {arguments[1]}")
    assert ("warning: 1 pixel of 1200" in run.stdout) == ("--warn" in arguments)


def test_json_junit_report_and_heat_map_are_written(folder):
    run = raytwin("diff", "a.exr", "b.exr", "--json", "x.json", "--junit", "x.xml", "-o", "out", "--flip", cwd=folder)
    assert run.returncode == 1
    numbers = json.loads((folder / "x.json").read_text())
    assert numbers == json.loads((folder / "out" / "comparison.json").read_text())
    assert numbers["verdict"] == "fail"
    assert numbers["metrics"]["max_abs"] == pytest.approx(0.5)
    assert 0 < numbers["metrics"]["flip_hdr"] < 1
    assert None not in numbers["metrics"].values()
    case = ET.parse(folder / "x.xml").getroot().find("testsuite/testcase")
    assert case.find("failure").get("message") == numbers["reasons"][0]
    assert {p.name for p in (folder / "out").iterdir()} == {"report.html", "heatmap.png", "comparison.json"}
    for name, value in numbers["metrics"].items():
        assert f"  {name:<10} {value:.6g}" in run.stdout


def test_a_file_that_cannot_be_read_is_an_error_in_junit(folder):
    run = raytwin("diff", "text.exr", "a.exr", "--junit", "x.xml", cwd=folder)
    assert run.returncode == 2
    root = ET.parse(folder / "x.xml").getroot()
    assert (root.get("errors"), root.get("failures")) == ("1", "0")
    assert "text.exr: expected an image" in root.find("testsuite/testcase/error").get("message")


def test_every_kind_of_image_can_be_one_of_the_two(folder):
    codes = files.to_bytes(A)
    files.write_picture(folder / "x.png", codes)
    for name in ("x.exr", "x.pfm"):
        files.write_image(folder / name, Image(files.from_bytes(codes)))
        assert diff(folder / name, folder / "x.png").passed
        assert diff(folder / "x.png", folder / name).passed


def test_two_noisy_images_of_one_scene_pass_and_a_darker_one_fails(tmp_path):
    variance = np.full_like(A, 1e-4)
    for name, scale in (("a", 1.0), ("b", 1.0), ("dark", 0.97)):
        noisy = (A * scale + RNG.normal(0, 1e-2, A.shape)).astype(np.float32) + 0.1
        files.write_exr(tmp_path / f"{name}.exr", Image(noisy, variance, 64))
    assert diff(tmp_path / "a.exr", tmp_path / "b.exr").passed
    found = diff(tmp_path / "dark.exr", tmp_path / "b.exr")
    assert not found.passed
    assert "too dark" in found.comparison.reasons[0]
    assert found.settings["false-alarm rate"] == "0.001"


def test_the_same_pixels_at_another_place_of_the_display_fail(tmp_path):
    import OpenEXR

    for name, x in (("a", 0), ("b", 4)):
        window = (np.array([x, 0], np.int32), np.array([x + 39, 29], np.int32))
        display = (np.array([0, 0], np.int32), np.array([99, 99], np.int32))
        head = {"type": OpenEXR.scanlineimage, "dataWindow": window, "displayWindow": display}
        with OpenEXR.File(head, {"RGB": A}) as file:
            file.write(str(tmp_path / f"{name}.exr"))
    found = diff(tmp_path / "a.exr", tmp_path / "b.exr")
    assert not found.passed
    assert found.comparison.reasons == ("A's pixels begin at (x=0, y=0) of the display window, B's at (x=4, y=0)",)
    assert diff(tmp_path / "b.exr", tmp_path / "b.exr").passed


def test_wrong_numbers_are_refused(folder):
    for options in ({"tolerance": 0}, {"tolerance": float("nan")}, {"false_alarm_rate": 2}):
        with pytest.raises(InputError):
            diff(folder / "a.exr", folder / "b.exr", **options)


def test_the_readme_has_every_metrics_formula_and_every_option():
    readme = (ROOT / "tests" / "README.md").read_text(encoding="utf-8")
    for metric in METRICS.values():
        formula = metric.formula.replace("|", "\\|")
        assert f"| `{metric.name}` | {formula} | {metric.source} |" in readme
    told = raytwin("diff", "--help").stdout
    for option in ("--fail", "--failrelative", "--failpercent", "--allowfailures", "--hardfail", "--warn"):
        assert option in readme
        assert option in told
