"""The pytest plugin as its users meet it: small test files, run by a pytest of their own."""

import re
import shlex
import subprocess
import sys

import pytest
from program import raytwin, refused

from raytwin.images.exr import read_exr
from raytwin.renderers import references
from raytwin.show import check_page

nightly = pytest.mark.nightly

pytest_plugins = ["pytester"]
SHIPPED = references.SHIPPED


# To look for causes takes longest: one test reads them.
HEAD = """
import numpy as np
import pytest

@pytest.fixture(autouse=True)
def few_causes(request, monkeypatch):
    if "array" not in request.node.name:
        monkeypatch.setattr("raytwin.explain.diagnosis.explain", lambda *_, **__: ())
"""


def run(folder, *options: str, **sources: str) -> pytest.RunResult:
    """Write test files into `folder` by name, and run pytest there."""
    for name, source in sources.items():
        (folder / f"{name}.py").write_text(HEAD + source)
    known = "-W", "error", "--strict-markers", "--continue-on-collection-errors"
    command = [sys.executable, "-m", "pytest", *known, *options]
    done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return pytest.RunResult(done.returncode, done.stdout.splitlines(), [], 0.0)


def failures(result: pytest.RunResult) -> dict[str, str]:
    """The first line that each failed test says, by its name."""
    lines = re.findall(r"^FAILED \S+::(\S+) - (.*)$", "\n".join(result.outlines), re.MULTILINE)
    return dict(lines)


# ------------------------------------------------------------------------------------------ each feature once

EACH_ONCE = """
def test_shipped(raytwin_reference):
    shadow = raytwin_reference("overlap", "shadow")
    shadow.check(shadow.image.mean * 1.01)

def test_image(raytwin_reference):
    raytwin_reference("mine", "path", image=True).check(np.full((6, 8, 3), 0.5))

def test_laws(raytwin_laws):
    raytwin_laws(lambda scene: np.zeros((1, 1, 3)))
"""


def test_one_run_checks_updates_judges_by_laws_and_reports(tmp_path):
    result = run(tmp_path, "--raytwin-update", "--raytwin-report", "out", test_each=EACH_ONCE)
    result.assert_outcomes(passed=1, failed=2)
    result.stdout.fnmatch_lines_random(
        [
            "E * overlap/shadow: *",
            "E * <lambda>: expected an image (108, 144, 3), got float64 (1, 1, 3)",
            "raytwin: made reference/mine/path.exr",
            f"raytwin: 3 comparisons, 2 failed: {tmp_path}/out/index.html",
        ]
    )
    assert read_exr(tmp_path / "reference/mine/path.exr")[0].mean == pytest.approx(0.5)
    index = (tmp_path / "out/index.html").read_text()
    assert re.findall(r"[✓✗!] (pass|fail|error)<", index) == ["error", "fail", "pass"]


# ------------------------------------------------------------------------------------------ what may be checked

AGREE = """
import raytwin

def noisy(held, factor=1.0):
    # Exponential noise: never negative, as radiance.
    return lambda seed: factor * held.image.mean * (
        1 + 0.2 * (np.random.default_rng(seed).exponential(size=held.image.shape) - 1))

@pytest.fixture
def shadow(raytwin_reference):
    return raytwin_reference("overlap")

@pytest.fixture
def path(raytwin_reference):
    return raytwin_reference("overlap", "path")

FACTORS = pytest.mark.parametrize("factor", [1.0, 1.01])

@FACTORS
def test_array(shadow, factor):
    shadow.check(shadow.image.mean * factor)

@FACTORS
def test_file(shadow, tmp_path, factor):
    raytwin.write_image(tmp_path / "a.png", raytwin.Image((shadow.image.mean * factor**2).astype("f4")))
    shadow.check(tmp_path / "a.png")

@FACTORS
def test_variance(path, factor):
    made = np.array([noisy(path, factor)(seed) for seed in range(16)])
    path.check(made.mean(0), variance=made.var(0, ddof=1) / 16)

@FACTORS
def test_function(path, factor):
    path.check(noisy(path, factor), renders=8)

def test_compare_does_not_fail(shadow):
    assert shadow.compare(2 * shadow.image.mean).verdict == "fail"
    given = shadow.scene_dict  # what --subject FILE.py:FUNCTION gets
    assert (given["height"], given["width"], given["rung"]) == (*shadow.image.shape[:2], "shadow")
    assert given["K"].shape == (3, 3) and len(given["spheres"]) == len(shadow.scene.spheres)

def test_mitsuba_file(raytwin_reference):
    reference = raytwin_reference("glass", "path")
    reference.check(reference.image)
    assert not reference.reference.golden
"""

