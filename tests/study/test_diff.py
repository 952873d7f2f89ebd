"""`raytwin diff` as CI and a shell meet it."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import msgspec
import numpy as np
import OpenEXR
import pytest
from program import raytwin, refused
from scene_of import changed

from raytwin.compare import METRICS
from raytwin.compare.finding import Finding, notes
from raytwin.errors import InputError
from raytwin.explain.explanation import Cause, Explanation
from raytwin.images.exr import write_exr
from raytwin.images.image import Image
from raytwin.images.image_formats import write_image
from raytwin.images.photo_files import to_bytes, write_picture
from raytwin.renderers import references
from raytwin.show.terminal_text import diff_summary
from raytwin.study.diff_files import compare as diff
from raytwin.study.diff_files import told_apart
from raytwin.tracer import trace

ROOT = Path(__file__).resolve().parent.parent.parent
RNG = np.random.default_rng(21)
A = RNG.random((30, 40, 3)).astype(np.float32)


@pytest.fixture
def folder(tmp_path):
    """a; b, one pixel brighter; c, of another size; text, no image."""
    b = A.copy()
    b[3, 5, 1] += 0.5
    for name, pixels in (("a", A), ("b", b), ("c", A[:-1])):
        write_exr(tmp_path / f"{name}.exr", Image(pixels))
    (tmp_path / "text.exr").write_text("text")
    return tmp_path


def test_the_exit_code_is_the_verdict(folder):
    for arguments, code in (
        (("a.exr", "a.exr"), 0),
        (("a.exr", "b.exr"), 1),
        (("a.exr", "b.exr", "--tolerance", "1"), 0),
        (("a.exr", "c.exr", "--tolerance", "9"), 1),
        (("a.exr", "text.exr"), 2),
        (("a.exr", "none.exr"), 2),
        (("a.exr", "b.exr", "--tolerance", "-1"), 2),
        (("a.exr", "b.exr", "--layer", "diffuse"), 2),
    ):
        run = raytwin("diff", *arguments, cwd=folder)
        assert run.returncode == code, run.stdout + run.stderr
        if code == 2:
            refused(run)
        else:
            assert not run.stderr
            assert run.stdout.startswith(("FAIL" if code else "PASS") + f"  {arguments[0]} against {arguments[1]}")


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
        assert re.search(rf"^  {name} +{re.escape(f'{value:.6g}')} ", run.stdout, re.MULTILINE), name


def test_each_side_names_its_own_layer(folder):
    (folder / "many").mkdir()
    for k in range(4):
        passes = {"View.Combined": A, "View.DiffDir": A / 2 + RNG.normal(0, 1e-3, A.shape)}
        planes = {f"{name}.{c}": np.ascontiguousarray(x[..., i], np.float32)
                  for name, x in passes.items() for i, c in enumerate("RGB")}  # fmt: skip
        with OpenEXR.File({"type": OpenEXR.scanlineimage}, planes) as file:
            file.write(str(folder / "many" / f"{k}.exr"))
    blend, half = folder / "many" / "0.exr", folder / "half.exr"
    write_exr(half, Image(A / 2))
    assert diff(blend, folder / "a.exr").verdict == "pass"
    assert raytwin("diff", "many/0.exr:View.Combined", "a.exr", cwd=folder).returncode == 0
    assert diff(half, f"{blend}:View.DiffDir", tolerance=0.1).verdict == "pass"
    assert diff(f"{blend}:View.DiffDir", folder / "a.exr").verdict == "fail"
    assert diff(f"{blend.parent}:View.DiffDir", half).verdict == "pass"
    assert diff(f"{blend.parent}/*.exr:View.DiffDir", half).verdict == "pass"


def test_two_sides_of_one_name_are_told_apart(folder):
    """Files by the shortest paths that differ, functions as image and reference."""
    for place in ("new/x", "old/x"):
        (folder / place).mkdir(parents=True)
        write_exr(folder / place / "tracer.exr", Image(A))
    pair = "new/x/tracer.exr", "old/x/tracer.exr"
    run = raytwin("diff", *pair, "-o", "out", cwd=folder)
    assert run.stdout.startswith("PASS  new/x/tracer.exr against old/x/tracer.exr")
    page = (folder / "out" / "report.html").read_text()
    assert all(f"{side}: {path}" in page for side, path in zip("AB", pair, strict=True))
    assert "PASS  x/tracer.exr" in raytwin("diff", "new", "old", cwd=folder).stdout
    assert told_apart("a.exr", "x/a.exr") == ("a.exr", "x/a.exr")
    assert told_apart("a.exr", "./a.exr") == ("a.exr", "a.exr")
    assert told_apart("a.exr", "b.exr") == ("a.exr", "b.exr")

    def render(seed):
        return A

    found = diff(render, render)
    assert (found.a, found.b) == ("image", "reference")


def test_the_same_pixels_at_another_place_of_the_display_fail(tmp_path):
    for name, x in (("a", 0), ("b", 4)):
        window, display = ((x, 0), (x + 39, 29)), ((0, 0), (99, 99))
        both = {"dataWindow": window, "displayWindow": display}
        head = {key: tuple(np.array(corner, np.int32) for corner in box) for key, box in both.items()}
        with OpenEXR.File({"type": OpenEXR.scanlineimage, **head}, {"RGB": A}) as file:
            file.write(str(tmp_path / f"{name}.exr"))
    found = diff(tmp_path / "a.exr", tmp_path / "b.exr")
    assert found.verdict == "fail"
    assert found.comparison.reasons == ("A's pixels begin at (x=0, y=0) of the display window, B's at (x=4, y=0)",)
    assert diff(tmp_path / "b.exr", tmp_path / "b.exr").passed


def test_the_docs_have_every_metrics_formula():
    readme = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")
    for metric in METRICS.values():
        formula = metric.formula.replace("|", "\\|")
        assert f"| `{metric.name}` | {formula} | {metric.source} |" in readme


# ------------------------------------------------------------------------------------- what renderers leave behind


@pytest.fixture
def renders(tmp_path):
    """Folders of six renders each by seed: `a`, `b` alike, `dark` 3 % darker; nothing tells their noise."""
    rng = np.random.default_rng(5)
    for name, factor in (("a", 1.0), ("b", 1.0), ("dark", 0.97)):
        (tmp_path / name).mkdir()
        for seed in range(6):
            noisy = (0.2 + A * factor) * rng.normal(1, 0.05, A.shape)
            write_image(tmp_path / name / f"s{seed}.pfm", Image(noisy.astype(np.float32)))
    return tmp_path


def test_several_renders_of_a_side_tell_their_own_noise(renders):
    alike = diff(renders / "a" / "s*.pfm", renders / "b" / "s?.pfm")
    assert alike.passed
    assert (alike.test.batches, alike.test.samples) == (6, 0)
    assert diff(renders / "a", renders / "b" / "s1.pfm").test.batches == 6  # a folder
    assert diff(renders / "a" / "s*.pfm", renders / "b" / "s0.pfm", samples=(4, 4)).test.samples == 24
    assert diff(renders / "dark" / "s*.pfm", renders / "b" / "s?.pfm").comparison.verdict == "fail"
    with pytest.raises(InputError, match="at least 4"):
        diff(renders / "a" / "s[01].pfm", renders / "b" / "s0.pfm")
    with pytest.raises(InputError, match="none"):
        diff(renders / "a" / "x*.pfm", renders / "b" / "s0.pfm")


def test_variances_and_samples_of_either_side_can_be_given(tmp_path):
    rng = np.random.default_rng(6)
    for name, factor in (("a", 1.0), ("b", 1.0), ("dark", 0.97)):
        noisy = (0.2 + A * factor) * rng.normal(1, 0.05, A.shape)
        write_image(tmp_path / f"{name}.pfm", Image(noisy.astype(np.float32)))
    variance = np.square(0.05 * (0.2 + A))
    write_image(tmp_path / "v.pfm", Image(variance))
    a, b, v = (tmp_path / f"{n}.pfm" for n in "abv")
    found = diff(a, b, variances=(v, None), samples=(64, 64))
    assert found.passed
    assert found.settings["false-alarm rate"] == "0.001"
    np.testing.assert_array_equal(found.test.variance, variance)
    assert found.comparison.statistics.minimum_detectable_bias == pytest.approx(
        diff(a, b, variances=(v, v)).comparison.statistics.minimum_detectable_bias, rel=1e-3
    )
    assert diff(tmp_path / "dark.pfm", b, variances=(None, v), samples=(64, 64)).comparison.verdict == "fail"
    run = raytwin("diff", "a.pfm", "b.pfm", "--variance-a", "v.pfm", "--variance-b", "v.pfm", cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr


def test_an_undecided_comparison_exits_with_2_and_is_an_error_in_junit(tmp_path):
    rng = np.random.default_rng(7)
    for name in "ab":
        few = np.ones((24, 24, 3)) * rng.exponential(1, (24, 24, 3))
        write_image(tmp_path / f"{name}.pfm", Image(few.astype(np.float32)))
    run = raytwin("diff", "a.pfm", "b.pfm", "--junit", "x.xml", cwd=tmp_path)
    assert run.returncode == 2
    assert run.stdout.startswith("UNDECIDED  a.pfm against b.pfm")
    assert "the samples per pixel (--samples-a) or several renders" in run.stdout
    assert ET.parse(tmp_path / "x.xml").getroot().get("errors") == "1"
    assert raytwin("diff", "a.pfm", "b.pfm", "--detectable-bias", "9", cwd=tmp_path).returncode == 0


def test_two_folders_are_compared_name_by_name(tmp_path):
    for folder in ("A", "B"):
        for name in ("same.exr", "more/dark.exr", "bad.exr", f"only{folder}.exr"):
            path = tmp_path / folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            factor = 0.9 if (folder, name) == ("A", "more/dark.exr") else 1
            write_exr(path, Image((A * factor).astype(np.float32)))
    (tmp_path / "A" / "bad.exr").write_text("no image")
    run = raytwin("diff", "A", "B", "--json", "x.json", "--junit", "x.xml", "-o", "out", cwd=tmp_path)
    assert run.returncode == 1
    summed_up = "FAIL  5 pairs, 3 failed, 1 undecided or unreadable"
    for line in ("onlyA.exr is missing in B", "onlyB.exr is missing in A", summed_up):
        assert line in run.stdout
    numbers = json.loads((tmp_path / "x.json").read_text())
    verdicts = {name: pair.get("verdict", "error") for name, pair in numbers["pairs"].items()}
    expected = {"same.exr": "pass", "more/dark.exr": "fail", "bad.exr": "error"}
    assert (numbers["verdict"], verdicts) == ("fail", expected | {"onlyA.exr": "fail", "onlyB.exr": "fail"})
    root = ET.parse(tmp_path / "x.xml").getroot()
    assert [root.get(k) for k in ("tests", "failures", "errors")] == ["5", "3", "1"]
    assert (tmp_path / "out" / "index.html").exists()
    for name in ("onlyA.exr", "onlyB.exr", "bad.exr", "more/dark.exr"):
        for folder in "AB":
            (tmp_path / folder / name).unlink(missing_ok=True)
    assert raytwin("diff", "A", "B", cwd=tmp_path).returncode == 0


def test_a_side_of_8_bits_is_held_to_half_a_step_in_noise_and_without(tmp_path):
    rng = np.random.default_rng(9)
    noisy = np.clip(A * rng.normal(1, 2e-3, A.shape), 0, 1).astype(np.float32)
    write_picture(tmp_path / "a.png", to_bytes(noisy))
    write_exr(tmp_path / "b.exr", Image(A, np.square(2e-3 * A), 1024))
    write_image(tmp_path / "v.pfm", Image(np.square(2e-3 * A)))
    assert diff(tmp_path / "a.png", tmp_path / "b.exr", variances=(tmp_path / "v.pfm", None)).passed
    assert diff(tmp_path / "b.exr", tmp_path / "a.png", variances=(None, tmp_path / "v.pfm")).passed
    write_picture(tmp_path / "a.png", to_bytes(np.clip(1.03 * A, 0, 1)))
    assert diff(tmp_path / "a.png", tmp_path / "b.exr").comparison.verdict == "fail"


def test_a_scene_that_is_known_or_named_names_the_cause(tmp_path):
    known = references.load(references.SHIPPED / "overlap" / "shadow.exr")
    sun = msgspec.structs.replace(known.scene.sun, irradiance=tuple(np.multiply(np.pi, known.scene.sun.irradiance)))
    write_exr(tmp_path / "bright.exr", trace(changed(known.scene, lights=(sun, known.scene.sky))))
    found = diff(tmp_path / "bright.exr", known.path)
    assert found.comparison.cause.startswith("the sun's part is π times too bright")
    first = diff_summary(found).splitlines()[0]
    assert first == f"FAIL  bright.exr against shadow.exr: {found.comparison.cause} (likely)"
    write_exr(tmp_path / "shadow.exr", known.image)  # of no scene that it knows
    assert diff(tmp_path / "bright.exr", tmp_path / "shadow.exr").comparison.cause == ""
    write_image(tmp_path / "a.exr", Image(trace(known.origin(), "lambert").mean))
    images = "diff", tmp_path / "a.exr", tmp_path / "shadow.exr"
    assert "no cast shadows" not in raytwin(*images).stdout
    assert "no cast shadows" in raytwin(*images, "--scene", "overlap").stdout.splitlines()[0]
    refused(raytwin(*images, "--scene", "overlapp"), "did you mean overlap")
    refused(raytwin(*images, "--scene", "overlap", "--rung", "shadows"), "rung: expected one of")


def test_a_black_image_is_called_black_first(tmp_path):
    """However dark the reference is: its rounded values are black, too."""
    for scale, kind in ((3, "exr"), (1, "png"), (0.002, "exr"), (0.002, "png")):
        for name, pixels in (("black", 0 * A), ("reference", np.float32(scale / 3) * A)):
            write_image(tmp_path / f"{name}.{kind}", Image(pixels))
        found = diff(tmp_path / f"black.{kind}", tmp_path / f"reference.{kind}")
        assert found.reasons[0] == "cause (proved): the image is black everywhere", (scale, kind)
        assert not any(reason.startswith("or, ") for reason in found.reasons)
    grey = np.full(A.shape, 0.4, np.float32)
    assert diff(0 * grey, grey).cause == "the image is black everywhere"
    assert diff(0 * grey, 0 * grey).passed


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("change", "of_test", "of_reference"),
    [("x / (1 + x)", "png", "exr"), ("2", "png", "png"), ("red and blue", "exr", "png")],
)
def test_predictions_are_clipped_and_rounded_as_the_files_are(tmp_path, of_test, of_reference, change):
    y, x = np.mgrid[0:48, 0:64] / 64
    light = np.stack([0.02 + 0.6 * x, 0.05 + 0.6 * y, 0.1 + 0.3 * x * y], axis=-1).astype(np.float32)
    light[4:12, 20:28] = 18
    changed = {"x / (1 + x)": light / (1 + light), "2": 2 * light, "red and blue": light[..., ::-1]}[change]
    test, reference = tmp_path / f"test.{of_test}", tmp_path / f"reference.{of_reference}"
    write_image(test, Image(changed))
    write_image(reference, Image(light))
    found = diff(test, reference)
    assert change in found.cause or ("times too bright" in found.cause and change == "2")
    assert found.reasons[1] in [f"this explains {share} % of the squared error" for share in ("99.99", "100")]


def test_a_share_below_0_is_not_said():
    cause = Cause("x", "output", "x is wrong")
    made = Explanation("likely", (cause,), ("x is wrong",), "here", -7.6)
    assert made.findings == (Finding("likely", "x is wrong"), *notes(["here"]))


def test_a_render_that_returns_nothing_is_asked_for_its_return():
    for forgotten in (None, [None] * 4, lambda seed: None):
        with pytest.raises(InputError, match=r"^render returned None: is there a return\?$"):
            diff(forgotten, np.ones((4, 5, 3)))
