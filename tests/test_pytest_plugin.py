"""The pytest plugin as its users meet it: small test files, run by a pytest of their own."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

from raytwin import files, image_input, references
from raytwin.errors import InputError
from raytwin.image import Image

pytest_plugins = ["pytester"]
SHIPPED = references.SHIPPED


# A process that has imported all that a run needs, and is forked for each: importing costs a second.
WARM = """
import json, os, sys
import numpy, pytest, raytwin.diagnose.diagnosis, raytwin.references, raytwin.report.check_page, raytwin.speed
told = os.dup(1)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
pytest.main(["--version", "-W", "ignore:Module already imported"])  # loads the environment's plugins
for line in sys.stdin:
    environment, folder, out, words = json.loads(line)
    child = os.fork()
    if not child:
        os.environ.clear()
        os.environ.update(environment)
        os.chdir(folder)
        file = os.open(out, os.O_WRONLY | os.O_CREAT)
        os.dup2(file, 1)
        os.dup2(file, 2)
        code = pytest.main(words)
        sys.stdout.flush()
        os._exit(code)
    os.write(told, b"%d\\n" % os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    empty = tmp_path_factory.mktemp("warm")
    with subprocess.Popen(
        [sys.executable, "-c", WARM], cwd=empty, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        yield child
        child.stdin.close()
        assert child.wait(60) == 0


# To look for causes takes longest: one test reads them.
HEAD = """
import numpy as np
import pytest

@pytest.fixture(autouse=True)
def few_causes(request, monkeypatch):
    if "array" not in request.node.name:
        monkeypatch.setattr("raytwin.diagnose.diagnosis.explain", lambda *_, **__: ())
"""


@pytest.fixture
def run(pytester: pytest.Pytester, warm):
    def run(source: str, *options: str) -> pytest.RunResult:
        pytester.makepyfile(test_it=HEAD + source)
        out = pytester.path.with_suffix(".told")
        out.unlink(missing_ok=True)
        known = ("-W", "error", "-W", "ignore:Module already imported", "--strict-markers")
        asked = dict(os.environ), str(pytester.path), str(out), [*known, *options]
        warm.stdin.write(json.dumps(asked).encode() + b"\n")
        warm.stdin.flush()
        code = int(warm.stdout.readline())
        return pytest.RunResult(code, out.read_text().splitlines(), [], 0.0)

    return run


def failures(result: pytest.RunResult) -> dict[str, str]:
    """The first line that each failed test says, by its name."""
    lines = re.findall(r"^FAILED \S+::(\S+) - (.*)$", "\n".join(result.outlines), re.MULTILINE)
    return dict(lines)


# ------------------------------------------------------------------------------------------ what may be checked


def test_arrays_files_renders_and_functions_pass_where_they_agree_and_fail_where_not(run):
    result = run(
        """
        from raytwin import files
        from raytwin.image import Image

        def noisy(held, factor=1.0):
            # Exponential noise: never negative, as radiance.
            return lambda seed: factor * held.image.mean * (
                1 + 0.2 * (np.random.default_rng(seed).exponential(size=held.image.shape) - 1))

        @pytest.fixture
        def shadow(raytwin_reference):
            return raytwin_reference("overlap", "shadow")

        @pytest.fixture
        def path(raytwin_reference):
            return raytwin_reference("overlap", "path")

        FACTORS = pytest.mark.parametrize("factor", [1.0, 1.01])

        @FACTORS
        def test_array(shadow, factor):
            shadow.check(shadow.image.mean * factor)

        @FACTORS
        def test_list(shadow, factor):
            shadow.check((shadow.image.mean * factor).tolist())

        @FACTORS
        def test_image(shadow, factor):
            shadow.check(Image(shadow.image.mean * factor))

        @FACTORS
        @pytest.mark.parametrize("ending", ["exr", "pfm", "png"])
        def test_file(shadow, tmp_path, ending, factor):
            files.write_image(tmp_path / f"a.{ending}", Image((shadow.image.mean * factor**2).astype("f4")))
            shadow.check(tmp_path / f"a.{ending}")

        @FACTORS
        def test_variance(path, factor):
            made = np.array([noisy(path, factor)(seed) for seed in range(16)])
            path.check(made.mean(0), variance=made.var(0, ddof=1) / 16)

        @FACTORS
        def test_renders(path, factor):
            path.check(np.array([noisy(path, factor)(seed) for seed in range(6)]))

        @FACTORS
        def test_function(path, factor):
            path.check(noisy(path, factor), renders=8)

        @FACTORS
        def test_function_without_noise(shadow, factor):
            calls = []
            shadow.check(lambda seed: calls.append(seed) or shadow.image.mean * factor)
            assert calls == [0, 1]

        @FACTORS
        def test_tolerance(shadow, factor):
            shadow.check(shadow.image.mean * factor**0.1, tolerance=1e-4)

        def test_compare_does_not_fail(shadow):
            assert shadow.compare(2 * shadow.image.mean).verdict == "fail"
            given = shadow.scene_dict  # what --subject FILE.py:FUNCTION gets
            assert (given["height"], given["width"], given["rung"]) == (*shadow.image.shape[:2], "shadow")
            assert given["K"].shape == (3, 3) and len(given["spheres"]) == len(shadow.scene.spheres)
        """.replace("\n        ", "\n"),
    )
    cases = ("array", "list", "image", "variance", "renders", "function", "function_without_noise", "tolerance")
    expected = {f"test_{case}[1.01]" for case in cases} | {f"test_file[{e}-1.01]" for e in ("exr", "pfm", "png")}
    assert failures(result).keys() == expected
    result.assert_outcomes(passed=len(expected) + 1, failed=len(expected))
    cause = "the whole image, background too, is 1.01 times too bright"
    result.stdout.fnmatch_lines([f"*overlap/shadow: {cause}*"])
    result.stdout.no_fnmatch_line("*cause (*")


def test_the_reference_of_a_mitsuba_file_needs_no_rung_and_is_never_replaced_by_an_image(run):
    result = run(
        """
def test_same(raytwin_reference):
    reference = raytwin_reference("glass")
    reference.check(reference.image)
    assert (reference.rung, reference.reference.golden) == ("path", False)

def test_darker(raytwin_reference):
    reference = raytwin_reference("glass")
    reference.check(0.9 * reference.image.mean)
""",
        "--raytwin-update",
    )
    assert list(failures(result)) == ["test_darker"]


def test_what_is_no_image_fails_with_a_clear_line_and_without_a_traceback_of_ours(run):
    result = run(
        """
def test_file(raytwin_reference):
    raytwin_reference("overlap").check("nosuch.png")

def test_kind(raytwin_reference):
    raytwin_reference("overlap").check("test_it.py")

def test_shape(raytwin_reference):
    raytwin_reference("overlap").check(np.zeros((252, 336)))

def test_few(raytwin_reference):
    raytwin_reference("overlap").check([np.zeros((252, 336, 3))] * 3)

def test_nan(raytwin_reference):
    held = raytwin_reference("overlap")
    broken = held.image.mean.copy()
    broken[7, 5] = np.nan
    held.check(broken)

def test_thing(raytwin_reference):
    raytwin_reference("overlap").check(None)

def test_noise_untold(raytwin_reference):
    held = raytwin_reference("overlap", "path")
    held.check(1.3 * held.image.mean * (0.8 + 0.2 * np.random.default_rng(1).exponential(size=held.image.shape)))
""",
    )
    result.assert_outcomes(failed=7)
    for line in (
        "*nosuch.png: expected an image file, got no such file",
        "*test_it.py: expected an image: EXR, PFM, HDR, PNG or JPEG*",
        "*the test image has the shape (252, 336), not (height, width, 3)",
        "*repeated renders: expected at least 4, got 3",
        "*NaN value*(x=5, y=7)*",
        "*note: the reference has noise and the image tells none*variance=*",
    ):
        result.stdout.fnmatch_lines([line])
    result.stdout.no_fnmatch_line("*pytest_plugin.py*")
    result.stdout.no_fnmatch_line("*During handling*")


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

TRACED = """
def test_traced(raytwin_reference):
    from raytwin.speed import trace
    held = raytwin_reference("ball", "shadow")
    assert held.camera.image_size == (40, 30)
    held.check(trace(held.scene, "shadow"))
"""


def test_a_missing_reference_fails_and_names_the_command_that_makes_it(run, pytester):
    result = run(TRACED.replace("ball", "nosuch").replace("shadow", "sky"))
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            f"*no such reference in {pytester.path}/reference/nosuch/sky.exr or *reference/nosuch/sky.exr",
            "*raytwin reference make scenes/nosuch --rung sky",
        ]
    )
    result = run(TRACED.replace('"shadow"', '"sun"'))
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*rung: expected one of surface, lambert, shadow, sky, path, got sun"])