NO_IMAGE = """
@pytest.mark.parametrize("thing", [
    "nosuch.png", "test_no_image.py", np.zeros((252, 336)), [np.zeros((252, 336, 3))] * 3, None])
def test_thing(raytwin_reference, thing):
    raytwin_reference("overlap").check(thing)

def test_nan(raytwin_reference):
    held = raytwin_reference("overlap")
    broken = held.image.mean.copy()
    broken[7, 5] = np.nan
    held.check(broken)

def test_noise_untold(raytwin_reference):
    held = raytwin_reference("overlap", "path")
    held.check(1.3 * held.image.mean * (0.8 + 0.2 * np.random.default_rng(1).exponential(size=held.image.shape)))

def test_missing(raytwin_reference):
    raytwin_reference("nosuch", "sky")

def test_no_rung(raytwin_reference):
    raytwin_reference("ball", "sun")
"""

MANY = """
@pytest.mark.parametrize("scene", ["overlap", "single"])
@pytest.mark.parametrize("rung", ["shadow", "lambert"])
def test_cases(raytwin_reference, scene, rung):
    held = raytwin_reference(scene, rung)
    held.check(held.image.mean * (1.1 if rung == "lambert" else 1))

def test_missing(raytwin_reference):
    raytwin_reference("nosuch")

def test_twice(raytwin_reference):
    held = raytwin_reference("overlap")
    held.check(held.image.mean)
    held.check(held.image.mean[:100])

def test_crash(raytwin_reference):
    raytwin_reference("overlap")
    raise ValueError("my renderer <b>broke</b>")
"""


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """One run of many tests that are not of one's own references."""
    folder = tmp_path_factory.mktemp("checked")
    sources = {"agree": AGREE, "no_image": NO_IMAGE}
    return folder, run(folder, **{f"test_{name}": source for name, source in sources.items()})


@nightly
def test_arrays_files_renders_and_functions_pass_where_they_agree_and_fail_where_not(checked):
    _, result = checked
    expected = {f"test_{case}[1.01]" for case in ("array", "file", "variance", "function")}
    others = {"test_nan", "test_noise_untold", "test_missing", "test_no_rung"}
    others |= {name for name in failures(result) if name.startswith("test_thing[")}
    assert failures(result).keys() - others == expected
    result.assert_outcomes(passed=len(expected) + 2, failed=len(expected) + 9)
    cause = "the whole image, background too, is 1.01 times too bright"
    result.stdout.fnmatch_lines([f"*overlap/shadow: {cause}*"])
    result.stdout.no_fnmatch_line("*cause (*")


@nightly
def test_what_is_wrong_is_said_in_a_line(checked):
    folder, result = checked
    for line in (
        "*nosuch.png: expected an image file, got no such file",
        "*test_no_image.py: expected an image: EXR, PFM, PNG, JPEG, PPM, TIFF, BMP or WebP*",
        "*the test image has the shape (252, 336), not (height, width, 3)",
        "*repeated renders: expected at least 4, got 3",
        "*overlap/shadow: render returned None: is there a return?",
        "*NaN value*(x=5, y=7)*",
        "*note: the reference has noise and the image tells none*variance=*",
        f"*no such reference in {folder}/reference/nosuch/sky.exr or *reference/nosuch/sky.exr",
        "*raytwin reference make scenes/nosuch --rung sky",
        "*rung: expected one of surface, lambert, shadow, sky, path, got sun",
    ):
        result.stdout.fnmatch_lines([line])
    for line in ("*pytest_plugin.py:*", "*reference_check.py:*", "*During handling*", "*INTERNALERROR*"):
        result.stdout.no_fnmatch_line(line)


