"""Delta debugging: what is left still fails as before, and nothing of it can be left out."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planted_renderers import Planted
from scene_of import changed
from typer.testing import CliRunner

from raytwin.cli import app
from raytwin.errors import InputError
from raytwin.fast import trace
from raytwin.renderers.scene_exchange import as_scene
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene.scene_files import read_scene, write_scene
from raytwin.study.compare_scene import compare_scene
from raytwin.study.shrink import minimized, parts_of, shrink

pytestmark = pytest.mark.nightly

SMALL = (80, 60)


@given(st.integers(1, 12), st.lists(st.sets(st.integers(0, 11), max_size=4), min_size=1, max_size=3))
def test_what_is_left_fails_and_no_part_of_it_can_be_left_out(n, causes):
    """Any of several sets of parts may make it fail, so that it does not depend on single parts."""
    known = [cause & set(range(n)) for cause in causes]
    asked = []

    def fails(kept):
        asked.append(len(kept))
        return any(cause <= set(kept) for cause in known)

    left = minimized(range(n), fails)
    assert fails(left)
    assert left == sorted(left)
    assert not any(fails([x for x in left if x != one]) for one in left)
    assert len(asked) <= n * n + 4 * n + 8


def test_of_many_parts_one_is_found_in_few_questions():
    asked = []
    left = minimized(range(484), lambda kept: asked.append(1) or 300 in kept)
    assert left == [300]
    assert len(asked) < 25


LIGHT = """
[sun]
to_light = [0.0, 0.6, 0.8]
irradiance = [3.0, 1.0, 0.5]
[sky]
radiance = [0.1, 0.2, 0.3]
[paper]
albedo = 0.85
color = [1.0, 1.0, 1.0]
"""


def test_the_small_scene_has_the_light_that_is_asked_for(scenes, tmp_path):
    (tmp_path / "light.toml").write_text(LIGHT)
    found = shrink(
        scenes / "overlap", subject=Planted("shadow", "no shadows"), size=(48, 36), light=tmp_path / "light.toml"
    )
    assert found.after.sun.irradiance == (3.0, 1.0, 0.5)


@pytest.mark.parametrize(
    ("fault", "left"),
    [("no shadows", {"the sun"}), ("red and blue exchanged", set()), ("crash with two spheres", set())],
)
def test_a_planted_mistake_is_shown_by_two_objects_at_most(scenes, tmp_path, fault, left):
    subject = Planted("shadow", fault)
    found = shrink(scenes / "overlap", subject=subject, size=SMALL)
    assert len(found.after.scene.objects) <= 2
    assert found.evaluations == len(subject.calls)
    assert len(set(subject.calls)) == len(subject.calls)  # a seed of its own each time
    assert left <= set(found.kept)
    assert set(found.removed) | set(found.kept) == set(parts_of(found.before))
    written = write_scene(tmp_path / "small" / "scene.toml", found.after, "why")
    if "crash" in fault:
        with pytest.raises(InputError, match="IndexError"):
            compare_scene(written, subject=subject)
    else:
        assert compare_scene(written, subject=subject).verdict == "fail"


def test_what_was_written_is_the_scene(scenes, tmp_path):
    found = shrink(scenes / "overlap", subject=Planted("shadow", "gamma"), size=(80, 60))
    file = write_scene(tmp_path / "small" / "scene.toml", found.after, "two\nlines")
    text = file.read_text()
    assert text.startswith("# two\n# lines\n")
    again = read_scene(file)
    small = found.after.scene
    assert msgspec.structs.replace(again.scene, name="") == msgspec.structs.replace(small, name="")


def test_a_part_left_out_is_gone(scenes):
    for name in ("studio", "gloss", "distorted"):
        whole = small = read_scene(scenes / name)
        for leave_out in parts_of(whole).values():
            small = leave_out(small)
        assert not small.scene.objects
        assert not any(small.scene.sun.irradiance)
        assert not any(small.scene.sky.radiance)  # nor a map
        assert not any(small.scene.camera.coefficients)


def test_a_mitsuba_file_is_refused(scenes):
    with pytest.raises(InputError, match=r"Mitsuba file was removed in 0\.2\.0"):
        shrink(scenes / "glass", subject=Planted("path", "gamma"))


def test_a_bug_that_one_sphere_shows_ends_with_that_sphere(scenes):
    """What a renderer does to one sphere alone: nothing else of four objects is needed, whatever cause is named."""

    def render(told):
        scene = as_scene(told)
        green = next((s for s in scene.spheres if s.material.albedo[1] > 0.4), None)
        if green is None:
            return trace(scene).mean
        larger = msgspec.structs.replace(green, radius=1.2 * green.radius)
        objects = tuple(larger if thing is green else thing for thing in scene.objects)
        return trace(changed(scene, objects=objects)).mean

    found = shrink(scenes / "overlap", subject=UserRenderer("shadow", "one sphere", render), size=SMALL)
    assert len(found.after.spheres) == 1
    assert len(found.after.scene.objects) == 1


def test_nothing_can_be_cut_down_where_nothing_fails(scenes):
    for options, said in (
        ({"subject": Planted("shadow", "no distortion")}, "a renderer that fails on this scene"),
        ({"subject": None}, "--subject is missing"),
        ({"subject": Planted("shadow", "gamma"), "time_limit": 0}, "--time-limit"),
    ):
        with pytest.raises(InputError, match=said):
            shrink(scenes / "single", size=(40, 30), **options)


def test_the_command_writes_a_scene_its_story_and_the_numbers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        "import numpy as np\nfrom raytwin.renderers.scene_exchange import as_scene\nfrom raytwin.tracer import trace\n"
        "def render(scene):\n    return 2 * trace(as_scene(scene), scene['rung']).mean\n"
    )
    asked = ["shrink", "overlap", "--subject", "mine.py:render", "--size", "80x60", "--json", "s.json"]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    told = msgspec.json.decode(Path("s.json").read_bytes())
    assert told["objects"]["after"] <= 2
    assert told["kind"] == "radiance"
    assert told["command"] in Path("out/shrink-overlap/bug.md").read_text()
    assert read_scene("out/shrink-overlap").name == "shrink-overlap"
    image = CliRunner().invoke(app, ["shrink", "overlap", "--subject", "out/shrink-overlap"])
    assert "an image shows one scene alone" in str(image.exception)


def test_a_failure_that_does_not_come_back_is_not_shrunk(scenes):
    calls = []

    def once(told):
        calls.append(told)
        if len(calls) == 1:
            raise ValueError("the first call")
        return np.zeros((told["height"], told["width"], 3))

    with pytest.raises(InputError, match=r"alike each time, got one that fails by chance: first .*the first call"):
        shrink(scenes / "single", subject=UserRenderer("shadow", "moody", once), size=(40, 30))
    assert len(calls) == 2


def test_addresses_times_and_paths_in_a_message_are_no_other_failure(scenes):
    kept = []

    def broken(told):
        kept.append(object())  # or the next one would get the same address
        raise ValueError(f"{kept[-1]} at 12:{len(kept):02}.5 in /tmp/run{len(kept)}x/scene.json")

    found = shrink(scenes / "overlap", subject=UserRenderer("shadow", "verbose", broken), size=(48, 36))
    assert not found.after.scene.objects
    assert not found.kept