def test_update_makes_what_is_missing_or_stale_from_the_scene_and_the_command_it_names_works(run, pytester):
    pytester.makeini("[pytest]\nraytwin_references = my/images\nraytwin_scenes = my/scenes\n")
    scene = pytester.path / "my/scenes/ball/scene.toml"
    scene.parent.mkdir(parents=True)
    scene.write_text(SCENE)
    result = run(TRACED)
    result.assert_outcomes(failed=1)
    command = next(line for line in result.outlines if "To make it: " in line).partition("To make it: ")[2].split()
    assert command == ["raytwin", "reference", "make", "my/scenes/ball", "--rung", "shadow", "--folder", "my/images"]
    made = subprocess.run([sys.executable, "-m", *command], cwd=pytester.path, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    run(TRACED).assert_outcomes(passed=1)

    scene.write_text(SCENE.replace("radius = 0.05", "radius = 0.04"))
    stale = run(TRACED)
    stale.assert_outcomes(failed=1)
    stale.stdout.fnmatch_lines(["*stale: the scene has changed since*"])
    run(TRACED, "--raytwin-update").assert_outcomes(passed=1)
    run(TRACED).assert_outcomes(passed=1)


def test_update_takes_an_image_without_a_scene_as_its_own_reference_but_never_a_broken_one(run):
    source = """
def test_it(raytwin_reference):
    raytwin_reference("mine", "path", image=True).check(np.full((6, 8, 3), VALUE))
"""
    run(source.replace("VALUE", "0.5")).assert_outcomes(failed=1)
    run(source.replace("VALUE", "0.5"), "--raytwin-update").assert_outcomes(passed=1)
    run(source.replace("VALUE", "0.5")).assert_outcomes(passed=1)
    run(source.replace("VALUE", "0.6")).assert_outcomes(failed=1)
    broken = run(source.replace("VALUE", "np.nan"), "--raytwin-update")
    broken.assert_outcomes(failed=1)
    broken.stdout.fnmatch_lines(["*no reference can be made of this image*NaN*"])
    run(source.replace("VALUE", "0.6"), "--raytwin-update").assert_outcomes(passed=1)
    run(source.replace("VALUE", "0.6")).assert_outcomes(passed=1)


def test_update_makes_no_reference_of_a_mistyped_scenes_image(run, pytester):
    source = """
def test_it(raytwin_reference):
    raytwin_reference("overlpa", "shadow").check(np.full((6, 8, 3), 0.5))
"""
    result = run(source, "--raytwin-update")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["*There: ball, desk, distorted, eclipse, gl*gloss, grazing, overlap, single*", "*'overlpa', *image=True*"]
    )
    assert not (pytester.path / "reference").exists()