# ------------------------------------------------------------------------------------------ missing, stale, updated

SCENE = """
[camera]
image_size = [40, 30]
K = [[50.0, 0.0, 19.5], [0.0, 50.0, 14.5], [0.0, 0.0, 1.0]]
R_cam_board = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
t_cam_board = [0.0, 0.0, 0.45]

[[spheres]]
center = [0.0, 0.0, 0.05]
radius = 0.05

[sun]
to_light = [0.4, 0.0, 1.0]
"""

OWN = """
from pathlib import Path

# A scene of one's own is not held to the shipped one of its name.
@pytest.mark.parametrize("name", ["ball", "overlap"])
def test_traced(raytwin_reference, name):
    from raytwin.fast import trace
    held = raytwin_reference(name, "shadow")
    assert held.camera.image_size == (40, 30)
    held.check(trace(held.scene, "shadow"))

def test_image(raytwin_reference):
    raytwin_reference("mine", "path", image=True).check(np.full((6, 8, 3), float(Path("value").read_text())))

def test_broken(raytwin_reference):
    raytwin_reference("broken", "path", image=True).check(np.full((6, 8, 3), np.nan))

def test_mistyped(raytwin_reference):
    raytwin_reference("overlpa", "shadow").check(np.full((6, 8, 3), 0.5))

@pytest.mark.parametrize(("name", "rung"), [("single", "shadow"), ("glass", "path")])
def test_shipped(raytwin_reference, name, rung):
    held = raytwin_reference(name, rung)
    held.check(0.9 * held.image.mean)
"""
NEVER = {"test_broken", "test_mistyped", "test_shipped[single-shadow]", "test_shipped[glass-path]"}


