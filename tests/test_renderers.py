"""Ways to make an image, others' among them: what `raytwin compare --subject` takes."""

import sys

import numpy as np
import pytest

from raytwin import tracer
from raytwin.errors import InputError
from raytwin.images.exr import write_exr
from raytwin.images.image import Image
from raytwin.photos.denoise import non_local_means
from raytwin.renderers.renderer_table import RENDERERS
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.teach.contract.subject import find_subject, method

LEARNERS = """
import numpy as np

def render(scene):
    return np.broadcast_to(scene["sky"]["radiance"], (scene["height"], scene["width"], 3))

def wrong_size(scene):
    return np.zeros((3, 3, 3))

def broken(scene):
    return scene["moon"]

def leaves(scene):
    raise SystemExit(5)
"""


@pytest.fixture
def theirs(tmp_path):
    file = tmp_path / "theirs.py"
    file.write_text(LEARNERS)
    return file


def test_a_scene_is_given_out_resolved_and_in_float64(overlap):
    given = as_arrays(overlap, "lambert")
    assert list(given) == [
        "name", "width", "height", "dist", "K", "R_cam_board", "t_cam_board", "spheres", "planes", "sun", "sky", "rung",
    ]  # fmt: skip
    assert given["dist"].shape == (5,)
    assert np.linalg.norm(given["sun"]["to_light"]) == pytest.approx(1, abs=1e-15)
    assert {a.dtype for s in given["spheres"] for a in s.values() if isinstance(a, np.ndarray)} == {np.dtype(float)}
    np.testing.assert_array_equal(given["planes"][0]["half_u"], overlap.planes[0].half_u)


def test_what_a_function_does_wrong_is_told_in_one_line(theirs, single):
    for function, said in (
        ("wrong_size", r"expected an image \(480, 640, 3\), got float64 \(3, 3, 3\)"),
        ("broken", "expected an image .*, got KeyError: 'moon'"),
        ("leaves", "expected an image .*, got SystemExit: 5"),
    ):
        with pytest.raises(InputError, match=said):
            find_subject(f"{theirs}:{function}", "shadow")(single)


def test_a_function_of_a_seed_is_called_with_other_seeds_in_each_render(single):
    def noisy(scene, seed):
        seeds.append(seed)
        return np.random.default_rng(seed).random((480, 640, 3))

    seeds = []
    assert method(noisy, renders=4)(single, 2).batches == 4
    assert seeds == [8, 9, 10, 11]


def test_an_image_and_a_folder_of_images_are_subjects(tmp_path, single):
    image = tracer.trace(single)
    write_exr(tmp_path / "single.exr", Image(image.mean))
    for text in (tmp_path / "single.exr", tmp_path):
        np.testing.assert_array_equal(find_subject(str(text), "shadow")(single).mean, image.mean)
    with pytest.raises(InputError, match=r"other\.exr"):
        find_subject(str(tmp_path), "shadow")(single.__class__("other", single.camera))


@pytest.mark.nightly
def test_a_method_is_made_of_whatever_a_subject_may_be(theirs, single, scenes):
    named = method(f"{theirs}:render", "mine", rung="lambert", sampling="area")
    assert (named.name, named.rung, named.sampling) == ("mine", "lambert", "area")
    given = method(f"{theirs}:render")
    assert (given.name, given.rung, given.sampling) == (f"{theirs}:render", "shadow", "center")
    np.testing.assert_array_equal(given(single).mean, find_subject(f"{theirs}:render", "shadow")(single).mean)
    assert method("twin-llvm-path-4") == RENDERERS["twin-llvm-path-4"]
    with pytest.raises(InputError, match="a function beside `renders` or `records`"):
        method(f"{theirs}:render", records=True)


def test_a_program_reads_the_scene_and_writes_an_image(tmp_path, single):
    program = tmp_path / "program.py"
    program.write_text(
        "import json, sys, numpy as np\n"
        "scene = json.load(open(sys.argv[1]))\n"
        "sky = np.float32(scene['sky']['radiance'])\n"
        "rows = np.broadcast_to(sky, (scene['height'], scene['width'], 3))\n"
        "open(sys.argv[2], 'wb').write(b'PF\\n%d %d\\n-1.0\\n' % (scene['width'], scene['height']) + rows.tobytes())\n"
    )
    made = find_subject(f"{sys.executable} {program} {{scene}} {{out}}.pfm", "shadow")(single)
    np.testing.assert_array_equal(made.mean, np.broadcast_to(np.float32(single.sky.radiance), made.mean.shape))
    for code, said in (("1/0", "1, no image: ZeroDivisionError"), ("exit(3)", "3, no image$")):
        with pytest.raises(InputError, match=rf"expected an image at \{{out\}}, got exit code {said}"):
            find_subject(f"{sys.executable} -c {code} {{out}}", "shadow")(single)


def test_a_row_of_the_table_is_a_subject_and_tells_what_its_rays_met(single, packages):
    made = find_subject("numpy32-shadow-none", "path")(single)
    assert made.surface is not None
    assert find_subject("twin-llvm-path-4", "path") == RENDERERS["twin-llvm-path-4"]
    with pytest.raises(InputError, match=r"--subject: expected a method's name .*, got nonsense"):
        find_subject("nonsense", "shadow")
    with pytest.raises(InputError, match=r"a folder of images, .* got nothing\.py:f, but no such file$"):
        find_subject("nothing.py:f", "shadow")
    with pytest.raises(InputError, match=r"expected a function of back_project, .*, got none"):
        find_subject(__file__, "shadow")


def test_non_local_means_smooth_guesses_and_keep_what_is_even_and_where_edges_are(overlap):
    rng, even = np.random.default_rng(3), np.full((40, 48, 3), 0.5, np.float32)
    even[:, 24:] = 2.0
    np.testing.assert_allclose(non_local_means(even), even, atol=2 / 65535)
    noisy = (even + 0.02 * rng.normal(size=even.shape)).astype(np.float32)
    assert np.abs(non_local_means(noisy) - even).max() < 0.02
    small = overlap.with_(size=(160, 120))
    guessed, smooth = (RENDERERS[f"numpy32-shadow-paper4{end}"](small, 0) for end in ("", "-nlm"))
    np.testing.assert_array_equal(smooth.mean, non_local_means(guessed.mean))