def test_a_wrong_word_in_the_marker_is_named_with_the_right_ones(run):
    source = """
@pytest.mark.raytwin(scene="overlap")
def test_it(raytwin_case):
    pass
"""
    result = run(source)
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*test_it: the marker is raytwin(scenes=None, rungs=None)*argument 'scene'*"])
    result.stdout.no_fnmatch_line("*INTERNALERROR*")


def test_update_leaves_shipped_references_alone(run, pytester):
    before = {f: f.stat().st_mtime_ns for f in SHIPPED.glob("*/*.exr")}
    source = """
def test_it(raytwin_reference):
    held = raytwin_reference("overlap", "shadow")
    held.check(1.1 * held.image.mean)
"""
    run(source, "--raytwin-update").assert_outcomes(failed=1)
    assert {f: f.stat().st_mtime_ns for f in SHIPPED.glob("*/*.exr")} == before
    assert not (pytester.path / "reference").exists()


def test_a_scene_of_ones_own_is_not_held_to_the_shipped_one_of_its_name(run, pytester):
    scene = pytester.path / "scenes/overlap/scene.toml"
    scene.parent.mkdir(parents=True)
    scene.write_text(SCENE)
    result = run(TRACED.replace("ball", "overlap"))
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*raytwin reference make scenes/overlap --rung shadow"])
    run(TRACED.replace("ball", "overlap"), "--raytwin-update").assert_outcomes(passed=1)