@nightly
def test_update_makes_what_is_missing_or_stale_of_ones_own_and_nothing_else(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\nraytwin_references = my/images\nraytwin_scenes = my/scenes\n")
    for name in ("ball", "overlap"):
        (tmp_path / "my/scenes" / name).mkdir(parents=True)
        (tmp_path / "my/scenes" / name / "scene.toml").write_text(SCENE)
    (tmp_path / "value").write_text("0.5")
    before = {f: f.stat().st_mtime_ns for f in SHIPPED.glob("*/*.exr")}

    def failed(*options: str, **sources: str) -> tuple[pytest.RunResult, set[str]]:
        result = run(tmp_path, *options, **sources)
        return result, failures(result).keys() - NEVER if failures(result).keys() >= NEVER else {"none of NEVER"}

    mine, traced = {"test_image"}, {"test_traced[ball]", "test_traced[overlap]"}
    result, names = failed(test_it=OWN)
    assert names == mine | traced
    command = "raytwin reference make my/scenes/ball --rung shadow --folder my/images"
    assert any(line.endswith(f"To make it: {command}") for line in result.outlines)
    result, names = failed("--raytwin-update")
    assert not names
    for said in (
        "*no reference can be made of this image*NaN*",
        "*There: ball, *overlap, *single*",
        "*'overlpa', *image=True*",
    ):
        result.stdout.fnmatch_lines([said])
    (tmp_path / "my/scenes/ball/scene.toml").write_text(SCENE.replace("radius = 0.05", "radius = 0.04"))
    (tmp_path / "value").write_text("0.6")
    result, names = failed()
    assert names == {*mine, "test_traced[ball]"}
    result.stdout.fnmatch_lines(["*stale: the scene has changed since*"])
    assert not failed("--raytwin-update")[1]
    assert {f.parent.name for f in tmp_path.glob("my/images/*/*.exr")} == {"ball", "overlap", "mine"}
    assert {f: f.stat().st_mtime_ns for f in SHIPPED.glob("*/*.exr")} == before


TWO_NAMED_ALIKE = """
@pytest.mark.parametrize("value", [0.5, 0.7])
def test_other(raytwin_reference, value):
    raytwin_reference("mine", "path", image=True).check(np.full((6, 8, 3), value))

@pytest.mark.parametrize("value", [0.5, 0.5000001])
def test_same(raytwin_reference, value):
    raytwin_reference("alike", "path", image=True).check(np.full((6, 8, 3), value))
"""


@nightly
def test_an_update_fails_two_other_images_of_one_name_and_names_both_tests(tmp_path):
    for _ in range(2):  # without a reference, then with one
        result = run(tmp_path, "--raytwin-update", test_two=TWO_NAMED_ALIKE)
        assert failures(result).keys() == {"test_other[0.7]"}
        maker = "the test test_two.py::test_other[[]0.5]"
        result.stdout.fnmatch_lines([f"*note: this run made the reference from the image of {maker}: two images*"])
        assert read_exr(tmp_path / "reference/mine/path.exr")[0].mean.max() == pytest.approx(0.5)


# ------------------------------------------------------------------------------------------ many at once


@nightly
def test_report_lists_every_comparison_once_failures_first(tmp_path):
    """By two workers, of which neither may clear or write what the other has."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "check-of-an-earlier-run.json").write_text("{}")
    (out / "notes.txt").write_text("not ours")
    result = run(tmp_path, "--raytwin-report", "out", "-n", "2", test_many=MANY)
    result.assert_outcomes(passed=2, failed=5)
    result.stdout.fnmatch_lines([f"raytwin: 8 comparisons, 5 failed: {out}/index.html"])
    index = (out / "index.html").read_text()
    verdicts = re.findall(r"[✓✗] (pass|fail)<", index)
    assert verdicts == ["fail"] * 4 + ["pass"] * 3
    assert "! error<" in index
    assert "ValueError: my renderer &lt;b&gt;broke&lt;/b&gt;" in index
    pages = re.findall(r'<a href="([^"]+)"', index)
    assert len(set(pages)) == 6
    for page in pages:
        text = (out / page).read_text()
        assert "http" not in re.sub(r"http://www\.w3\.org/\S+|<script.*?</script>", "", text, flags=re.DOTALL)
    pictures = re.findall(r'<img src="([^"]+)"', index)
    assert len(pictures) == 3 * 5
    assert all((out / picture).stat().st_size < 50_000 for picture in pictures)
    assert (out / "notes.txt").exists()
    summary = (out / "summary.md").read_text().splitlines()
    assert summary[0] == "**5 of 8 comparisons failed.**"
    shown = re.findall(r"!\[(?:expected|got|difference)\]\(([^)]+)\)", "\n".join(summary))
    assert set(shown) < set(pictures)
    assert sorted(row.split(" | ")[0] for row in summary[4:]) == ["| error", *["| fail"] * 4]


REVIEWED = """
from pathlib import Path

@pytest.mark.parametrize("name", ["mine", "other"])
def test_image(raytwin_reference, name):
    pixels = np.full((6, 8, 3), 0.5)
    pixels[2:4, 3:6] = 0.5 if name == "other" else float(Path("value").read_text())
    raytwin_reference(name, "path", image=True).check(raytwin.Image(pixels.astype("f4")))

def test_laws_of_a_tracer_without_shadows(raytwin_laws):
    found = raytwin_laws(lambda scene: lambert(scene), rung="lambert")
    assert found.verdict == "pass"
    raytwin_laws(lambert, rung="shadow")

def test_laws_of_what_renders_nothing(raytwin_laws):
    raytwin_laws(lambda scene: np.zeros((1, 1, 3)))

def lambert(scene):
    from raytwin.renderers.scene_exchange import as_scene
    return raytwin.trace(as_scene(scene), "lambert").mean
"""


def test_a_summary_counts_in_words_and_does_not_pass_without_a_comparison():
    row = check_page.CheckRow("test_a", 0, "mine", "path", "pass", ())
    said = [check_page.summary([row] * count, 0).strip() for count in range(4)]
    assert said == ["Nothing was compared.", "1 comparison passes."] + [f"All {n} comparisons pass." for n in (2, 3)]


@nightly
def test_an_image_is_accepted_into_the_folder_of_ones_own_and_an_update_tells_which_it_wrote(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\nraytwin_references = tests/golden\n")
    (below := tmp_path / "below").mkdir()
    for value, expected in (("0.25", ["made", "made"]), ("0.25", []), ("0.4", ["replaced"])):
        (below / "value").write_text(value)
        found = run(below, "--raytwin-update", "-k", "image", "-n", "2", test_review="import raytwin\n" + REVIEWED)
        lines = "\n".join(found.outlines)
        told = re.findall(r"^raytwin: (\w+) \.\./tests/golden/\w+/path\.exr$", lines, re.MULTILINE)
        assert told == expected, value
    (below / "value").write_text("0.3")
    lines = "\n".join(run(below, "--raytwin-report", "pages", "-k", "image").outlines)
    (command,) = set(re.findall(r"note: to take it for the reference: raytwin (.*)", lines))  # CI prints it twice
    assert command.startswith("reference accept pages/new/mine/path.exr")
    for folder in (("--folder", tmp_path), ()):
        taken = raytwin(*shlex.split(command), *folder, cwd=below)
        if folder:
            refused(taken, "the reference that the image replaces")
    assert taken.returncode == 0, taken.stderr
    assert "because: why (before: none)" in taken.stdout
    assert references.load(tmp_path / "tests/golden/mine/path.exr").header["because"] == "why"
    assert not (below / "reference").exists()
    run(below, "-k", "image").assert_outcomes(passed=2)


@nightly
def test_laws_are_judged_in_a_test_and_listed_in_the_report(tmp_path):
    result = run(tmp_path, "--raytwin-report", "pages", "-k", "laws", test_review="import raytwin\n" + REVIEWED)
    result.assert_outcomes(failed=2)
    result.stdout.fnmatch_lines(
        [
            "*FAIL  lambert, shadow: Something casts or gets no shadow.",
            "*Broken: covered.",
            "E * <lambda>: expected an image (108, 144, 3), got float64 (1, 1, 3)",
        ]
    )
    summary = (tmp_path / "pages/summary.md").read_text().splitlines()
    assert summary[0] == "**2 of 3 comparisons failed.**"  # laws count, and what renders nothing is an error
    (row,) = (line for line in summary if "without" in line)
    assert "| fail |" in row
    assert "Something casts or gets no shadow." in row
    (page,) = re.findall(r"\]\((laws/[^)]+/laws\.html)\)", row)
    assert f'href="{page}"' in (tmp_path / "pages/index.html").read_text()
    assert "FAIL" in (tmp_path / "pages" / page).read_text().upper()


@nightly
def test_a_report_that_cannot_be_written_is_a_wrong_option(tmp_path):
    (tmp_path / "file").touch()
    for place in ("file", "file/below"):
        result = run(tmp_path, "--raytwin-report", place, test_all="def test_all(raytwin_reference): pass")
        assert result.ret == pytest.ExitCode.USAGE_ERROR
        (line,) = filter(None, result.outlines)
        assert re.match(rf"ERROR: --raytwin-report: {tmp_path}/{place}: expected a folder to write, got ", line)


# ------------------------------------------------------------------------------------------ at no cost


def test_a_run_that_does_not_use_the_plugin_loads_nothing_for_it(pytester):
    pytester.makepyfile("""
        import sys

        def test_it():
            assert "numpy" not in sys.modules
            assert {name for name in sys.modules if name.startswith("raytwin")} == {"raytwin", "raytwin.pytest_plugin"}
    """)
    pytester.runpytest_subprocess("-p", "no:hypothesispytest", "-p", "no:jaxtyping").assert_outcomes(passed=1)
