"""A Mitsuba file where a scene is named: compared, kept as a reference, held to in pytest."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from raytwin import twin
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.renderers import references
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene.mitsuba_file import read_mitsuba
from raytwin.show.view import view_of
from raytwin.study import make_reference
from raytwin.study.compare_scene import compare_scene
from raytwin.study.rounds import Budget

SIZE = (48, 36)


@pytest.fixture
def glass(tmp_path, scenes) -> Path:
    """The shipped scene, small, as a folder of one's own."""
    folder = shutil.copytree(scenes / "glass", tmp_path / "kitchen")
    edit(folder, '"width" value="160"', f'"width" value="{SIZE[0]}"')
    edit(folder, '"height" value="120"', f'"height" value="{SIZE[1]}"')
    return folder


def edit(folder: Path, old: str, new: str) -> None:
    text = (folder / "scene.xml").read_text()
    assert old in text
    (folder / "scene.xml").write_text(text.replace(old, new))


def renderer(depth: int = 8, power: float = 1) -> UserRenderer:
    """Someone's renderer, which reads the file: Mitsuba with a seed of its own, to a depth; its values to a power."""

    def render(told: dict) -> Image:
        assert (told["name"], told["width"], told["height"]) == ("kitchen", *SIZE)
        own = Path(told["mitsuba"]).with_name("theirs.xml")
        text = Path(told["mitsuba"]).read_text()
        own.write_text(text.replace('name="depth" value="8"', f'name="depth" value="{depth}"'))
        image = twin.render_mitsuba(read_mitsuba(own), 64, 7)
        return image if power == 1 else Image.from_array(np.maximum(image.mean, 0) ** power)

    return UserRenderer("path", "theirs", render)


@pytest.mark.nightly
def test_a_right_renderer_passes_and_one_that_stops_early_fails(glass):
    """At a false-alarm rate of 1e-3, at fixed seeds."""
    right = compare_scene(glass, subject=renderer())
    assert right.comparison.verdict == "pass", right.comparison.reasons
    wrong = compare_scene(glass / "scene.xml", subject=renderer(depth=3))
    assert wrong.comparison.verdict == "fail"
    told = right.report.numbers()
    assert (told["scene"], told["rung"], told["ledger"]) == ("kitchen", None, None)
    assert told["geometry"].mask_mismatch_pixels == 0
    assert "only Mitsuba knows the light" in right.comparison.reasons[-1]
    assert view_of(right).objects[4:6] == ("bowl", "ball")


def test_a_renderer_that_encodes_its_image_is_named(glass):
    found = compare_scene(glass, subject=renderer(power=1 / 2.2)).comparison
    assert found.verdict == "fail"
    assert "gamma" in found.reasons[0]


def test_a_program_is_given_the_file_whose_film_alone_says_the_size(glass, tmp_path):
    program = tmp_path / "prog.py"
    program.write_text(
        "import sys\nimport numpy as np\nimport raytwin\nfrom raytwin.scene.mitsuba_file import read_mitsuba\n"
        "w, h = read_mitsuba(sys.argv[1]).image_size\n"
        "raytwin.write_image(sys.argv[2], raytwin.Image(np.full((h, w, 3), 0.5, np.float32)))\n"
    )
    subject = f"{sys.executable} {program} {{scene}} {{out}}"
    result = compare_scene(glass, subject=subject, samples=16)
    assert result.subject.shape[:2] == SIZE[::-1]
    assert result.comparison.verdict == "fail"
    for asked in (subject, "twin-llvm-path-64"):
        with pytest.raises(InputError, match=r"--size: expected the size in the file's <film>.*got 24 x 18"):
            compare_scene(glass, subject=asked, size=(24, 18))


def test_what_cannot_take_a_file_is_refused(glass):
    for subject in (None, "drjit32-shadow-conic", "twin-llvm-shadow"):
        with pytest.raises(InputError, match=r"--subject: .*for a Mitsuba file"):
            compare_scene(glass, subject=subject)


@pytest.mark.nightly
def test_a_reference_of_a_file_is_made_checked_and_goes_stale_with_its_mesh(glass, tmp_path):
    made = make_reference.make(glass, "path", tmp_path / "reference", samples=128)
    references.save(made.new)
    assert make_reference.make(glass, "path", tmp_path / "reference", samples=128).kind == "same"
    assert made.new.image.surface is not None
    kept = references.load(made.new.path)
    assert kept.of_file
    assert not kept.golden
    assert make_reference.check(glass, "path", tmp_path / "reference", budget=Budget(samples=64)).exit_code == 0
    with pytest.raises(InputError, match="--rung: expected one of path"):
        make_reference.make(glass, "shadow", tmp_path / "reference")
    mesh = glass / "bowl.ply"
    mesh.write_bytes(mesh.read_bytes().replace(b"twisted", b"squashd"))
    stale = make_reference.check(glass, "path", tmp_path / "reference")
    assert stale.exit_code == 1
    assert "bowl.ply changed since" in stale.problems[0]


@pytest.mark.nightly
def test_a_reference_of_a_film_with_a_window_is_the_part_that_it_shows(glass, tmp_path):
    whole = twin.render_mitsuba(read_mitsuba(glass), 64, 1)
    window = {"offset_x": 20, "offset_y": 10, "width": 16, "height": 12}
    crop = "".join(f'<integer name="crop_{name}" value="{value}"/>' for name, value in window.items())
    edit(glass, "</film>", f"{crop}</film>")
    made = make_reference.make(glass, "path", tmp_path / "reference", samples=64).new
    references.save(made)
    np.testing.assert_array_equal(made.image.surface.ids, whole.surface.ids[10:22, 20:36])
    assert make_reference.check(glass, "path", tmp_path / "reference", budget=Budget(samples=64)).exit_code == 0
    assert compare_scene(glass, subject="twin-llvm-path-64", samples=64).reference.shape == made.image.shape


def test_the_shipped_file_and_its_reference_belong_together(scenes):
    found = references.load(references.path_of(references.SHIPPED, "glass", "path"))
    assert references.stale(found, scenes / "glass") is None
    assert found.image.samples >= 4096
    assert set(np.unique(found.image.surface.ids)) == set(range(6))  # all but the lamp, which hangs above the frame