# ------------------------------------------------------------------------------------------ many at once

CASES = """
@pytest.mark.raytwin(scenes=["overlap", "single"], rungs=["shadow", "lambert"])
def test_cases(raytwin_case):
    raytwin_case.check(raytwin_case.image.mean * (1.1 if raytwin_case.rung == "lambert" else 1))
"""


@pytest.mark.parametrize("workers", [(), ("-n", "2")], ids=["one process", "two workers"])
def test_report_lists_every_comparison_once_failures_first(run, pytester, workers):
    source = (
        CASES
        + """
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
    )
    out = pytester.path / "out"
    out.mkdir()
    (out / "check-of-an-earlier-run.json").write_text("{}")
    (out / "notes.txt").write_text("not ours")
    result = run(source, "--raytwin-report", "out", *workers)
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
    assert index.count("data:image/png") == 3 * 5
    assert (out / "notes.txt").exists()


def test_cases_default_to_all_references_that_are_there(run):
    seen = "raytwin_case.image.mean.any() and (raytwin_case.reference.of_file or raytwin_case.camera)"
    result = run(f"def test_cases(raytwin_case):\n    assert {seen}\n")
    result.assert_outcomes(passed=len(references.listed(SHIPPED)))


def test_cases_of_a_scene_that_is_not_there_fail_instead_of_vanishing(run):
    source = "@pytest.mark.raytwin(scenes=['nosuch'])\ndef test_cases(raytwin_case):\n    pass\n"
    result = run(source)
    assert result.ret != 0
    result.stdout.fnmatch_lines(["*no such reference*nosuch*"])


# ------------------------------------------------------------------------------------------ at no cost


def test_loading_the_plugin_loads_nothing_else():
    code = (
        "import sys, pytest; before = set(sys.modules); import raytwin.pytest_plugin; print(set(sys.modules) - before)"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() in ("{'raytwin', 'raytwin.pytest_plugin'}", "{'raytwin.pytest_plugin', 'raytwin'}")


def test_a_run_that_does_not_use_the_plugin_loads_no_numpy_for_it(pytester):
    pytester.makepyfile("import sys\ndef test_it():\n    assert 'numpy' not in sys.modules\n")
    pytester.runpytest_subprocess("-p", "no:hypothesispytest", "-p", "no:jaxtyping").assert_outcomes(passed=1)


# ------------------------------------------------------------------------------------------ formats


@pytest.fixture
def smooth() -> Image:
    ramp = np.linspace(0, 1.5, 64 * 48 * 3).reshape(48, 64, 3)
    return Image(np.random.default_rng(2).permuted(ramp).astype(np.float32))


@pytest.mark.parametrize("ending", ["png", "exr", "half", "float16", "pfm"])
def test_a_formats_rounding_stays_within_the_step_that_is_granted_for_it(smooth, tmp_path, ending):
    thing = tmp_path / f"a.{ending}"
    if ending == "float16":
        thing = smooth.mean.astype(np.float16)
    elif ending == "half":
        thing = thing.with_suffix(".exr")
        files.write_image(thing, Image(smooth.mean.astype(np.float16).astype(np.float32)))
    else:
        files.write_image(thing, smooth)
    taken = image_input.as_image(thing)
    error = np.abs(taken.image.mean - taken.fitted(smooth).mean)
    if ending in ("exr", "pfm"):
        assert taken.rounding.half is None
        assert error.max() == 0
    else:
        share = error / taken.rounding.half
        assert share.max() <= 1
        assert np.quantile(share, 0.9) > 0.4  # no more is granted than needed, dark or bright


def test_the_spread_of_renders_gives_the_variance_of_their_mean():
    x = np.random.default_rng(3).exponential(size=(5, 4, 6, 3))
    for things in (x, list(x), [Image(i) for i in x], lambda seed: x[seed]):
        made = image_input.as_image(things, renders=5).image
        np.testing.assert_allclose(made.mean, x.mean(0), rtol=1e-6)
        np.testing.assert_allclose(made.variance, x.var(0, ddof=1) / 5, rtol=1e-6)
        assert made.batches == 5


def test_renders_of_different_shapes_are_refused():
    with pytest.raises(InputError, match="one shape"):
        image_input.as_image([np.zeros((2, 3, 3))] * 3 + [np.zeros((3, 2, 3))])
