"""What a user hands over: every entry takes the same, and refuses the same in one line."""

import re

import numpy as np
import pytest
from program import raytwin

from raytwin.compare import SequentialComparison
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.images.image_formats import write_image
from raytwin.images.image_input import as_image
from raytwin.images.photo_files import from_bytes, write_picture
from raytwin.images.stored_precision import half_code
from raytwin.scene.scene_files import read_scene
from raytwin.study.compare_scene import compare_scene
from raytwin.study.diff_files import compare as diff
from raytwin.teach.contract.subject import method
from raytwin.tracer import trace

GREY = np.full((8, 9, 3), 0.5, np.float32)
REFUSED = {
    "text": "no/such file", "a null byte": "a\0b", "a long name": 5000 * "x", "a long layer": 5000 * "x" + ":y",
    "complex": GREY + 0j, "objects": GREY.astype(object), "bool": GREY > 0, "texts": np.array(["a"]),
    "dates": np.array(["2020"], "datetime64"), "dict": {}, "set": {1},
}  # fmt: skip
ENTRIES = {
    "compare": lambda thing: diff(thing, GREY),
    "its reference": lambda thing: diff(GREY, thing),
    "sequential": lambda thing: SequentialComparison(thing),
    "added": lambda thing: SequentialComparison(GREY).add(thing),
    "a subject": lambda thing: method(lambda scene: thing)(read_scene("single").with_(size=(9, 8))),
}


@pytest.mark.foreign
@pytest.mark.parametrize("entry", ENTRIES)
def test_what_is_no_image_is_refused_in_one_line(entry):
    for what, thing in REFUSED.items():
        with pytest.raises(InputError) as refused:
            ENTRIES[entry](thing)
        assert re.fullmatch(r"[^\n]*: expected [^\n]*, got [^\n]*", str(refused.value)), what
    with pytest.raises(InputError, match=r"samples: expected .*, got -1"):
        Image(GREY, samples=-1)


def test_a_sequence_takes_arrays_paths_and_pictures_of_8_bits(tmp_path):
    codes = np.random.default_rng(1).integers(0, 256, (8, 9, 3), np.uint8)
    exact = from_bytes(codes)
    write_picture(tmp_path / "x.png", codes)
    for pair in ((exact, exact), (tmp_path / "x.png", exact), (exact, tmp_path / "x.png")):
        check = SequentialComparison(pair[0])
        assert check.add(pair[1]) is None
        assert check.add(pair[1]).verdict == "pass"
    between = exact + 0.4 * half_code(exact)
    check = SequentialComparison(between, test=tmp_path / "x.png")
    check.add(test=tmp_path / "x.png")
    assert check.add(test=tmp_path / "x.png").verdict == "pass"


def test_renders_with_an_infinite_value_are_infinite_and_not_nan():
    rng, check = np.random.default_rng(0), SequentialComparison(GREY)
    for _ in range(4):
        broken = GREY + rng.normal(0, 0.01, GREY.shape).astype(np.float32)
        broken[2, 3] = np.inf, -np.inf, np.nan
        found = check.add(broken)
    assert found.reasons[:2] == (
        "the test image has 1 NaN value in 1 pixel, the first at (x=3, y=2)",
        "the test image has 2 infinite values in 1 pixel, the first at (x=3, y=2)",
    )
    assert not any("variance" in reason for reason in found.reasons)


def test_a_function_that_returns_a_path_is_a_subject(tmp_path):
    scene = read_scene("single").with_(size=(24, 18))
    write_image(tmp_path / "x.exr", trace(scene, "shadow"))
    np.testing.assert_array_equal(method(lambda _: tmp_path / "x.exr")(scene).mean, trace(scene, "shadow").mean)
    (tmp_path / "mine.py").write_text("import pathlib\ndef render(scene):\n    return pathlib.Path('x.exr')\n")
    asked = "--size", "24x18", "--subject", "mine.py:render", "-o", "out"
    run = raytwin("compare", "single", *asked, cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.nightly
@pytest.mark.parametrize("ending", ["png", "exr"])
def test_a_subject_is_held_to_what_its_files_format_can_show(ending, tmp_path, monkeypatch):
    """Eight bits, or half floats: the true picture passes, and one that is 2 % too bright fails."""
    monkeypatch.chdir(tmp_path)
    exact = trace(read_scene("overlap").with_(size=(96, 72)), "shadow").mean
    for factor, verdict in ((1.0, "pass"), (1.02, "fail")):
        shown = (factor * exact).astype(np.float16 if ending == "exr" else np.float32)
        write_image(tmp_path / f"x.{ending}", Image(shown))
        made = compare_scene("overlap", subject=f"x.{ending}", size=(96, 72))
        assert made.verdict == verdict
        assert made.report.comparison.radiance.p999_abs > 1e-4, "no more than the tolerance was rounded off"


@pytest.mark.parametrize("ending", ["png", "exr", "half", "float16", "pfm"])
def test_a_formats_rounding_stays_within_the_step_that_is_granted_for_it(tmp_path, ending):
    ramp = np.linspace(0, 1.5, 64 * 48 * 3).reshape(48, 64, 3)
    smooth = Image(np.random.default_rng(2).permuted(ramp).astype(np.float32))
    thing = tmp_path / f"a.{'exr' if ending == 'half' else ending}"
    half = smooth.mean.astype(np.float16)
    if ending == "float16":
        thing = half
    else:
        write_image(thing, Image(half.astype(np.float32)) if ending == "half" else smooth)
    taken = as_image(thing)
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
        made = as_image(things, renders=5).image
        np.testing.assert_allclose(made.mean, x.mean(0), rtol=1e-6)
        np.testing.assert_allclose(made.variance, x.var(0, ddof=1) / 5, rtol=1e-6)
        assert made.batches == 5
    with pytest.raises(InputError, match="one shape"):
        as_image([np.zeros((2, 3, 3))] * 3 + [np.zeros((3, 2, 3))])
